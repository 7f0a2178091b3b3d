// Volume rendering in two steps, for methods with losses on the weights.
#include <algorithm>

#include "autodiff/light.h"
#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

class RenderWeights : public Operation {
 public:
  RenderWeights(Value density, Value delta, Value weights, bool opaque_end)
      : Operation({density, delta}, weights), opaque_end_(opaque_end) {}
  const char* name() const override { return "render_weights"; }

  void forward(Chunk& c) const override {
    Real* w = c.data(output());
    opacity(c.samples, c.data(inputs()[0]), c.data(inputs()[1]), w);
    for (int r = 0; r < c.rays; ++r) {
      const int end = c.ray_begin[r + 1];
      if (opaque_end_ && end > c.ray_begin[r]) w[end - 1] = 1;
      internal::weights_from_opacities(w, c.ray_begin[r], end, [](int, double) {});
    }
  }

  void backward(Chunk& c) const override {
    const Real* w = c.data(output());
    const Real* g = c.gradient(output());
    const Real* density = c.data(inputs()[0]);
    const Real* delta = c.data(inputs()[1]);
    Real* d_density = c.gradient(inputs()[0]);
    NERF_CHECK(overwrites(0));
    for (int r = 0; r < c.rays; ++r) {
      const int begin = c.ray_begin[r];
      int end = c.ray_begin[r + 1];
      if (end == begin) continue;
      const auto gradient = [&](int k) { return static_cast<double>(g[k]); };
      double t = 0, behind = 0;
      if (opaque_end_) {  // the last sample is the end itself, whatever its density
        --end;
        d_density[end] = 0;
        t = static_cast<double>(w[end]);
        behind = t * gradient(end);
      } else {
        t = internal::light_through(density, delta, begin, end);
      }
      internal::density_gradients(w, delta, begin, end, t, behind, gradient, d_density);
    }
    std::fill(d_density + c.ray_begin[c.rays], d_density + round_up(c.samples, kLane), 0.0_r);
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
    const Real* w = c.data(inputs()[0]);
    const Real* rgb = c.data(inputs()[1]);
    const Real* background = c.data(inputs()[2]);
    Real* pixel = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      double sum[4] = {0, 0, 0, 0};
      for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i) {
        const double weight = w[i];
        for (int k = 0; k < 3; ++k) sum[k] += weight * static_cast<double>(rgb[k * ls + i]);
        sum[3] += weight;
      }
      for (int k = 0; k < 3; ++k)
        pixel[k * lr + r] =
            static_cast<Real>(sum[k] + (1 - sum[3]) * static_cast<double>(background[k * lr + r]));
      pixel[3 * lr + r] = static_cast<Real>(sum[3]);
    }
  }

  void backward(Chunk& c) const override {
    const int64_t ls = c.stride(inputs()[1]), lr = c.stride(output());
    const Real* w = c.data(inputs()[0]);
    const Real* rgb = c.data(inputs()[1]);
    const Real* background = c.data(inputs()[2]);
    const Real* dp = c.gradient(output());
    Real* dw = c.tape->needs_gradient(inputs()[0]) ? c.gradient(inputs()[0]) : nullptr;
    Real* d_rgb = c.tape->needs_gradient(inputs()[1]) ? c.gradient(inputs()[1]) : nullptr;
    NERF_CHECK(overwrites(1));
    const int64_t padded = round_up(c.samples, kLane);
    if (dw && overwrites(0)) std::fill(dw, dw + padded, 0.0_r);
    for (int r = 0; r < c.rays; ++r) {
      const Real g[3] = {dp[r], dp[lr + r], dp[2 * lr + r]};
      const Real rest = dp[3 * lr + r] - g[0] * background[r] - g[1] * background[lr + r] -
                        g[2] * background[2 * lr + r];
      for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i) {
        if (dw) dw[i] += g[0] * rgb[i] + g[1] * rgb[ls + i] + g[2] * rgb[2 * ls + i] + rest;
        if (d_rgb)
          for (int k = 0; k < 3; ++k) d_rgb[k * ls + i] = w[i] * g[k];
      }
    }
    if (d_rgb)
      for (int k = 0; k < 3; ++k)
        std::fill(d_rgb + k * ls + c.ray_begin[c.rays], d_rgb + k * ls + padded, 0.0_r);
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
