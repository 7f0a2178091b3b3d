// Contraction of unbounded space (Barron et al. 2022, equation 10): the unit ball stays, everything
// outside it is drawn into the shell between radius 1 and 2.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "nerf/math/vec.h"

namespace nerf {

template <class T>
TVec3<T> contract(const TVec3<T>& x) {
  const T r2 = dot(x, x);
  if (!(r2 > T(1))) return x;
  if (r2 > std::numeric_limits<T>::max()) {  // its square is infinite, and 1 / |x| nothing beside 2
    const TVec3<T> d = x / std::max({std::fabs(x.x), std::fabs(x.y), std::fabs(x.z)});
    return d * (T(2) / length(d));
  }
  const T r = std::sqrt(r2);
  return x * ((T(2) - T(1) / r) / r);
}

// Jacobian of contract() at x: a I + b x x^T (from its form; eigenvalues 1 / r^2 along x and
// (2 r - 1) / r^2 across, r = |x| > 1).
template <class T>
struct ContractionJacobian {
  T a, b;
  TVec3<T> x;
  TVec3<T> operator()(const TVec3<T>& v) const { return v * a + x * (b * dot(x, v)); }
};

template <class T>
ContractionJacobian<T> contraction_jacobian(const TVec3<T>& x) {
  const T r2 = dot(x, x);
  if (!(r2 > T(1))) return {T(1), T(0), x};
  if (r2 > std::numeric_limits<T>::max()) return {T(0), T(0), x};  // nothing moves any more
  const T r = std::sqrt(r2);
  // Written without r^4, which would overflow far out: b x x^T = b r^2 (x / r)(x / r)^T.
  return {(T(2) - T(1) / r) / r, (T(2) - T(2) * r) / r2, x / r};
}

// Inverse for |z| < 2.
template <class T>
TVec3<T> uncontract(const TVec3<T>& z) {
  const T r = length(z);
  if (!(r > T(1))) return z;
  return z / (r * (T(2) - r));
}

}  // namespace nerf
