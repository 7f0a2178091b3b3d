// Captures that camera paths are made of, and what must hold of every path.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "nerf/io/camera_path.h"
#include "nerf/math/camera_paths.h"

namespace nerf::test {

inline Camera camera(int width = 64, int height = 48, double f = 60) {
  Camera c;
  c.model = CameraModel::kPinhole;
  c.width = width;
  c.height = height;
  c.params = {f, f, width * 0.5, height * 0.5};
  return c;
}

// A frame that is neither level nor centred nor of the engine's size in input coordinates.
inline Similarity skewed_frame() {
  Similarity s;
  s.scale = 0.25;
  s.rotation = to_rotation({0.5, 0.5, -0.1, std::sqrt(1 - 0.51)});
  s.center = {10, -4, 2};
  return s;
}

inline void add(ModelInfo& info, const Pose& engine_pose, bool held_out = false) {
  ModelView view;
  view.name = "photos/img" + std::to_string(info.views.size()) + ".jpg";
  view.camera = camera();
  view.pose = info.to_engine.apply_inverse(engine_pose);
  view.held_out = held_out;
  info.views.push_back(view);
}

// Cameras around `target` (engine coordinates) on an arc, tilted a little sideways each.
inline ModelInfo ring(int count, double arc = 2 * std::numbers::pi,
                      const Vec3d& target = {0.2, -0.1, 0.3}) {
  ModelInfo info;
  info.to_engine = skewed_frame();
  info.near = 0.1;
  info.far = 8;
  for (int i = 0; i < count; ++i) {
    const double a = arc * i / count;
    const Vec3d position = target + Vec3d{2 * std::cos(a), 2 * std::sin(a), 1};
    const Vec3d up{0.1 * std::sin(3 * a), 0.1, 1};
    add(info, {look_rotation(target - position, up), position});
  }
  return info;
}

inline ModelInfo forward_facing(int count) {
  ModelInfo info;
  info.to_engine = skewed_frame();
  info.near = 1;
  info.far = 6;
  for (int i = 0; i < count; ++i) {
    const Vec3d position{0.1 * (i % 4) - 0.15, -2, 0.1 * (i / 4) - 0.1};
    add(info, {look_rotation({0.01 * i, 1, 0.005 * i}, {0.05, 0, 1}), position});
  }
  return info;
}

inline Pose engine_pose(const ModelInfo& info, const PathFrame& frame) {
  return info.to_engine.apply(frame.camera_to_world);
}

inline void expect_sound(const CameraPath& path, int frames) {
  ASSERT_EQ(static_cast<int>(path.frames.size()), frames);
  for (const PathFrame& f : path.frames) {
    ASSERT_LT(orthonormality_error(f.camera_to_world.rotation), 1e-12) << f.name;
    ASSERT_TRUE(std::isfinite(length(f.camera_to_world.translation))) << f.name;
    EXPECT_EQ(f.camera.width, 64);
  }
}

inline void expect_level(const ModelInfo& info, const CameraPath& path) {
  for (const PathFrame& f : path.frames) {
    const Mat3d r = engine_pose(info, f).rotation;
    EXPECT_NEAR(r.column(0).z, 0, 1e-12) << f.name << ": x is not horizontal";
    EXPECT_LT(r.column(1).z, 0) << f.name << " stands on its head";
  }
}

}  // namespace nerf::test
