// The whole field on a training tape, from features to the loss and back, with inputs and weights
// of extreme sizes: everything stays finite.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "stress/stress_field.h"

namespace nerf::stress {
namespace {

struct Sizes {
  Real features, weights, delta;
};

// Sizes whose products the network can hold at all: three layers of 16 to 32 terms each.
constexpr Sizes kSizes[] = {{1, 1, 1e-3_r},
                            {0, 1, 1},
                            {1, 0, 1},
                            {1e-42_r, 1, 1e-7_r},
                            {1e-20_r, 1e-15_r, 1},
                            {1e4_r, 1, 1e-3_r},
                            {1e4_r, 1e3_r, 1e7_r},
                            {1e10_r, 1e2_r, 1e-7_r},
                            {1e-10_r, 1e4_r, 1e7_r},
                            {1e15_r, 1e-10_r, 1e7_r}};

void expect_finite_gradients(const Sizes& size, int rays, Real target, const GridLosses& losses) {
  GridField field(small_options(), true, 2);
  field.initialise(91);
  for (Real& w : field.weights) w *= size.weights;
  const GridTape tape(field, /*training=*/true, losses);
  Chunk chunk(tape.tape);
  AlignedArray<Real> weight_gradient(field.weights.size());
  chunk.weights = field.weights.data();
  chunk.weight_gradient = weight_gradient.data();
  chunk.samples = kChunkSamples;
  chunk.rays = rays;
  std::vector<int32_t> begin;
  for (int r = 0; r <= rays; ++r) begin.push_back(r * kChunkSamples / rays);
  chunk.ray_begin = begin.data();
  Random random(92, 0, 0);
  const auto fill = [&](Value v, double low, double high) {
    for (int r = 0; r < tape.tape.rows(v); ++r)
      for (int64_t s = 0; s < chunk.stride(v); ++s)
        chunk.data(v)[r * chunk.stride(v) + s] = uniform(random, low, high);
  };
  fill(tape.features, -double{size.features}, size.features);
  fill(tape.directions, 0.5, 0.6);
  fill(tape.delta, 0, size.delta);
  fill(tape.background, 0, 1);
  fill(tape.pixel_loss.target, target, target);
  fill(tape.pixel_loss.scale, 1, 1);
  const FlushDenormals guard;
  tape.tape.forward(chunk);
  const int64_t colours = chunk.count(tape.colour);
  tape.tape.backward(chunk);

  ASSERT_TRUE(std::isfinite(chunk.loss) && chunk.loss >= 0);
  const int64_t ls = chunk.stride(tape.density), lr = chunk.stride(tape.image.pixel);
  for (int s = 0; s < kChunkSamples; ++s) {
    const Real density = chunk.data(tape.density)[s];
    // The largest is exp(kMaxLogDensity), a unit in the last place more or less.
    ASSERT_TRUE(density >= 0 && density <= std::exp(kMaxLogDensity) * 1.000001_r) << density;
  }
  for (int s = 0; s < chunk.samples; ++s)
    for (int f = 0; f < tape.tape.rows(tape.features); ++f)
      ASSERT_TRUE(std::isfinite(chunk.gradient(tape.features)[f * ls + s]))
          << "feature " << f << " sample " << s;
  for (int64_t i = 0; i < colours; ++i)
    for (int k = 0; k < 3; ++k) {
      const Real c = chunk.data(tape.colour)[k * chunk.stride(tape.colour) + i];
      ASSERT_TRUE(c >= 0 && c <= 1) << c;
    }
  // Weights times colours in double, each weight's light counted once: one rounding. The light of
  // groups is rounded once more for each, and the background shows where it does not add up to 1.
  const Real rounding =
      static_cast<Real>(kRoundoff) * (losses.shared_colour > 0 ? kChunkSamples / rays : 0);
  for (int r = 0; r < rays; ++r) {
    double sum = 0;
    for (int32_t i = begin[static_cast<size_t>(r)]; i < begin[static_cast<size_t>(r) + 1]; ++i) {
      ASSERT_GE(chunk.data(tape.image.weights)[i], 0);
      sum += double{chunk.data(tape.image.weights)[i]};
    }
    ASSERT_LE(sum, 1 + 1e-6);
    for (int k = 0; k < 4; ++k) {
      const Real p = chunk.data(tape.image.pixel)[k * lr + r];
      ASSERT_TRUE(p >= -rounding && p <= 1 + 2 * kRoundoff + rounding) << p;
    }
  }
  for (Real g : weight_gradient) ASSERT_TRUE(std::isfinite(g));
}

TEST(StressField, GradientsStayFinite) {
  for_each_target([&](const std::string&) {
    for (const Sizes& size : kSizes)
      for (int rays : {1, 7, 240})
        for (Real target : {0.0_r, 1.0_r})
          for (Real shared : {0.0_r, 0.125_r})
            for (const std::optional<Real> roulette : {std::optional<Real>{}, {0.0_r}, {1.0_r}}) {
              SCOPED_TRACE("features " + std::to_string(size.features) + " weights " +
                           std::to_string(size.weights) + " rays " + std::to_string(rays) +
                           " shared " + std::to_string(shared) + " roulette " +
                           std::to_string(roulette.value_or(-1)));
              expect_finite_gradients(size, rays, target,
                                      {.shared_colour = shared,
                                       .stop_transmittance = shared > 0 ? 1e-3_r : 0,
                                       .roulette = roulette});
            }
  });
}

// A colour or a density at its limit still learns: the slope of a saturated density is that of 15,
// and a loss hands a gradient on wherever light is left.
TEST(StressField, ExtremeDensitiesStillReceiveGradient) {
  for_each_target([&](const std::string&) {
    for (Real log_density : {-1e4_r, -30.0_r, 30.0_r, 1e4_r})
      for (Real length : {1e-7_r, 1e-2_r}) {
        Tape tape(16, 1);
        const Value x = tape.input(1, Domain::kSamples, true);
        const Value colour = tape.input(3, Domain::kSamples, true);
        const Value delta = tape.input(1, Domain::kSamples), back = tape.input(3, Domain::kRays);
        const Value target = tape.input(3, Domain::kRays), scale = tape.input(1, Domain::kRays);
        const Composite image = composite(tape, truncated_exp(tape, x), colour, delta, back);
        huber_loss(tape, image.pixel, target, scale, 0.5_r);
        tape.plan();
        Chunk chunk(tape);
        const int32_t begin[] = {0, 1};
        chunk.samples = chunk.rays = 1;
        chunk.ray_begin = begin;
        std::fill_n(chunk.data(x), 16, log_density);
        std::fill_n(chunk.data(delta), 1, length);
        std::fill_n(chunk.data(scale), 1, 1.0_r);
        for (int k = 0; k < 3; ++k) {
          chunk.data(colour)[k * 16] = 1;
          chunk.data(back)[k * 16] = 0;
          chunk.data(target)[k * 16] = 0.5_r;
        }
        tape.forward(chunk);
        tape.backward(chunk);
        const double density = std::exp(std::min(log_density, 30.0_r));
        const double opacity = -std::expm1(-density * length), left = std::exp(-density * length);
        // 2 e per channel and white on black: d opacity / d density = length exp(-depth).
        const double slope = std::exp(std::clamp(log_density, -15.0_r, 15.0_r));
        const double want = 3 * 2 * (opacity - 0.5) * length * left * slope;
        // The difference e is off by 12 u of 1, density and slope by 2 u each; the depth's error of
        // 3 u depth moves exp(-depth) by that.
        const double size = 3 * 2 * length * left * slope;
        EXPECT_NEAR(chunk.gradient(x)[0], want,
                    (20 + 3 * density * length) * kRoundoff * size + 1e-37)
            << log_density << " over " << length;
        if (left > 1e-30) {
          EXPECT_NE(chunk.gradient(x)[0], 0) << log_density << " over " << length;
        }
      }
  });
}

}  // namespace
}  // namespace nerf::stress
