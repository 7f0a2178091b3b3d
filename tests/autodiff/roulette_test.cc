// What goes back through a tape when only some of its samples do.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/autodiff/operations.h"

namespace nerf {
namespace {

constexpr int kSampleCount = 50, kRayCount = 4, kOut = 5;

// A code for each ray, beside x, into a network whose output's gradient the caller sets: sizes from
// 1e-4 to 1, every fifth 0.
struct Network {
  explicit Network(std::optional<Real> least) : tape(kSampleCount, kRayCount) {
    x = tape.input(3, Domain::kSamples, true);
    code = tape.input(2, Domain::kRays, true);
    const LinearWeights first{0, 5, 8}, second{first.size(), 8, kOut};
    const std::vector<LinearWeights> layers{first, second};
    y = mlp(tape, concat(tape, x, repeat_for_samples(tape, code)), layers);
    if (least) chance = roulette(tape, y, *least);
    slope = tape.input(kOut, Domain::kSamples);
    add_gradient(tape, y, slope);
    tape.plan();
    Random random(71, 0, 0);
    weights = AlignedArray<Real>(first.size() + second.size());
    for (Real& w : weights) w = uniform(random, -1, 1);
    gradient = AlignedArray<Real>(weights.size());
  }

  // Forward and backward. Of the gradients, in double: of the weights, of x by sample, of the code.
  std::vector<double> run(double offset) {
    Chunk chunk(tape);
    const int32_t begin[] = {0, 13, 13, 40, kSampleCount};
    chunk.samples = kSampleCount;
    chunk.rays = kRayCount;
    chunk.ray_begin = begin;
    chunk.weights = weights.data();
    chunk.weight_gradient = gradient.data();
    RouletteState* state = chance < 0 ? nullptr : &chunk.state<RouletteState>(chance);
    if (state) state->offset = offset;
    std::fill(gradient.begin(), gradient.end(), 0.0_r);
    Random random(72, 0, 0);
    for (const Value v : {x, code, slope})
      for (int k = 0; k < tape.rows(v); ++k)
        for (int64_t i = 0; i < chunk.count(v); ++i)
          chunk.data(v)[k * chunk.stride(v) + i] = uniform(random, -1, 1);
    for (int i = 0; i < kSampleCount; ++i) {
      const Real size = i % 5 == 0 ? 0.0_r : std::pow(10.0_r, uniform(random, -4, 0));
      for (int k = 0; k < kOut; ++k) chunk.data(slope)[k * chunk.stride(slope) + i] *= size;
    }
    norms.assign(kSampleCount, 0);
    for (int i = 0; i < kSampleCount; ++i)
      for (int k = 0; k < kOut; ++k)
        norms[static_cast<size_t>(i)] += std::fabs(chunk.data(slope)[k * chunk.stride(slope) + i]);
    tape.forward(chunk);
    tape.backward(chunk);
    samples = chunk.samples;
    std::vector<double> all(gradient.begin(), gradient.end());
    const size_t at = all.size();
    all.resize(at + 3 * kSampleCount);
    for (int i = 0; i < samples; ++i) {
      const int32_t from = samples == kSampleCount ? i : state->kept[static_cast<size_t>(i)];
      for (int k = 0; k < 3; ++k)
        all[at + static_cast<size_t>(k * kSampleCount + from)] =
            chunk.gradient(x)[k * chunk.stride(x) + i];
    }
    for (int k = 0; k < 2; ++k)
      for (int r = 0; r < kRayCount; ++r)
        all.push_back(chunk.gradient(code)[k * chunk.stride(code) + r]);
    return all;
  }

  Tape tape;
  Value x, code, y, slope, chance = -1;
  AlignedArray<Real> weights, gradient;
  int samples = 0;            // that went back
  std::vector<double> norms;  // of the samples' gradients of y
};

// Sums of at most kSampleCount products, each of a chain of two layers, in another order.
constexpr double kRounding = (kSampleCount + 2 * (8 + kOut)) * kRoundoff;

TEST(RouletteOperation, LeavesOutWhatHasNoGradient) {
  WorstError worst("roulette_of_zeros");
  for_each_target([&](const std::string&) {
    Network whole({}), part(0);
    const std::vector<double> want = whole.run(0.5), got = part.run(0.5);
    EXPECT_EQ(whole.samples, kSampleCount);
    EXPECT_EQ(part.samples, kSampleCount * 4 / 5);
    double largest = 0;
    for (const double g : want) largest = std::max(largest, std::fabs(g));
    for (size_t i = 0; i < want.size(); ++i)
      worst.compare(got[i], want[i], kRounding * largest * 10, "gradient", i);
  });
  worst.report();
}

// The mean over offsets at equal distances: a sample is drawn its chance's share of the times, but
// for one, so that its gradient g is off by g / (draws chance). That is the bound's gradient over
// the draws: a number of the weights' sums those of all samples, each at most 5 times (hidden
// values are sums of 5 terms below 1) the size of the output's.
TEST(RouletteOperation, ExpectationIsTheGradient) {
  for_each_target([&](const std::string&) {
    constexpr int kDraws = 4000;
    Network whole({}), part(1);
    const std::vector<double> want = whole.run(0.5);
    std::vector<double> mean(want.size());
    double samples = 0, variance = 0;
    for (int k = 0; k < kDraws; ++k) {
      const std::vector<double> got = part.run((k + 0.5) / kDraws);
      for (size_t i = 0; i < mean.size(); ++i) {
        mean[i] += got[i] / kDraws;
        variance += std::pow(got[i] - want[i], 2) / kDraws;
      }
      samples += static_cast<double>(part.samples) / kDraws;
    }
    EXPECT_LT(samples, 0.5 * kSampleCount);
    EXPECT_GT(variance, 0);
    double largest = 0, bound = 0;
    for (const double g : want) largest = std::max(largest, std::fabs(g));
    for (const double norm : whole.norms) bound += norm / kSampleCount;
    const size_t weights = whole.weights.size();
    for (size_t i = 0; i < want.size(); ++i) {
      double tolerance = kSampleCount * 5 * bound / kDraws;
      if (i >= weights && i < weights + 3 * kSampleCount) {
        const double norm = whole.norms[(i - weights) % kSampleCount];
        tolerance = norm > 0 ? std::fabs(want[i]) * std::max(bound / norm, 1.0) / kDraws : 0;
      }
      EXPECT_NEAR(mean[i], want[i], tolerance + kRounding * largest * 10) << i;
    }
  });
}

}  // namespace
}  // namespace nerf
