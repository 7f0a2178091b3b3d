#include "nerf/kernels/encoding.h"

#include <algorithm>

#include "nerf/kernels/linear.h"
#include "nerf/math/reference/encoding.h"
#include "nerf/math/reference/spherical_harmonics.h"

namespace nerf {

void sine_cosine_forward(int64_t n, const Real* x, const Real* variance, Real frequency,
                         Real weight, Real* sine, Real* cosine) {
  const int64_t end = round_up(n, kLane);
  for (int64_t i = 0; i < end; ++i) {
    // What stands in the padding may be below 0 and must stay finite.
    const Real spread = variance ? std::max(variance[i], 0.0_r) : 0.0_r;
    const auto both = reference::sine_cosine(x[i], spread, frequency, weight);
    sine[i] = both[0];
    cosine[i] = both[1];
  }
}

void sine_cosine_backward(int64_t n, const Real* sine, const Real* cosine, const Real* d_sine,
                          const Real* d_cosine, Real frequency, Real* dx, Real* dvariance) {
  const int64_t end = round_up(n, kLane);
  const Real half_square = 0.5_r * frequency * frequency;
  for (int64_t i = 0; i < end; ++i) {
    dx[i] += frequency * (cosine[i] * d_sine[i] - sine[i] * d_cosine[i]);
    if (dvariance) dvariance[i] -= half_square * (sine[i] * d_sine[i] + cosine[i] * d_cosine[i]);
  }
}

void spherical_harmonics(int64_t n, const Real* direction, int64_t direction_stride, Real* code,
                         int64_t code_stride) {
  const int64_t end = round_up(n, kLane);
  for (int64_t i = 0; i < end; ++i) {
    const auto values = reference::spherical_harmonics(
        direction[i], direction[direction_stride + i], direction[2 * direction_stride + i]);
    for (int k = 0; k < kSphericalHarmonics; ++k)
      code[k * code_stride + i] = values[static_cast<size_t>(k)];
  }
}

}  // namespace nerf
