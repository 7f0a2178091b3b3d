// Specification of the losses on the weights of a ray (parts/losses.h), term by term.
#pragma once

#include <cstddef>
#include <vector>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// sum_ij w_i w_j |m_i - m_j| + 1/3 sum_i w_i^2 d_i of intervals with middles m and widths d (Barron
// et al. 2022, equation 15).
template <class T>
T distortion_loss(const std::vector<double>& middles, const std::vector<double>& widths,
                  const std::vector<T>& w) {
  T sum(0);
  for (size_t i = 0; i < w.size(); ++i) {
    for (size_t j = 0; j < w.size(); ++j) {
      const double apart = middles[i] - middles[j];
      sum += w[i] * w[j] * T(apart < 0 ? -apart : apart);
    }
    sum += w[i] * w[i] * T(widths[i] / 3);
  }
  return sum;
}

// The same for the bins between edges s.
template <class T>
T distortion_loss(const std::vector<double>& s, const std::vector<T>& w) {
  std::vector<double> middles, widths;
  for (size_t i = 0; i < w.size(); ++i) {
    middles.push_back(0.5 * (s[i] + s[i + 1]));
    widths.push_back(s[i + 1] - s[i]);
  }
  return distortion_loss(middles, widths, w);
}

// sum_i w_i c(m_i) + (1 - sum_i w_i) c(1), c(m) = max(0, |m - depth| - tolerance depth (1 -
// depth)): how far light is from where a sensor says that it ends.
template <class T>
T depth_loss(const std::vector<double>& middles, const std::vector<T>& w, double depth,
             double tolerance) {
  const auto cost = [&](double m) {
    const double apart = m < depth ? depth - m : m - depth;
    const double beyond = apart - tolerance * depth * (1 - depth);
    return T(beyond > 0 ? beyond : 0);
  };
  T sum(0), left(1);
  for (size_t i = 0; i < w.size(); ++i) {
    sum += w[i] * cost(middles[i]);
    left = left - w[i];
  }
  return sum + left * cost(1);
}

// sum_i max(0, w_i - bound_i)^2 / (w_i + epsilon), bound_i the weight of all proposal bins that
// overlap bin i (Barron et al. 2022, equation 13); bins that touch at one point overlap where the
// point is the later one's start.
template <class T>
T interlevel_loss(const std::vector<double>& s, const std::vector<double>& w,
                  const std::vector<double>& proposal_s, const std::vector<T>& proposal_w,
                  double epsilon) {
  T sum(0);
  for (size_t i = 0; i < w.size(); ++i) {
    T bound(0);
    for (size_t j = 0; j < proposal_w.size(); ++j)
      if (proposal_s[j + 1] > s[i] && proposal_s[j] <= s[i + 1]) bound += proposal_w[j];
    if (real_part(bound) < w[i]) {
      const T missing = T(w[i]) - bound;
      sum += missing * missing * T(1 / (w[i] + epsilon));
    }
  }
  return sum;
}

}  // namespace nerf::reference
