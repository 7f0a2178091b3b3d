// A view of a box, and how far its rays run inside.
#pragma once

#include <algorithm>

#include "nerf/math/camera.h"
#include "nerf/math/vec.h"
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

}  // namespace nerf::test
