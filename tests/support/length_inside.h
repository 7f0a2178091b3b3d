// How far a ray runs inside a box.
#pragma once

#include <algorithm>

#include "nerf/math/vec.h"

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

}  // namespace nerf::test
