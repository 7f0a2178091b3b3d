// Specification of math/contraction.h (Barron et al. 2022, equation 10).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// x inside the unit ball, (2 - 1 / |x|) x / |x| outside: length 2 is at infinity.
template <class T>
std::array<T, 3> contract(const std::array<T, 3>& x) {
  using std::sqrt;
  const T r = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
  if (!(real_part(r) > 1)) return x;
  const T s = (T(2) - T(1) / r) / r;
  return {x[0] * s, x[1] * s, x[2] * s};
}

// Inverse where the length is below 2.
template <class T>
std::array<T, 3> uncontract(const std::array<T, 3>& z) {
  using std::sqrt;
  const T r = sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2]);
  if (!(real_part(r) > 1)) return z;
  const T s = T(1) / (r * (T(2) - r));
  return {z[0] * s, z[1] * s, z[2] * s};
}

}  // namespace nerf::reference
