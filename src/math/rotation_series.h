// What the exponentials of rotations and rigid motions share.
#pragma once

#include <cmath>

#include "nerf/math/vec.h"

namespace nerf::internal {

// Quotients of sines by powers of an angle, of its square; exact to rounding for small angles too.

// (1 - cos x) / x^2.
inline double cosine_ratio(double x2) {
  if (x2 < 1e-4) return 0.5 - x2 / 24 + x2 * x2 / 720;
  const double half = std::sin(0.5 * std::sqrt(x2));
  return 2 * half * half / x2;
}

// (x - sin x) / x^3.
inline double sine_ratio(double x2) {
  if (x2 < 1e-2) return 1.0 / 6 - x2 / 120 + x2 * x2 / 5040 - x2 * x2 * x2 / 362880;
  const double x = std::sqrt(x2);
  return (x - std::sin(x)) / (x2 * x);
}

// The generator of the rotation w applied twice: w x (w x v).
inline Vec3d turned_twice(const Vec3d& w, const Vec3d& v) { return cross(w, cross(w, v)); }

}  // namespace nerf::internal
