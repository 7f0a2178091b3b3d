// A view of a box, and how far its rays run inside.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "nerf/math/camera.h"
#include "nerf/math/vec.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"

namespace nerf::test {

// Length of a ray inside a box by slabs, in double.
inline double length_inside(const Vec3d& origin, const Vec3d& direction, const Box3& box) {
  double t0 = 0, t1 = 1e30;
  for (int i = 0; i < 3; ++i) {
    const double a = (box.min[i] - origin[i]) / direction[i];
    const double b = (box.max[i] - origin[i]) / direction[i];
    t0 = std::max(t0, std::min(a, b));
    t1 = std::min(t1, std::max(a, b));
  }
  return std::max(t1 - t0, 0.0);
}

struct BoxedView {
  Camera camera;
  Pose pose;  // input coordinates
  Box3 box;
};

// From 9 input units before the centre, along z.
inline BoxedView boxed_view(const Similarity& to_engine) {
  BoxedView view{pinhole(40, 30, 40), {}, {}};
  view.pose.translation = to_engine.center + Vec3d{0.3, -0.2, -9};
  view.box = {to_engine.center + Vec3d{-2, -1.5, -2}, to_engine.center + Vec3d{1, 1, 1.5}};
  return view;
}

// Of a medium of density 1 per engine unit that is drawn inside the box alone: opacity
// 1 - exp(-length).
inline void expect_opacity_inside(const BoxedView& view, const Similarity& to_engine,
                                  const Frame& frame) {
  int inside = 0, outside = 0;
  for (int y = 0; y < view.camera.height; ++y)
    for (int x = 0; x < view.camera.width; ++x) {
      const Vec3d direction = normalized(*unproject(view.camera, {x + 0.5, y + 0.5}));
      const double length = length_inside(view.pose.translation, direction, view.box);
      const double got = frame.alpha[static_cast<size_t>(y * view.camera.width + x)];
      // Float positions of about 3 engine units, up to 48 samples.
      EXPECT_NEAR(got, 1 - std::exp(-length * to_engine.scale), 2e-5) << x << ' ' << y;
      (length > 0 ? inside : outside)++;
    }
  EXPECT_GT(inside, 100);
  EXPECT_GT(outside, 100);
}

}  // namespace nerf::test
