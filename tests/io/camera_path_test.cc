#include "nerf/io/camera_path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "path_captures.h"

namespace nerf {
namespace {

using test::add;
using test::engine_pose;
using test::expect_level;
using test::expect_sound;
using test::forward_facing;
using test::ring;
using test::skewed_frame;

TEST(CameraPath, OrbitIsALevelCircleAroundWhatIsLookedAt) {
  const ModelInfo info = ring(12);
  const Vec3d target{0.2, -0.1, 0.3};
  const CameraPath path = make_camera_path(info, PathKind::kOrbit, {24, 25});
  expect_sound(path, 24);
  expect_level(info, path);
  EXPECT_EQ(path.fps, 25);
  EXPECT_TRUE(path.notes.empty());
  EXPECT_EQ(path.frames[0].name, "orbit_0000");
  EXPECT_EQ(path.frames[23].name, "orbit_0023");
  double turned = 0;
  for (size_t i = 0; i < path.frames.size(); ++i) {
    const Pose pose = engine_pose(info, path.frames[i]);
    const Vec3d from = pose.translation - target;
    EXPECT_NEAR(std::hypot(from.x, from.y), 2, 1e-6);
    EXPECT_NEAR(from.z, 1, 1e-6);
    EXPECT_LT(length(pose.rotation.column(2) + normalized(from)), 1e-6) << "looks elsewhere";
    const Vec3d next =
        engine_pose(info, path.frames[(i + 1) % path.frames.size()]).translation - target;
    const double step =
        std::atan2(from.x * next.y - from.y * next.x, from.x * next.x + from.y * next.y);
    EXPECT_NEAR(step, 2 * std::numbers::pi / 24, 1e-4)
        << "the last step, back to the first frame, included";
    turned += step;
    EXPECT_EQ(path.frames[i].time, 0);
  }
  EXPECT_NEAR(turned, 2 * std::numbers::pi, 1e-9) << "once around";
}

TEST(CameraPath, OrbitOfCamerasOnOneSideStaysAmongThem) {
  const ModelInfo info = ring(10, std::numbers::pi / 2);
  const CameraPath path = make_camera_path(info, PathKind::kOrbit, {60, 30});
  expect_sound(path, 60);
  expect_level(info, path);
  EXPECT_EQ(path.notes.size(), 1u);
  double least = 10, most = -10;
  for (const PathFrame& f : path.frames) {
    const Vec3d from = engine_pose(info, f).translation - Vec3d{0.2, -0.1, 0.3};
    const double azimuth = std::atan2(from.y, from.x);
    least = std::min(least, azimuth);
    most = std::max(most, azimuth);
  }
  EXPECT_NEAR(least, 0, 0.02);
  EXPECT_NEAR(most, std::numbers::pi / 2 * 0.9, 0.02);
  // It turns round gently: a frame before the end it hardly moves.
  const auto step = [&](size_t i) {
    return length(path.frames[i + 1].camera_to_world.translation -
                  path.frames[i].camera_to_world.translation);
  };
  EXPECT_LT(step(14), 0.1 * step(0));
}

TEST(CameraPath, OrbitOfAForwardFacingCaptureIsASmallSwing) {
  const ModelInfo info = forward_facing(12);
  const CameraPath path = make_camera_path(info, PathKind::kOrbit, {30, 30});
  expect_sound(path, 30);
  expect_level(info, path);
  for (const PathFrame& f : path.frames) {
    const Pose pose = engine_pose(info, f);
    EXPECT_LT(length(pose.translation - Vec3d{0, -2, 0}), 0.5) << f.name;
    EXPECT_GT(pose.rotation.column(2).y, 0.9) << f.name;
  }
}

TEST(CameraPath, PanoramaLooksOutward) {
  ModelInfo info = ring(12);
  for (ModelView& view : info.views) {  // turn every camera around its y axis by half a turn
    Mat3d& r = view.pose.rotation;
    r.set_column(0, -r.column(0));
    r.set_column(2, -r.column(2));
  }
  const CameraPath path = make_camera_path(info, PathKind::kOrbit, {12, 30});
  expect_sound(path, 12);
  expect_level(info, path);
  for (const PathFrame& f : path.frames) {
    const Pose pose = engine_pose(info, f);
    EXPECT_GT(dot(pose.rotation.column(2), pose.translation - Vec3d{0.2, -0.1, 0.3}), 0);
  }
}

// Cameras 1 and 3 from the axis, all at height 1: their mean squared distance is 5 + 1.
TEST(CameraPath, SpherifiedIsALevelCircleOnTheCamerasSphere) {
  ModelInfo info;
  info.to_engine = skewed_frame();
  const Vec3d target{0.2, -0.1, 0.3};
  for (int i = 0; i < 12; ++i) {
    const double a = 2 * std::numbers::pi * i / 12, radius = i % 2 ? 1 : 3;
    const Vec3d position = target + Vec3d{radius * std::cos(a), radius * std::sin(a), 1};
    add(info, {look_rotation(target - position, {0.1, 0, 1}), position});
  }
  const CameraPath path = make_camera_path(info, PathKind::kSpherified, {16, 30});
  expect_sound(path, 16);
  expect_level(info, path);
  EXPECT_EQ(path.frames[3].name, "spherified_0003");
  for (size_t i = 0; i < path.frames.size(); ++i) {
    const Pose pose = engine_pose(info, path.frames[i]);
    const Vec3d from = pose.translation - target;
    EXPECT_NEAR(std::hypot(from.x, from.y), std::sqrt(5), 1e-6);
    EXPECT_NEAR(from.z, 1, 1e-6);
    EXPECT_LT(length(pose.rotation.column(2) + normalized(from)), 1e-6) << "looks elsewhere";
    EXPECT_NEAR(
        std::cos(std::atan2(from.y, from.x) - 2 * std::numbers::pi * static_cast<double>(i) / 16),
        1, 1e-9);
  }
}

TEST(CameraPath, EllipseFitsTheCameras) {
  ModelInfo info;
  info.to_engine = skewed_frame();
  const double slant = 0.6;
  for (int i = 0; i < 40; ++i) {  // axes 3 and 1.5, turned by `slant`
    const double a = 2 * std::numbers::pi * i / 40;
    const double x = 3 * std::cos(a), y = 1.5 * std::sin(a);
    const Vec3d p{x * std::cos(slant) - y * std::sin(slant),
                  x * std::sin(slant) + y * std::cos(slant), 0.5};
    add(info, {look_rotation(-p, {0, 0, 1}), p});
  }
  const CameraPath path = make_camera_path(info, PathKind::kEllipse, {200, 30});
  expect_sound(path, 200);
  expect_level(info, path);
  double longest = 0, shortest = 10, step_least = 10, step_most = 0;
  Vec3d far_end;
  for (size_t i = 0; i < path.frames.size(); ++i) {
    const Pose pose = engine_pose(info, path.frames[i]);
    EXPECT_NEAR(pose.translation.z, 0.5, 1e-9);
    EXPECT_LT(length(pose.rotation.column(2) + normalized(pose.translation)), 1e-6);
    const double r = std::hypot(pose.translation.x, pose.translation.y);
    if (r > longest) far_end = pose.translation;
    longest = std::max(longest, r);
    shortest = std::min(shortest, r);
    const Vec3d next = engine_pose(info, path.frames[(i + 1) % 200]).translation;
    step_least = std::min(step_least, length(next - pose.translation));
    step_most = std::max(step_most, length(next - pose.translation));
  }
  EXPECT_NEAR(longest, 3, 0.15);
  EXPECT_NEAR(shortest, 1.5, 0.1);
  EXPECT_NEAR(std::abs(std::atan(far_end.y / far_end.x)), slant, 0.05);
  EXPECT_LT(step_most / step_least, 1.01) << "constant speed";
}

TEST(CameraPath, SpiralStaysAmongForwardFacingCameras) {
  const ModelInfo info = forward_facing(12);
  const CameraPath path = make_camera_path(info, PathKind::kSpiral, {60, 30});
  expect_sound(path, 60);
  expect_level(info, path);
  double widest = 0;
  for (const PathFrame& f : path.frames) {
    const Pose pose = engine_pose(info, f);
    widest = std::max(widest, length(pose.translation - Vec3d{0, -2, 0}));
    EXPECT_GT(pose.rotation.column(2).y, 0.95) << f.name;
  }
  EXPECT_GT(widest, 0.1);
  EXPECT_LT(widest, 0.4);
  // Of cameras all around it stays near the first one.
  const ModelInfo around = ring(12);
  const CameraPath near_first = make_camera_path(around, PathKind::kSpiral, {60, 30});
  expect_sound(near_first, 60);
  const Vec3d first = around.to_engine.apply(around.views[0].pose).translation;
  for (const PathFrame& f : near_first.frames)
    EXPECT_LT(length(engine_pose(around, f).translation - first), 0.25 * std::sqrt(5.0));
}

}  // namespace
}  // namespace nerf
