// Volume rendering in two steps, for methods with losses on the weights.
#include <algorithm>

#include "autodiff/ray_rows.h"
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
    render_weights_forward(internal::rays_of(c, inputs()[0]), opaque_end_, w);
  }

  void backward(Chunk& c) const override {
    NERF_CHECK(overwrites(0));
    Real* d_density = c.gradient(inputs()[0]);
    render_weights_backward(internal::rays_of(c, inputs()[0]), opaque_end_, c.data(inputs()[0]),
                            c.data(inputs()[1]), c.data(output()), c.gradient(output()), d_density);
    internal::clear_padding(c, inputs()[0], d_density);
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
    accumulate_forward(internal::rays_of(c, inputs()[0]), c.data(inputs()[0]),
                       internal::data_rows(c, inputs()[1]), internal::data_rows(c, inputs()[2]),
                       {c.data(output()), c.stride(output())});
  }

  void backward(Chunk& c) const override {
    NERF_CHECK(overwrites(1));
    Real* dw = c.tape->needs_gradient(inputs()[0]) ? c.gradient(inputs()[0]) : nullptr;
    ColourRows<Real> d_colour = {};
    if (c.tape->needs_gradient(inputs()[1])) d_colour = internal::gradient_rows(c, inputs()[1]);
    if (dw && overwrites(0)) std::fill(dw, dw + round_up(c.count(inputs()[0]), kLane), 0.0_r);
    accumulate_backward(internal::rays_of(c, inputs()[0]), c.data(inputs()[0]),
                        internal::data_rows(c, inputs()[1]), internal::data_rows(c, inputs()[2]),
                        {c.gradient(output()), c.stride(output())}, dw, d_colour);
    for (int k = 0; k < 3 && d_colour.data; ++k)
      internal::clear_padding(c, inputs()[1], d_colour.row(k));
  }
};

class SumAlongRays : public Operation {
 public:
  SumAlongRays(Value weights, Value x, Value y) : Operation({weights, x}, y) {}
  const char* name() const override { return "sum_along_rays"; }

  void forward(Chunk& c) const override {
    const int64_t ls = c.stride(inputs()[1]), lr = c.stride(output());
    const int rows = c.tape->rows(inputs()[1]);
    const Real* w = c.data(inputs()[0]);
    const Real* x = c.data(inputs()[1]);
    Real* y = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      const int begin = c.ray_begin[r], end = c.ray_begin[r + 1];
      double opacity = 0;
      for (int i = begin; i < end; ++i) opacity += static_cast<double>(w[i]);
      for (int k = 0; k < rows; ++k) {
        double sum = 0;
        for (int i = begin; i < end; ++i)
          sum += static_cast<double>(w[i]) * static_cast<double>(x[k * ls + i]);
        y[k * lr + r] = static_cast<Real>(sum);
      }
      y[rows * lr + r] = static_cast<Real>(opacity);
    }
  }

  void backward(Chunk& c) const override {
    const int64_t ls = c.stride(inputs()[1]), lr = c.stride(output());
    const int rows = c.tape->rows(inputs()[1]);
    const Real* w = c.data(inputs()[0]);
    const Real* x = c.data(inputs()[1]);
    const Real* dy = c.gradient(output());
    Real* dw = c.tape->needs_gradient(inputs()[0]) ? c.gradient(inputs()[0]) : nullptr;
    Real* dx = c.tape->needs_gradient(inputs()[1]) ? c.gradient(inputs()[1]) : nullptr;
    const int64_t padded = round_up(c.samples, kLane);
    if (dw && overwrites(0)) std::fill(dw, dw + padded, 0.0_r);
    for (int k = 0; k < rows && dx && overwrites(1); ++k)
      std::fill(dx + k * ls, dx + k * ls + padded, 0.0_r);
    for (int r = 0; r < c.rays; ++r)
      for (int k = 0; k <= rows; ++k) {
        const Real g = dy[k * lr + r];
        const bool opacity = k == rows;
        for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i) {
          if (dw) dw[i] += opacity ? g : g * x[k * ls + i];
          if (dx && !opacity) dx[k * ls + i] += w[i] * g;
        }
      }
  }
};

class Over : public Operation {
 public:
  Over(Value colour, Value opacity, Value background, Value pixel)
      : Operation({colour, opacity, background}, pixel) {}
  const char* name() const override { return "over"; }

  void forward(Chunk& c) const override {
    const int64_t lr = c.stride(output());
    const Real* colour = c.data(inputs()[0]);
    const Real* opacity = c.data(inputs()[1]);
    const Real* background = c.data(inputs()[2]);
    Real* pixel = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      for (int k = 0; k < 3; ++k)
        pixel[k * lr + r] =
            opacity[r] * colour[k * lr + r] + (1 - opacity[r]) * background[k * lr + r];
      pixel[3 * lr + r] = opacity[r];
    }
  }

  void backward(Chunk& c) const override {
    const int64_t lr = c.stride(output());
    const Real* colour = c.data(inputs()[0]);
    const Real* opacity = c.data(inputs()[1]);
    const Real* background = c.data(inputs()[2]);
    const Real* dp = c.gradient(output());
    Real* d_colour = c.tape->needs_gradient(inputs()[0]) ? c.gradient(inputs()[0]) : nullptr;
    Real* d_opacity = c.tape->needs_gradient(inputs()[1]) ? c.gradient(inputs()[1]) : nullptr;
    const int64_t padded = round_up(c.rays, kLane);
    if (d_opacity && overwrites(1)) std::fill(d_opacity, d_opacity + padded, 0.0_r);
    for (int k = 0; k < 3 && d_colour && overwrites(0); ++k)
      std::fill(d_colour + k * lr, d_colour + k * lr + padded, 0.0_r);
    for (int r = 0; r < c.rays; ++r) {
      Real sum = dp[3 * lr + r];
      for (int k = 0; k < 3; ++k) {
        const Real g = dp[k * lr + r];
        sum += g * (colour[k * lr + r] - background[k * lr + r]);
        if (d_colour) d_colour[k * lr + r] += opacity[r] * g;
      }
      if (d_opacity) d_opacity[r] += sum;
    }
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
  NERF_CHECK(tape.domain(weights) == tape.domain(colour));
  NERF_CHECK(!tape.needs_gradient(background));  // not trained
  const Value from[] = {weights, colour};
  const Value pixel = tape.output(4, Domain::kRays, from);
  tape.record(std::make_unique<Accumulate>(weights, colour, background, pixel));
  return pixel;
}

Value sum_along_rays(Tape& tape, Value weights, Value x) {
  NERF_CHECK_EQ(tape.rows(weights), 1);
  NERF_CHECK(tape.domain(weights) == Domain::kSamples && tape.domain(x) == Domain::kSamples);
  const Value from[] = {weights, x};
  const Value y = tape.output(tape.rows(x) + 1, Domain::kRays, from);
  tape.record(std::make_unique<SumAlongRays>(weights, x, y));
  return y;
}

Value over(Tape& tape, Value colour, Value opacity, Value background) {
  NERF_CHECK_EQ(tape.rows(colour), 3);
  NERF_CHECK_EQ(tape.rows(opacity), 1);
  NERF_CHECK_EQ(tape.rows(background), 3);
  for (const Value v : {colour, opacity, background}) NERF_CHECK(tape.domain(v) == Domain::kRays);
  NERF_CHECK(!tape.needs_gradient(background));  // not trained
  const Value from[] = {colour, opacity};
  const Value pixel = tape.output(4, Domain::kRays, from);
  tape.record(std::make_unique<Over>(colour, opacity, background, pixel));
  return pixel;
}

}  // namespace nerf
