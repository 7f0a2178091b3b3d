// Light along one ray, forward and backward, for the operations that composite.
//
// Products and sums along a ray are made in double: 1 - alpha in float is off by half a unit in the
// last place of 1, always the same way where samples are alike, and a million of them lose or gain
// percents of the light.
#pragma once

#include <algorithm>
#include <cmath>

#include "nerf/kernels/elementwise.h"

namespace nerf::internal {

// Turns the opacities of samples [begin, end) into weights w_i = T_i alpha_i, in place, and calls
// body(i, weight before it is rounded). Returns the light that is left.
template <class Body>
double weights_from_opacities(Real* w, int begin, int end, const Body& body) {
  double t = 1;
  for (int i = begin; i < end; ++i) {
    const double alpha = w[i], weight = t * alpha;
    w[i] = static_cast<Real>(weight);
    body(i, weight);
    t *= 1 - alpha;
  }
  return t;
}

inline double interval_length(Real delta) {
  return static_cast<double>(std::min(delta, kLongestInterval));
}

// Light that samples [begin, end) let through, from the optical depth so that it does not drift.
inline double light_through(const Real* density, const Real* delta, int begin, int end) {
  double depth = 0;
  for (int i = begin; i < end; ++i)
    depth += static_cast<double>(density[i]) * interval_length(delta[i]);
  return std::exp(-depth);
}

// With g_i = gradient(i), the loss's derivative by weight i, `behind` what everything behind the
// samples adds to the loss and `t` the light that reaches it:
//   d / d density_i = delta_i (T_{i+1} g_i - sum_{j>i} w_j g_j - behind),
// since more of sample i is seen and less of what is behind it.
template <class Gradient>
void density_gradients(const Real* w, const Real* delta, int begin, int end, double t,
                       double behind, const Gradient& gradient, Real* d_density) {
  for (int i = end; i-- > begin;) {
    const double g = gradient(i), weight = static_cast<double>(w[i]);
    d_density[i] = static_cast<Real>(interval_length(delta[i]) * (t * g - behind));
    behind += weight * g;
    t = std::min(1.0, t + weight);
  }
}

}  // namespace nerf::internal
