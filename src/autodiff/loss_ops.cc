// Losses of pixels, and gradients that come from beside the tape.
#include <algorithm>
#include <cmath>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"

namespace nerf {
namespace {

// For |r| <= delta it equals r^2.
struct Huber {
  static constexpr const char* kName = "huber_loss";
  Real delta;
  Real value(Real e) const {
    const Real a = std::fabs(e);
    return a <= delta ? e * e : delta * (2 * a - delta);
  }
  Real slope(Real e) const { return 2 * std::clamp(e, -delta, delta); }
};

struct Squared {
  static constexpr const char* kName = "squared_loss";
  Real value(Real e) const { return e * e; }
  Real slope(Real e) const { return 2 * e; }
};

struct Charbonnier {
  static constexpr const char* kName = "charbonnier_loss";
  Real epsilon;
  Real value(Real e) const { return std::sqrt(e * e + epsilon * epsilon); }
  // 0 where both squares are below the smallest number, as of an error of 0 and a tiny epsilon.
  Real slope(Real e) const {
    const Real v = value(e);
    return v == 0 ? 0 : e / v;
  }
};

// Sum over the colour channels of f(pixel - target), times the ray's scale.
template <class F>
class PixelLoss : public Operation {
 public:
  PixelLoss(Value pixel, Value target, Value scale, Value out, F f)
      : Operation({pixel, target, scale}, out), f_(f) {}
  const char* name() const override { return F::kName; }

  void forward(Chunk& c) const override {
    const int64_t lr = c.stride(output());
    const Real* p = c.data(inputs()[0]);
    const Real* t = c.data(inputs()[1]);
    const Real* scale = c.data(inputs()[2]);
    Real* out = c.data(output());
    for (int r = 0; r < c.rays; ++r) {
      Real sum = 0;
      for (int k = 0; k < 3; ++k) sum += f_.value(p[k * lr + r] - t[k * lr + r]);
      out[r] = sum * scale[r];
      c.loss += static_cast<double>(out[r]);
    }
  }

  void backward(Chunk& c) const override {
    const int64_t lr = c.stride(output());
    const Real* p = c.data(inputs()[0]);
    const Real* t = c.data(inputs()[1]);
    const Real* scale = c.data(inputs()[2]);
    Real* dp = c.gradient(inputs()[0]);
    NERF_CHECK(overwrites(0));
    for (int r = 0; r < c.rays; ++r) {
      for (int k = 0; k < 3; ++k)
        dp[k * lr + r] = f_.slope(p[k * lr + r] - t[k * lr + r]) * scale[r];
      dp[3 * lr + r] = 0;
    }
    const int64_t padded = round_up(c.rays, kLane);
    for (int k = 0; k < 4; ++k) std::fill(dp + k * lr + c.rays, dp + k * lr + padded, 0.0_r);
  }

 private:
  F f_;
};

template <class F>
Value pixel_loss(Tape& tape, Value pixel, Value target, Value scale, F f) {
  NERF_CHECK_EQ(tape.rows(pixel), 4);
  NERF_CHECK_EQ(tape.rows(target), 3);
  NERF_CHECK(!tape.needs_gradient(target) && !tape.needs_gradient(scale));  // not trained
  const Value out = tape.output(1, Domain::kRays, {&pixel, 1});
  tape.record(std::make_unique<PixelLoss<F>>(pixel, target, scale, out, f));
  return out;
}

class AddGradient : public Operation {
 public:
  AddGradient(Value x, Value gradient, Value out) : Operation({x, gradient}, out) {}
  const char* name() const override { return "add_gradient"; }

  void forward(Chunk&) const override {}
  void backward(Chunk& c) const override {
    const Value x = inputs()[0];
    const int64_t ld = c.stride(x), n = c.count(x);
    const Real* from = c.data(inputs()[1]);
    Real* dx = c.gradient(x);
    for (int r = 0; r < c.tape->rows(x); ++r) {
      for (int64_t i = 0; i < n; ++i)
        dx[r * ld + i] = (overwrites(0) ? 0.0_r : dx[r * ld + i]) + from[r * ld + i];
      if (overwrites(0)) std::fill(dx + r * ld + n, dx + r * ld + round_up(n, kLane), 0.0_r);
    }
  }
};

}  // namespace

Value huber_loss(Tape& tape, Value pixel, Value target, Value scale, Real delta) {
  return pixel_loss(tape, pixel, target, scale, Huber{delta});
}
Value squared_loss(Tape& tape, Value pixel, Value target, Value scale) {
  return pixel_loss(tape, pixel, target, scale, Squared{});
}
Value charbonnier_loss(Tape& tape, Value pixel, Value target, Value scale, Real epsilon) {
  return pixel_loss(tape, pixel, target, scale, Charbonnier{epsilon});
}

void add_gradient(Tape& tape, Value x, Value gradient) {
  NERF_CHECK_EQ(tape.rows(x), tape.rows(gradient));
  NERF_CHECK(tape.domain(x) == tape.domain(gradient) && !tape.needs_gradient(gradient));
  const Value out = tape.output(1, Domain::kRays, {&x, 1});
  tape.record(std::make_unique<AddGradient>(x, gradient, out));
}

}  // namespace nerf
