// Specification of the scalar functions of kernels/elementwise.h.
#pragma once

#include <cmath>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// Slope that truncated_exp passes gradients with: that of exp within [-15, 15], constant outside,
// so that an extreme density neither explodes nor goes dead.
inline double truncated_exp_slope(double x) {
  return std::exp(x < -15 ? -15.0 : x > 15 ? 15.0 : x);
}

// exp(min(x, 30)) with the derivative truncated_exp_slope(x), which is not that of the value where
// |x| > 15: a constant for the value plus a term that is 0 and has this slope.
template <class T>
T truncated_exp(T x) {
  using std::exp;
  const double at = static_cast<double>(real_part(x));
  const T value = at > 30 ? T(std::exp(30.0)) : stop_gradient(exp(x));
  return value + T(truncated_exp_slope(at)) * (x - stop_gradient(x));
}

// 1 / (1 + exp(-x)), from the side where exp does not overflow.
template <class T>
T sigmoid(T x) {
  using std::exp;
  if (real_part(x) >= 0) return T(1) / (T(1) + exp(-x));
  const T e = exp(x);
  return e / (T(1) + e);
}

// The derivative of sigmoid from its output y.
template <class T>
T sigmoid_slope(T y) {
  return y * (T(1) - y);
}

// log(1 + exp(x)), from the side where exp does not overflow.
template <class T>
T softplus(T x) {
  using std::exp;
  if (real_part(x) > 0) return x + log1p(exp(-x));
  return log1p(exp(x));
}

}  // namespace nerf::reference
