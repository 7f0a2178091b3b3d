#include <algorithm>
#include <cmath>

#include "autodiff/light.h"
#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

// C = sum_i w_i c_i + T_n b with w_i = T_i alpha_i, T_i = prod_{j<i} (1 - alpha_j),
// alpha_i = 1 - exp(-density_i delta_i). With A_i = sum_{j>i} w_j (c_j . g) + T_n (b . g) the
// gradient is d/d density_i = delta_i (T_{i+1} (c_i . g) - A_i): what stands behind a sample is
// dimmed by it. The fourth row, opacity 1 - T_n, behaves as a colour of 1 over a background of 0.
class CompositeOp : public Operation {
 public:
  CompositeOp(Value density, Value colour, Value delta, Value background, Value weights,
              Value pixel)
      : Operation({density, colour, delta, background}, pixel), weights_(weights) {}
  const char* name() const override { return "composite"; }

  void forward(Chunk& c) const override {
    const int64_t ls = c.stride(inputs()[1]), lr = c.stride(output());
    Real* w = c.data(weights_);
    opacity(c.samples, c.data(inputs()[0]), c.data(inputs()[2]), w);
    const Real* rgb = c.data(inputs()[1]);
    const Real* background = c.data(inputs()[3]);
    Real* pixel = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      double sum[3] = {0, 0, 0};
      const double t = internal::weights_from_opacities(w, c.ray_begin[r], c.ray_begin[r + 1],
                                                        [&](int i, double weight) {
                                                          for (int k = 0; k < 3; ++k)
                                                            sum[k] += weight * rgb[k * ls + i];
                                                        });
      for (int k = 0; k < 3; ++k)
        pixel[k * lr + r] = static_cast<Real>(sum[k] + t * background[k * lr + r]);
      pixel[3 * lr + r] = static_cast<Real>(1 - t);
    }
  }

  void backward(Chunk& c) const override {
    const int64_t ls = c.stride(inputs()[1]), lr = c.stride(output());
    const Real* w = c.data(weights_);
    const Real* density = c.data(inputs()[0]);
    const Real* rgb = c.data(inputs()[1]);
    const Real* delta = c.data(inputs()[2]);
    const Real* background = c.data(inputs()[3]);
    const Real* dp = c.gradient(output());
    Real* d_density = c.gradient(inputs()[0]);
    Real* d_rgb = c.gradient(inputs()[1]);
    NERF_CHECK(overwrites(0) && overwrites(1));
    for (int r = 0; r < c.rays; ++r) {
      const double g[4] = {dp[r], dp[lr + r], dp[2 * lr + r], dp[3 * lr + r]};
      const int begin = c.ray_begin[r], end = c.ray_begin[r + 1];
      const double t = internal::light_through(density, delta, begin, end);
      const double behind =
          t * (background[r] * g[0] + background[lr + r] * g[1] + background[2 * lr + r] * g[2]);
      const auto toward = [&](int i) {
        return rgb[i] * g[0] + rgb[ls + i] * g[1] + rgb[2 * ls + i] * g[2] + g[3];
      };
      internal::density_gradients(w, delta, begin, end, t, behind, toward, d_density);
      for (int k = 0; k < 3; ++k)
        for (int i = begin; i < end; ++i)
          d_rgb[k * ls + i] = static_cast<Real>(static_cast<double>(w[i]) * g[k]);
    }
    // Padding columns take no part.
    const int used = c.ray_begin[c.rays];
    const int64_t padded = round_up(c.samples, kLane);
    std::fill(d_density + used, d_density + padded, 0.0_r);
    for (int k = 0; k < 3; ++k) std::fill(d_rgb + k * ls + used, d_rgb + k * ls + padded, 0.0_r);
  }

 private:
  Value weights_;
};

}  // namespace

Composite composite(Tape& tape, Value density, Value colour, Value delta, Value background) {
  NERF_CHECK_EQ(tape.rows(density), 1);
  NERF_CHECK_EQ(tape.rows(colour), 3);
  NERF_CHECK_EQ(tape.rows(background), 3);
  NERF_CHECK(!tape.needs_gradient(delta) && !tape.needs_gradient(background));  // not trained
  const Value from[] = {density, colour};
  const Value weights = tape.output(1, Domain::kSamples, {});
  const Value pixel = tape.output(4, Domain::kRays, from);
  tape.record(std::make_unique<CompositeOp>(density, colour, delta, background, weights, pixel));
  return {pixel, weights};
}

}  // namespace nerf
