// What stays and what only one photo shows on the same rays, and the losses of their pixels
// (Martin-Brualla et al. 2021, section 4.2; math/reference/transient.h is the specification).
#include <algorithm>
#include <cmath>

#include "autodiff/ray_rows.h"
#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

double times_length(Real density, Real delta) {
  return static_cast<double>(density) * static_cast<double>(std::min(delta, kLongestInterval));
}

// Rows of the value that is kept for the way back.
enum { kLight, kStatic, kTransient, kKept };

class CompositeTransient : public Operation {
 public:
  CompositeTransient(const TransientMatter& m, Value delta, Value background, Value kept,
                     Value weights, Value pixel, bool opaque_end)
      : Operation({m.density, m.colour, m.transient_density, m.transient_colour, m.deviation, delta,
                   background},
                  pixel),
        kept_(kept),
        weights_(weights),
        opaque_end_(opaque_end) {}
  const char* name() const override { return "composite_transient"; }

  void forward(Chunk& c) const override {
    const Inputs in(*this, c);
    const int64_t lr = c.stride(output());
    Real* const out = c.data(output());
    Real* const weights = c.data(weights_);
    for (int r = 0; r < c.rays; ++r) {
      double light = 1, alone = 1, sum[5] = {};
      for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i) {
        const double clear = clear_of(c, in, r, i);
        const double b = times_length(in.transient_density[i], in.delta[i]);
        const double stays =
            clear == 0 ? 1 : -std::expm1(-times_length(in.density[i], in.delta[i]));
        const double passes = -std::expm1(-b);
        weights[i] = static_cast<Real>(alone * stays);
        alone *= clear;
        in.kept[kLight * in.ls + i] = static_cast<Real>(light);
        in.kept[kStatic * in.ls + i] = static_cast<Real>(stays);
        in.kept[kTransient * in.ls + i] = static_cast<Real>(passes);
        for (int k = 0; k < 3; ++k)
          sum[k] += light * (stays * static_cast<double>(in.colour[k * in.ls + i]) +
                             passes * static_cast<double>(in.transient_colour[k * in.ls + i]));
        sum[4] += light * passes * static_cast<double>(in.deviation[i]);
        light *= clear * std::exp(-b);
      }
      for (int k = 0; k < 3; ++k)
        sum[k] += light * static_cast<double>(in.background[k * in.lb + r]);
      sum[3] = 1 - light;
      for (int k = 0; k < 5; ++k) out[k * lr + r] = static_cast<Real>(sum[k]);
    }
  }

  // With g the gradient of the pixel's rows, and A_i what the samples behind i and the background
  // add to g . pixel:
  //   d / d static_i = delta_i (T_i exp(-static_i delta_i) g . c_i - A_i)
  // and so for the transient density, whose deviation behaves as a fourth channel of colour.
  void backward(Chunk& c) const override {
    const Inputs in(*this, c);
    const int64_t lr = c.stride(output());
    const Real* const g = c.gradient(output());
    Real* const d[5] = {c.gradient(inputs()[0]), c.gradient(inputs()[1]), c.gradient(inputs()[2]),
                        c.gradient(inputs()[3]), c.gradient(inputs()[4])};
    for (int r = 0; r < c.rays; ++r) {
      double by[5], behind = 0;
      for (int k = 0; k < 5; ++k) by[k] = static_cast<double>(g[k * lr + r]);
      const int begin = c.ray_begin[r], end = c.ray_begin[r + 1];
      double left = 1;  // light behind the last sample
      if (end > begin)
        left = static_cast<double>(in.kept[kLight * in.ls + end - 1]) *
               clear_of(c, in, r, end - 1) *
               std::exp(-times_length(in.transient_density[end - 1], in.delta[end - 1]));
      for (int k = 0; k < 3; ++k)
        behind += left * by[k] * static_cast<double>(in.background[k * in.lb + r]);
      behind -= left * by[3];
      for (int i = end; i-- > begin;) {
        const double light = static_cast<double>(in.kept[kLight * in.ls + i]);
        const double stays = static_cast<double>(in.kept[kStatic * in.ls + i]);
        const double passes = static_cast<double>(in.kept[kTransient * in.ls + i]);
        const double length = static_cast<double>(std::min(in.delta[i], kLongestInterval));
        double seen = 0, seen_passing = by[4] * static_cast<double>(in.deviation[i]);
        for (int k = 0; k < 3; ++k) {
          seen += by[k] * static_cast<double>(in.colour[k * in.ls + i]);
          seen_passing += by[k] * static_cast<double>(in.transient_colour[k * in.ls + i]);
          put(1, d[1] + k * in.ls + i, light * stays * by[k]);
          put(3, d[3] + k * in.ls + i, light * passes * by[k]);
        }
        const double clear = clear_of(c, in, r, i);
        const double clear_passing = std::exp(-times_length(in.transient_density[i], in.delta[i]));
        put(0, d[0] + i, length * (light * clear * seen - behind));
        put(2, d[2] + i, length * (light * clear_passing * seen_passing - behind));
        put(4, d[4] + i, light * passes * by[4]);
        behind += light * (stays * seen + passes * seen_passing);
      }
    }
    for (size_t i = 0; i < 5; ++i)
      for (int k = 0; k < c.tape->rows(inputs()[i]) && overwrites(i); ++k)
        internal::clear_padding(c, inputs()[i], d[i] + k * in.ls);
  }

 private:
  struct Inputs {
    Inputs(const CompositeTransient& op, Chunk& c)
        : ls(c.stride(op.inputs()[0])),
          lb(c.stride(op.inputs()[6])),
          density(c.data(op.inputs()[0])),
          colour(c.data(op.inputs()[1])),
          transient_density(c.data(op.inputs()[2])),
          transient_colour(c.data(op.inputs()[3])),
          deviation(c.data(op.inputs()[4])),
          delta(c.data(op.inputs()[5])),
          background(c.data(op.inputs()[6])),
          kept(c.data(op.kept_)) {}
    int64_t ls, lb;  // strides of samples and of rays
    const Real *density, *colour, *transient_density, *transient_colour, *deviation, *delta,
        *background;
    Real* kept;
  };
  // Light that a sample's static matter lets through.
  double clear_of(const Chunk& c, const Inputs& in, int r, int i) const {
    if (opaque_end_ && i + 1 == c.ray_begin[r + 1]) return 0;
    return std::exp(-times_length(in.density[i], in.delta[i]));
  }
  void put(size_t input, Real* at, double gradient) const {
    *at = static_cast<Real>(gradient) + (overwrites(input) ? 0.0_r : *at);
  }
  Value kept_, weights_;
  bool opaque_end_;
};

class UncertainLoss : public Operation {
 public:
  UncertainLoss(Value pixel, Value target, Value scale, Value out, Real least)
      : Operation({pixel, target, scale}, out), least_(least) {}
  const char* name() const override { return "uncertain_loss"; }

  void forward(Chunk& c) const override {
    const int64_t lr = c.stride(output());
    const Real* const p = c.data(inputs()[0]);
    const Real* const scale = c.data(inputs()[2]);
    Real* const out = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      const Real b = p[4 * lr + r] + least_;
      out[r] = scale[r] * (squared_error(c, r) / (2 * b * b) + 3 * std::log(b));
      c.loss += static_cast<double>(out[r]);
    }
  }

  void backward(Chunk& c) const override {
    NERF_CHECK(overwrites(0));
    const int64_t lr = c.stride(output());
    const Real* const p = c.data(inputs()[0]);
    const Real* const t = c.data(inputs()[1]);
    const Real* const scale = c.data(inputs()[2]);
    Real* const dp = c.gradient(inputs()[0]);
    for (int r = 0; r < c.rays; ++r) {
      const Real b = p[4 * lr + r] + least_;
      for (int k = 0; k < 3; ++k)
        dp[k * lr + r] = scale[r] * (p[k * lr + r] - t[k * lr + r]) / (b * b);
      dp[3 * lr + r] = 0;
      dp[4 * lr + r] = scale[r] * (3 - squared_error(c, r) / (b * b)) / b;
    }
    const int64_t padded = round_up(c.rays, kLane);
    for (int k = 0; k < 5; ++k) std::fill(dp + k * lr + c.rays, dp + k * lr + padded, 0.0_r);
  }

 private:
  Real squared_error(Chunk& c, int r) const {
    const int64_t lr = c.stride(output());
    const Real* const p = c.data(inputs()[0]);
    const Real* const t = c.data(inputs()[1]);
    Real sum = 0;
    for (int k = 0; k < 3; ++k) {
      const Real e = p[k * lr + r] - t[k * lr + r];
      sum += e * e;
    }
    return sum;
  }
  Real least_;
};

class MeanLoss : public Operation {
 public:
  MeanLoss(Value x, Value scale, Value out, Real factor)
      : Operation({x, scale}, out), factor_(factor) {}
  const char* name() const override { return "mean_loss"; }

  void forward(Chunk& c) const override {
    const Real* const x = c.data(inputs()[0]);
    Real* const out = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      double sum = 0;
      for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i) sum += static_cast<double>(x[i]);
      out[r] = static_cast<Real>(sum) * of_each(c, r);
      c.loss += static_cast<double>(out[r]);
    }
  }

  void backward(Chunk& c) const override {
    Real* const dx = c.gradient(inputs()[0]);
    if (overwrites(0)) std::fill(dx, dx + round_up(c.samples, kLane), 0.0_r);
    for (int r = 0; r < c.rays; ++r)
      for (int i = c.ray_begin[r]; i < c.ray_begin[r + 1]; ++i) dx[i] += of_each(c, r);
  }

 private:
  Real of_each(Chunk& c, int r) const {
    const int count = std::max(1, c.ray_begin[r + 1] - c.ray_begin[r]);
    return 3 * factor_ * c.data(inputs()[1])[r] / static_cast<Real>(count);
  }
  Real factor_;
};

}  // namespace

Composite composite_transient(Tape& tape, const TransientMatter& m, Value delta, Value background,
                              bool opaque_end) {
  for (const auto& [value, rows] : {std::pair{m.density, 1},
                                    {m.colour, 3},
                                    {m.transient_density, 1},
                                    {m.transient_colour, 3},
                                    {m.deviation, 1},
                                    {delta, 1}}) {
    NERF_CHECK_EQ(tape.rows(value), rows);
    NERF_CHECK(tape.domain(value) == Domain::kSamples);
  }
  NERF_CHECK_EQ(tape.rows(background), 3);
  NERF_CHECK(!tape.needs_gradient(delta) && !tape.needs_gradient(background));  // not trained
  const Value from[] = {m.density, m.colour, m.transient_density, m.transient_colour, m.deviation};
  for (const Value v : from) NERF_CHECK(tape.needs_gradient(v));
  const Value kept = tape.output(kKept, Domain::kSamples, {});
  const Value weights = tape.output(1, Domain::kSamples, {});
  const Value pixel = tape.output(5, Domain::kRays, from);
  tape.record(
      std::make_unique<CompositeTransient>(m, delta, background, kept, weights, pixel, opaque_end));
  return {pixel, weights};
}

Value uncertain_loss(Tape& tape, Value pixel, Value target, Value scale, Real least) {
  NERF_CHECK_EQ(tape.rows(pixel), 5);
  NERF_CHECK_EQ(tape.rows(target), 3);
  NERF_CHECK(!tape.needs_gradient(target) && !tape.needs_gradient(scale));  // not trained
  NERF_CHECK(least > 0);
  const Value out = tape.output(1, Domain::kRays, {&pixel, 1});
  tape.record(std::make_unique<UncertainLoss>(pixel, target, scale, out, least));
  return out;
}

Value mean_loss(Tape& tape, Value x, Value scale, Real factor) {
  NERF_CHECK_EQ(tape.rows(x), 1);
  NERF_CHECK(tape.domain(x) == Domain::kSamples && tape.domain(scale) == Domain::kRays);
  const Value out = tape.output(1, Domain::kRays, {&x, 1});
  tape.record(std::make_unique<MeanLoss>(x, scale, out, factor));
  return out;
}

}  // namespace nerf
