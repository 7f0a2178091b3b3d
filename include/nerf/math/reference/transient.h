// Specification of rendering what stays beside what only one photo shows, and of the loss that
// learns how far a pixel can be trusted (Martin-Brualla et al. 2021, section 4.2).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "nerf/math/reference/scalar.h"
#include "nerf/math/reference/volume_rendering.h"

namespace nerf::reference {

// A sample of a ray: two kinds of matter, and how uncertain the transient one's colour is.
template <class T>
struct TransientSample {
  T density;
  std::array<T, 3> colour;
  T transient_density;
  std::array<T, 3> transient_colour;
  T deviation;
  T delta;  // length of its interval
};

// Colour over the background, opacity, deviation. Light is stopped by both kinds together,
//   T_i = exp(-sum_{j<i} (static_j + transient_j) delta_j)
// while each gives light by an opacity of its own (equations 6 to 8 and 11 to 12). With
// `opaque_end` the last sample's static matter lets nothing through.
template <class T>
std::array<T, 5> composite_transient(const std::vector<TransientSample<T>>& samples,
                                     const std::array<T, 3>& background, bool opaque_end) {
  using std::exp;
  std::array<T, 5> out{T(0), T(0), T(0), T(0), T(0)};
  T transmittance = T(1);
  for (size_t i = 0; i < samples.size(); ++i) {
    const TransientSample<T>& s = samples[i];
    const bool opaque = opaque_end && i + 1 == samples.size();
    const T stays = opaque ? transmittance : transmittance * opacity(s.density, s.delta);
    const T passes = transmittance * opacity(s.transient_density, s.delta);
    for (size_t k = 0; k < 3; ++k) out[k] += stays * s.colour[k] + passes * s.transient_colour[k];
    out[4] += passes * s.deviation;
    transmittance *= opaque ? T(0) : exp(-(s.density + s.transient_density) * s.delta);
  }
  for (size_t k = 0; k < 3; ++k) out[k] += transmittance * background[k];
  out[3] = T(1) - transmittance;
  return out;
}

// Negative logarithm of the likelihood of three channels that are normally distributed around the
// rendered ones (equation 13), with the standard deviation b = rendered deviation + `least`:
//   scale (sum_k e_k^2 / (2 b^2) + 3 log b)
template <class T>
T uncertain_loss(const std::array<T, 5>& pixel, const std::array<T, 3>& target, T scale,
                 double least) {
  using std::log;
  const T b = pixel[4] + T(least);
  T sum(0);
  for (size_t k = 0; k < 3; ++k) sum += (pixel[k] - target[k]) * (pixel[k] - target[k]);
  return scale * (sum / (T(2) * b * b) + T(3) * log(b));
}

// Three channels' scale times the mean over a ray's samples; 0 without any.
template <class T>
T mean_loss(const std::vector<T>& x, T scale, double factor) {
  T sum(0);
  for (const T& v : x) sum += v;
  return x.empty() ? T(0) : scale * sum * T(3 * factor / static_cast<double>(x.size()));
}

}  // namespace nerf::reference
