// Specification of the view code: real spherical harmonics of degree 0 to 3.
#pragma once

#include <array>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// Y_l^m(x, y, z) at index l (l + 1) + m, orthonormal over the sphere, with the Condon-Shortley
// phase
// (-1)^m: sin(|m| phi) for m < 0, cos(m phi) for m > 0. (x, y, z) is of unit length; nothing is
// normalised here.
template <class T>
std::array<T, 16> spherical_harmonics(T x, T y, T z) {
  const double pi = 3.14159265358979323846;
  // sqrt(a / (b pi))
  const auto root = [pi](double a, double b) { return T(std::sqrt(a / (b * pi))); };
  const T xx = x * x, yy = y * y, zz = z * z;
  return {
      root(1, 4),
      -root(3, 4) * y,
      root(3, 4) * z,
      -root(3, 4) * x,
      root(15, 4) * x * y,
      -root(15, 4) * y * z,
      root(5, 16) * (T(3) * zz - T(1)),
      -root(15, 4) * x * z,
      root(15, 16) * (xx - yy),
      -root(35, 32) * y * (T(3) * xx - yy),
      root(105, 4) * x * y * z,
      -root(21, 32) * y * (T(5) * zz - T(1)),
      root(7, 16) * z * (T(5) * zz - T(3)),
      -root(21, 32) * x * (T(5) * zz - T(1)),
      root(105, 16) * z * (xx - yy),
      -root(35, 32) * x * (xx - T(3) * yy),
  };
}

}  // namespace nerf::reference
