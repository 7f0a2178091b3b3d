// What is seen through a medium whose numbers are learnt.
#include <algorithm>
#include <cmath>

#include "nerf/autodiff/operations.h"
#include "nerf/base/error.h"
#include "nerf/math/medium_numbers.h"

namespace nerf {
namespace {

// The medium by channel, from its numbers, and the gradient on its way back to them.
class LearntNumbers {
 public:
  LearntNumbers(const Chunk& c, const LinearWeights& w)
      : from_(c.weights + w.offset), to_(w.offset), of_{w.in} {
    for (int k = 0; k < 3; ++k) {
      const MediumChannel channel(of_, k, [&](int i) { return number(i); });
      attenuation[k] = channel.attenuation;
      backscatter[k] = channel.backscatter;
      colour[k] = channel.colour;
    }
  }

  // Adds the sums below to the numbers' gradient.
  void go_back(Chunk& c) const {
    Real* to = c.weight_gradient + to_;
    // softplus' = sigmoid.
    for (int k = 0; k < 3; ++k) {
      const int a = of_.attenuation(k), b = of_.backscatter(k);
      to[a] += static_cast<Real>(d_attenuation[k] * reference::sigmoid(number(a)));
      to[b] += static_cast<Real>(d_backscatter[k] * reference::sigmoid(number(b)));
      to[of_.colour(k)] += static_cast<Real>(d_colour[k] * reference::sigmoid_slope(colour[k]));
    }
  }

  double attenuation[3], backscatter[3], colour[3];
  double d_attenuation[3] = {}, d_backscatter[3] = {}, d_colour[3] = {};

 private:
  double number(int i) const { return static_cast<double>(from_[i]); }

  const Real* from_;
  size_t to_;
  MediumNumbers of_;
};

class SeeThrough : public Operation {
 public:
  SeeThrough(Value colour, Value distance, Value seen, const LinearWeights& numbers)
      : Operation({colour, distance}, seen), numbers_(numbers) {}
  const char* name() const override { return "see_through"; }

  void forward(Chunk& c) const override {
    const LearntNumbers m(c, numbers_);
    const Value colour = inputs()[0];
    const int64_t n = c.count(colour), padded = round_up(n, kLane);
    const Real* d = c.data(inputs()[1]);
    for (int k = 0; k < 3; ++k) {
      const Real* x = c.data(colour) + k * c.stride(colour);
      Real* y = c.data(output()) + k * c.stride(output());
      const Real a = static_cast<Real>(m.attenuation[k]), b = static_cast<Real>(m.backscatter[k]);
      const Real own = static_cast<Real>(m.colour[k]);
      for (int64_t i = 0; i < n; ++i)
        y[i] = std::exp(-a * d[i]) * x[i] - std::expm1(-b * d[i]) * own;
      for (int64_t i = n; i < padded; ++i) y[i] = 0;
    }
  }

  void backward(Chunk& c) const override {
    LearntNumbers m(c, numbers_);
    const Value colour = inputs()[0], distance = inputs()[1];
    const int64_t n = c.count(colour), padded = round_up(n, kLane);
    const Real* d = c.data(distance);
    Real* dd = c.tape->needs_gradient(distance) ? c.gradient(distance) : nullptr;
    if (dd && overwrites(1)) std::fill(dd, dd + padded, 0.0_r);
    for (int k = 0; k < 3; ++k) {
      const Real* x = c.data(colour) + k * c.stride(colour);
      const Real* dy = c.gradient(output()) + k * c.stride(output());
      Real* dx =
          c.tape->needs_gradient(colour) ? c.gradient(colour) + k * c.stride(colour) : nullptr;
      const Real a = static_cast<Real>(m.attenuation[k]), b = static_cast<Real>(m.backscatter[k]);
      const Real own = static_cast<Real>(m.colour[k]);
      for (int64_t i = 0; i < n; ++i) {
        const Real left = std::exp(-a * d[i]), before = std::exp(-b * d[i]);
        const Real lost = left * x[i] * dy[i], won = before * own * dy[i];
        m.d_attenuation[k] -= static_cast<double>(d[i] * lost);
        m.d_backscatter[k] += static_cast<double>(d[i] * won);
        m.d_colour[k] -= static_cast<double>(std::expm1(-b * d[i]) * dy[i]);
        if (dd) dd[i] += b * won - a * lost;
        if (dx) dx[i] = (overwrites(0) ? 0 : dx[i]) + left * dy[i];
      }
      for (int64_t i = n; dx && overwrites(0) && i < padded; ++i) dx[i] = 0;
    }
    m.go_back(c);
  }

 private:
  LinearWeights numbers_;
};

class OverMedium : public Operation {
 public:
  OverMedium(Value pixel, Value filled, const LinearWeights& numbers)
      : Operation({pixel}, filled), numbers_(numbers) {}
  const char* name() const override { return "over_medium"; }

  void forward(Chunk& c) const override {
    const LearntNumbers m(c, numbers_);
    const Value pixel = inputs()[0];
    const int64_t padded = round_up(c.rays, kLane), lx = c.stride(pixel), ly = c.stride(output());
    const Real *x = c.data(pixel), *opacity = x + 3 * lx;
    Real* y = c.data(output());
    for (int k = 0; k < 3; ++k)
      for (int64_t i = 0; i < padded; ++i)
        y[k * ly + i] =
            i < c.rays ? x[k * lx + i] + (1 - opacity[i]) * static_cast<Real>(m.colour[k]) : 0;
    for (int64_t i = 0; i < padded; ++i) y[3 * ly + i] = i < c.rays ? opacity[i] : 0;
  }

  void backward(Chunk& c) const override {
    LearntNumbers m(c, numbers_);
    const Value pixel = inputs()[0];
    const int64_t padded = round_up(c.rays, kLane), lx = c.stride(pixel), ly = c.stride(output());
    const Real *opacity = c.data(pixel) + 3 * lx, *dy = c.gradient(output());
    Real* dx = c.tape->needs_gradient(pixel) ? c.gradient(pixel) : nullptr;
    for (int k = 0; dx && overwrites(0) && k < 4; ++k)
      std::fill(dx + k * lx, dx + k * lx + padded, 0.0_r);
    for (int64_t i = 0; i < c.rays; ++i) {
      for (int k = 0; k < 3; ++k) {
        const Real d = dy[k * ly + i];
        m.d_colour[k] += static_cast<double>((1 - opacity[i]) * d);
        if (!dx) continue;
        dx[k * lx + i] += d;
        dx[3 * lx + i] -= static_cast<Real>(m.colour[k]) * d;
      }
      if (dx) dx[3 * lx + i] += dy[3 * ly + i];
    }
    m.go_back(c);
  }

 private:
  LinearWeights numbers_;
};

void check_numbers(const LinearWeights& numbers) {
  NERF_CHECK(numbers.in == kFogNumbers || numbers.in == kWaterNumbers);
}

}  // namespace

Value see_through(Tape& tape, Value colour, Value distance, const LinearWeights& numbers) {
  check_numbers(numbers);
  NERF_CHECK_EQ(tape.rows(colour), 3);
  NERF_CHECK_EQ(tape.rows(distance), 1);
  NERF_CHECK(tape.domain(colour) == tape.domain(distance));
  const Value from[] = {colour, distance};
  const Value seen = tape.output(3, tape.domain(colour), from, /*trained=*/true);
  tape.record(std::make_unique<SeeThrough>(colour, distance, seen, numbers));
  return seen;
}

Value over_medium(Tape& tape, Value pixel, const LinearWeights& numbers) {
  check_numbers(numbers);
  NERF_CHECK_EQ(tape.rows(pixel), 4);
  const Value filled = tape.output(4, Domain::kRays, {&pixel, 1}, /*trained=*/true);
  tape.record(std::make_unique<OverMedium>(pixel, filled, numbers));
  return filled;
}

}  // namespace nerf
