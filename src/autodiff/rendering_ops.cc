// Volume rendering in two steps, for methods with losses on the weights.
#include <algorithm>
#include <cmath>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

// w_i = T_i alpha_i. With tau_i = density_i delta_i the gradient g of the weights gives
// d / d tau_i = T_{i+1} g_i - sum_{j>i} w_j g_j: more of sample i is seen, less of what is behind.
// Products and sums along a ray are made in double, as in composite_op.cc.
class RenderWeights : public Operation {
 public:
  RenderWeights(Value density, Value delta, Value weights, bool opaque_end)
      : Operation({density, delta}, weights), opaque_end_(opaque_end) {}
  const char* name() const override { return "render_weights"; }

  void forward(Chunk& c) const override {
    float* w = c.data(output());
    opacity(c.samples, c.data(inputs()[0]), c.data(inputs()[1]), w);
    for (int r = 0; r < c.rays; ++r) {
      const int end = c.ray_begin[r + 1];
      if (opaque_end_ && end > c.ray_begin[r]) w[end - 1] = 1;
      double t = 1;
      for (int i = c.ray_begin[r]; i < end; ++i) {
        const double alpha = w[i];
        w[i] = static_cast<float>(t * alpha);
        t *= 1 - alpha;
      }
    }
  }

  void backward(Chunk& c) const override {
    const float* w = c.data(output());
    const float* g = c.gradient(output());
    const float* density = c.data(inputs()[0]);
    const float* delta = c.data(inputs()[1]);
    float* d_density = c.gradient(inputs()[0]);
    NERF_CHECK(overwrites(0));
    for (int r = 0; r < c.rays; ++r) {
      const int begin = c.ray_begin[r];
      int i = c.ray_begin[r + 1];
      if (i == begin) continue;
      const auto length = [&](int k) {
        return static_cast<double>(std::min(delta[k], kLongestInterval));
      };
      const auto seen = [&](int k) {
        return static_cast<double>(w[k]) * static_cast<double>(g[k]);
      };
      double t_after = 0, behind = 0;
      if (opaque_end_) {
        --i;
        d_density[i] = 0;
        behind = seen(i);
        t_after = static_cast<double>(w[i]);
      } else {
        // From the optical depth, so that it does not drift.
        double depth = 0;
        for (int s = begin; s < i; ++s) depth += static_cast<double>(density[s]) * length(s);
        t_after = std::exp(-depth);
      }
      while (i-- > begin) {
        d_density[i] =
            static_cast<float>(length(i) * (t_after * static_cast<double>(g[i]) - behind));
        behind += seen(i);
        t_after = std::min(1.0, t_after + static_cast<double>(w[i]));
      }
    }
    std::fill(d_density + c.ray_begin[c.rays], d_density + round_up(c.samples, kLane), 0.0f);
  }

 private:
  bool opaque_end_;
};

class Accumulate : public Operation {
 public:
  Accumulate(Value weights, Value colour, Value background, Value pixel)
      : Operation({weights, colour, background}, pixel) {}
  const char* name() const override { return "accumulate"; }

  void forward(Chunk& c) const override {
    const int64_t ls = c.stride(inputs()[1]), lr = c.stride(output());
    const float* w = c.data(inputs()[0]);
    const float* rgb = c.data(inputs()[1]);
    const float* background = c.data(inputs()[2]);
    float* pixel = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      double sum[4] = {0, 0, 0, 0};
      for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i) {
        const double weight = w[i];
        for (int k = 0; k < 3; ++k) sum[k] += weight * static_cast<double>(rgb[k * ls + i]);
        sum[3] += weight;
      }
      for (int k = 0; k < 3; ++k)
        pixel[k * lr + r] =
            static_cast<float>(sum[k] + (1 - sum[3]) * static_cast<double>(background[k * lr + r]));
      pixel[3 * lr + r] = static_cast<float>(sum[3]);
    }
  }

  void backward(Chunk& c) const override {
    const int64_t ls = c.stride(inputs()[1]), lr = c.stride(output());
    const float* w = c.data(inputs()[0]);
    const float* rgb = c.data(inputs()[1]);
    const float* background = c.data(inputs()[2]);
    const float* dp = c.gradient(output());
    float* dw = c.tape->needs_gradient(inputs()[0]) ? c.gradient(inputs()[0]) : nullptr;
    float* d_rgb = c.tape->needs_gradient(inputs()[1]) ? c.gradient(inputs()[1]) : nullptr;
    NERF_CHECK(overwrites(1));
    const int64_t padded = round_up(c.samples, kLane);
    if (dw && overwrites(0)) std::fill(dw, dw + padded, 0.0f);
    for (int r = 0; r < c.rays; ++r) {
      const float g[3] = {dp[r], dp[lr + r], dp[2 * lr + r]};
      const float rest = dp[3 * lr + r] - g[0] * background[r] - g[1] * background[lr + r] -
                         g[2] * background[2 * lr + r];
      for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i) {
        if (dw) dw[i] += g[0] * rgb[i] + g[1] * rgb[ls + i] + g[2] * rgb[2 * ls + i] + rest;
        if (d_rgb)
          for (int k = 0; k < 3; ++k) d_rgb[k * ls + i] = w[i] * g[k];
      }
    }
    if (d_rgb)
      for (int k = 0; k < 3; ++k)
        std::fill(d_rgb + k * ls + c.ray_begin[c.rays], d_rgb + k * ls + padded, 0.0f);
  }
};

}  // namespace

Value render_weights(Tape& tape, Value density, Value delta, bool opaque_end) {
  NERF_CHECK_EQ(tape.rows(density), 1);
  NERF_CHECK_EQ(tape.rows(delta), 1);
  NERF_CHECK(!tape.needs_gradient(delta));  // not trained
  const Value weights = tape.output(1, Domain::kSamples, {&density, 1});
  tape.record(std::make_unique<RenderWeights>(density, delta, weights, opaque_end));
  return weights;
}

Value accumulate(Tape& tape, Value weights, Value colour, Value background) {
  NERF_CHECK_EQ(tape.rows(weights), 1);
  NERF_CHECK_EQ(tape.rows(colour), 3);
  NERF_CHECK_EQ(tape.rows(background), 3);
  NERF_CHECK(!tape.needs_gradient(background));  // not trained
  const Value from[] = {weights, colour};
  const Value pixel = tape.output(4, Domain::kRays, from);
  tape.record(std::make_unique<Accumulate>(weights, colour, background, pixel));
  return pixel;
}

}  // namespace nerf
