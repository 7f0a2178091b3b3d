// Specification of volume rendering by quadrature (Mildenhall et al. 2020, equation 3).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// Share of light that an interval stops: 1 - exp(-density * length).
template <class T>
T opacity(T density, T length) {
  return -expm1(-density * length);
}

// Weights of the samples, w_i = T_i (1 - exp(-density_i length_i)); with `opaque_end` the last one
// takes all that is left.
template <class T>
std::vector<T> render_weights(const std::vector<T>& density, const std::vector<T>& delta,
                              bool opaque_end) {
  using std::exp;
  std::vector<T> weights;
  T transmittance = T(1);
  for (size_t i = 0; i < density.size(); ++i) {
    const bool opaque = opaque_end && i + 1 == density.size();
    weights.push_back(opaque ? transmittance : transmittance * opacity(density[i], delta[i]));
    transmittance *= exp(-density[i] * delta[i]);
  }
  return weights;
}

template <class T>
struct RenderedRay {
  std::array<T, 4> pixel;  // colour over the background, opacity
  std::vector<T> weights;  // of the samples; they and the light that is left add up to 1
};

// Samples from front to back: density and interval length, three colour channels each.
template <class T>
RenderedRay<T> composite(const std::vector<T>& density, const std::vector<std::array<T, 3>>& colour,
                         const std::vector<T>& delta, const std::array<T, 3>& background) {
  RenderedRay<T> out{{T(0), T(0), T(0), T(0)}, {}};
  using std::exp;
  T transmittance = T(1);
  for (size_t i = 0; i < density.size(); ++i) {
    out.weights.push_back(transmittance * opacity(density[i], delta[i]));
    for (size_t k = 0; k < 3; ++k) out.pixel[k] += out.weights[i] * colour[i][k];
    transmittance *= exp(-density[i] * delta[i]);  // 1 - opacity
  }
  for (size_t k = 0; k < 3; ++k) out.pixel[k] += transmittance * background[k];
  out.pixel[3] = T(1) - transmittance;
  return out;
}

// The second half of composite(): colour over the background, which shows where the weights do not
// add up to 1, and the sum of the weights.
template <class T>
std::array<T, 4> accumulate(const std::vector<T>& weights,
                            const std::vector<std::array<T, 3>>& colour,
                            const std::array<T, 3>& background) {
  std::array<T, 4> pixel{T(0), T(0), T(0), T(0)};
  for (size_t i = 0; i < weights.size(); ++i) {
    for (size_t k = 0; k < 3; ++k) pixel[k] += weights[i] * colour[i][k];
    pixel[3] += weights[i];
  }
  for (size_t k = 0; k < 3; ++k) pixel[k] += (T(1) - pixel[3]) * background[k];
  return pixel;
}

// The two steps of accumulate() apart, for a colour that is found once for a ray. Sums over a ray's
// samples of weight times x [samples][rows]; then the sum of the weights, the ray's opacity.
template <class T>
std::vector<T> sum_along_ray(const std::vector<T>& weights, const std::vector<std::vector<T>>& x,
                             size_t rows) {
  std::vector<T> sum(rows + 1, T(0));
  for (size_t i = 0; i < weights.size(); ++i) {
    for (size_t k = 0; k < rows; ++k) sum[k] += weights[i] * x[i][k];
    sum[rows] += weights[i];
  }
  return sum;
}

// opacity colour + (1 - opacity) background; opacity.
template <class T>
std::array<T, 4> over(const std::array<T, 3>& colour, T opacity,
                      const std::array<T, 3>& background) {
  std::array<T, 4> pixel;
  for (size_t k = 0; k < 3; ++k) pixel[k] = opacity * colour[k] + (T(1) - opacity) * background[k];
  pixel[3] = opacity;
  return pixel;
}

// Numbers of successive samples of a ray that share a colour: as many as have at most `most` of the
// light together, or one that has more by itself, up to the first that less than `stop` reaches.
// What is behind belongs to none.
template <class T>
std::vector<size_t> light_groups(const std::vector<T>& weights, double most, double stop) {
  std::vector<size_t> sizes;
  double light = 0, left = 1;
  for (const T& w : weights) {
    const double weight = real_part(w);
    if (left < stop) break;
    if (sizes.empty() || light + weight > most) {
      sizes.push_back(0);
      light = 0;
    }
    ++sizes.back();
    light += weight;
    left -= weight;
  }
  return sizes;
}

// What a sample counts in the mean of a group besides its light, so that one without light has a
// mean too.
inline constexpr double kLeastLight = 1e-10;

// Mean of x over `count` samples from `first` on, weighted by their light.
template <class T>
T mean_by_light(const std::vector<T>& weights, const std::vector<T>& x, size_t first,
                size_t count) {
  T light(0), sum(0);
  for (size_t i = first; i < first + count; ++i) {
    light += weights[i] + T(kLeastLight);
    sum += (weights[i] + T(kLeastLight)) * x[i];
  }
  return sum / light;
}

// Gradient of g . pixel with respect to densities and colours. With the light T_{i+1} that leaves
// sample i and all that the samples j > i and the background add, A_i:
//   d / d density_i = delta_i (T_{i+1} (c_i . g) - A_i),   d / d c_i = w_i g
// where opacity takes part as a fourth channel of colour 1 over a background of 0.
template <class T>
void composite_backward(const std::vector<T>& density, const std::vector<std::array<T, 3>>& colour,
                        const std::vector<T>& delta, const std::array<T, 3>& background,
                        const std::array<T, 4>& g, std::vector<T>& d_density,
                        std::vector<std::array<T, 3>>& d_colour) {
  using std::exp;
  const size_t n = density.size();
  const auto along_g = [&](const std::array<T, 3>& c) {
    return c[0] * g[0] + c[1] * g[1] + c[2] * g[2];
  };
  std::vector<T> left(n + 1, T(1));  // light in front of sample i
  for (size_t i = 0; i < n; ++i) left[i + 1] = left[i] * exp(-density[i] * delta[i]);
  d_density.assign(n, T(0));
  d_colour.assign(n, {});
  T behind = left[n] * along_g(background);
  for (size_t i = n; i-- > 0;) {
    const T weight = left[i] * opacity(density[i], delta[i]);
    const T seen = along_g(colour[i]) + g[3];
    d_density[i] = delta[i] * (left[i + 1] * seen - behind);
    for (size_t k = 0; k < 3; ++k) d_colour[i][k] = weight * g[k];
    behind += weight * seen;
  }
}

}  // namespace nerf::reference
