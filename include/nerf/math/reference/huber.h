// Specification of the Huber loss, scaled so that it equals the squared error near 0.
#pragma once

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// e^2 for |e| <= delta, delta (2 |e| - delta) beyond: value and slope are continuous.
template <class T>
T huber(T e, double delta) {
  const double at = static_cast<double>(real_part(e));
  if (at >= -delta && at <= delta) return e * e;
  return T(delta) * (T(at > 0 ? 2.0 : -2.0) * e - T(delta));
}

inline double huber_slope(double e, double delta) {
  return 2 * (e < -delta ? -delta : e > delta ? delta : e);
}

}  // namespace nerf::reference
