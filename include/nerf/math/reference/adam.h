// Specification of Adam (Kingma and Ba 2015, algorithm 1), dense and per row.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

struct AdamOptions {
  double rate = 1e-2, beta1 = 0.9, beta2 = 0.99, epsilon = 1e-15;
  double l2 = 0;  // added to the gradient as l2 * weight
};

// A larger gradient counts as this, with its sign: its square would be infinite in float, and v
// would stay so for ever. A gradient that is not a number stays so.
inline constexpr double kMostGradient = 1e18;
template <class T>
T counted_gradient(T g) {
  const double at = static_cast<double>(real_part(g));
  return at > kMostGradient ? T(kMostGradient) : at < -kMostGradient ? T(-kMostGradient) : g;
}

// Step `step` (counted from 1) of one parameter.
template <class T>
void adam(const AdamOptions& o, int64_t step, T gradient, T& m, T& v, T& weight) {
  using std::sqrt;
  const double t = static_cast<double>(step);
  const T g = counted_gradient(gradient + T(o.l2) * weight);
  m = T(o.beta1) * m + T(1 - o.beta1) * g;
  v = T(o.beta2) * v + T(1 - o.beta2) * (g * g);
  const T m_hat = m / T(1 - std::pow(o.beta1, t));
  const T v_hat = v / T(1 - std::pow(o.beta2, t));
  weight = weight - T(o.rate) * m_hat / (sqrt(v_hat) + T(o.epsilon));
}

// A row of a sparsely used table: without a gradient nothing moves, neither weights nor moments,
// and its own counter of steps, which the bias correction goes by, stands still.
template <class T>
void adam_row(const AdamOptions& o, bool touched, size_t width, const T* gradient, T* m, T* v,
              int64_t& steps, T* weights) {
  if (!touched) return;
  ++steps;
  for (size_t i = 0; i < width; ++i) adam(o, steps, gradient[i], m[i], v[i], weights[i]);
}

}  // namespace nerf::reference
