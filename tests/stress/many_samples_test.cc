// A million samples on one ray: what each of them is off by must not add up.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "kernels/kernel_test.h"
#include "nerf/autodiff/operations.h"
#include "nerf/autodiff/tape.h"
#include "stress/composite_run.h"

namespace nerf::stress {
namespace {

constexpr int kMillion = 1000000;

// The bounds of check_ray do not grow with the number of samples.
TEST(StressManySamples, RandomMatter) {
  CompositeErrors errors;
  for (double depth : {1e-6, 0.1, 1.0, 20.0, 1e4}) {
    Random random(11, 0, 0);
    Matter m;
    for (int i = 0; i < kMillion; ++i)
      m.add(static_cast<Real>(2 * depth * random.uniform()), 1.0_r / kMillion,
            {random.uniform(), random.uniform(), random.uniform()});
    for_each_target([&](const std::string&) { check_ray(m, errors, "depth", depth); });
  }
  errors.report();
}

// A ray's code gets the sum of its samples' gradients, which float would leave behind.
TEST(StressManySamples, GradientOfWhatTheyShare) {
  Tape tape(kMillion, 1);
  const Value x = tape.input(1, Domain::kRays, true);
  const Value y = repeat_for_samples(tape, x);
  tape.plan();
  Chunk chunk(tape);
  const std::vector<int32_t> rays{0, kMillion};
  chunk.samples = kMillion;
  chunk.rays = 1;
  chunk.ray_begin = rays.data();
  tape.forward(chunk);
  std::fill_n(chunk.gradient(y), kMillion, 0.1_r);
  tape.backward(chunk);
  const double want = double{0.1_r} * kMillion;
  EXPECT_NEAR(chunk.gradient(x)[0], want, (kRoundoff + summing_error(kMillion)) * want);
}

// All alike, so that every rounding goes the same way: opacities that lie between two neighbours of
// 1 - alpha, or below the last of them, where the product of floats would stand still or run ahead.
TEST(StressManySamples, HomogeneousMatterIsItsClosedForm) {
  WorstError worst("closed_form");
  for_each_target([&](const std::string&) {
    for (double steps : {0.3, 0.49, 0.51, 1.49, 2.51, 16.5, 100.49, 400.51}) {
      const double tau = steps * kRoundoff;
      Matter m;
      for (int i = 0; i < kMillion; ++i) m.add(static_cast<Real>(tau), 1, {0.8_r, 0.1_r, 0.6_r});
      const Rendered got = run_composite(m);
      const double depth = double{static_cast<Real>(tau)} * kMillion, left = std::exp(-depth);
      double sum = 0;
      for (double w : got.weights) sum += w;
      EXPECT_LE(sum, 1 + 1e-6) << steps;
      const double error = kPixelError + summing_error(kMillion);
      worst.compare(sum, 1 - left, error, "steps", steps, "sum of weights");
      worst.compare(got.pixel[3], 1 - left, error, "steps", steps, "opacity");
      for (size_t k = 0; k < 3; ++k)
        worst.compare(got.pixel[k], (1 - left) * m.colour[0][k] + left * m.background[k], error,
                      "steps", steps, "channel", k);
      // d / d density_i of (1 - T) s + T b is delta T (s - b), the same for every sample.
      double s = m.gradient[3], b = 0;
      for (size_t k = 0; k < 3; ++k) {
        s += double{m.colour[0][k]} * double{m.gradient[k]};
        b += double{m.background[k]} * double{m.gradient[k]};
      }
      for (size_t i = 0; i < m.size(); i += 997)
        worst.compare(got.d_density[i], left * (s - b),
                      2 * kGradientError + 8 * summing_error(kMillion), "steps", steps, "gradient",
                      i);
    }
  });
  worst.report();
}

// Mist that nobody sees, a wall, and mist behind it.
TEST(StressManySamples, WallInTheMiddle) {
  CompositeErrors errors;
  for (Real mist : {0.0_r, 1e-9_r, 1e-6_r}) {
    Matter m;
    for (int i = 0; i < kMillion; ++i)
      m.add(i == kMillion / 2 ? 1e10_r : mist, 1, {0.1_r, i % 2 ? 0.9_r : 0.2_r, 0.5_r});
    for_each_target([&](const std::string&) {
      check_ray(m, errors, "mist", mist);
      const Rendered got = run_composite(m);
      for (size_t i = kMillion / 2 + 1; i < m.size(); i += 101) {
        EXPECT_EQ(got.weights[i], 0);
        EXPECT_EQ(got.d_density[i], 0);
      }
    });
  }
  errors.report();
}

}  // namespace
}  // namespace nerf::stress
