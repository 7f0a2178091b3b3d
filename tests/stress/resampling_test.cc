// Resampling of rays from the worst levels that could come before: positions that coincide, bins
// without width, weights that are 0, alone, huge or denormal.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "nerf/math/random.h"
#include "nerf/parts/interval_sampler.h"

namespace nerf::stress {
namespace {

constexpr int kCoarse = 16, kFine = 24;

IntervalOptions some_options(Resampling resampling) {
  IntervalOptions o;
  o.resampling = resampling;
  o.coarse = kCoarse;
  o.fine = kFine;
  if (resampling == Resampling::kProposal) o.padding = 0;  // mip-NeRF 360's
  return o;
}

// Levels of n entries from `low` to `high`, sorted.
std::vector<std::vector<Real>> levels_before(size_t n, Real low, Real high) {
  std::vector<std::vector<Real>> out;
  const auto at = [&](size_t i) {
    return low + (high - low) * static_cast<Real>(i) / static_cast<Real>(n - 1);
  };
  std::vector<Real> level(n);
  for (const Real all : {low, high, (low + high) / 2}) {  // all of them at one place
    std::fill(level.begin(), level.end(), all);
    out.push_back(level);
  }
  for (size_t i = 0; i < n; ++i) level[i] = at(i / 2 * 2);  // pairs
  out.push_back(level);
  for (size_t i = 0; i < n; ++i) level[i] = i < n / 2 ? low : high;  // nothing in between
  out.push_back(level);
  for (size_t i = 0; i < n; ++i)  // neighbouring numbers
    level[i] = i == 0 ? (low + high) / 2 : std::nextafter(level[i - 1], high);
  out.push_back(level);
  for (size_t i = 0; i < n; ++i) level[i] = at(i);
  level[n / 2] = level[n / 2 - 1];  // one bin without width
  out.push_back(level);
  return out;
}

std::vector<std::vector<Real>> weights_before(size_t n) {
  const Real tiny = std::numeric_limits<Real>::denorm_min();
  std::vector<std::vector<Real>> out;
  for (const Real all : {0.0_r, tiny, 1e-30_r, 1.0_r, 1e30_r})
    out.push_back(std::vector<Real>(n, all));
  for (const size_t spike : {size_t{0}, n / 2 - 1, n / 2, n - 1}) {
    std::vector<Real> weights(n, 0.0_r);
    weights[spike] = 1;
    out.push_back(weights);
    std::fill(weights.begin(), weights.end(), tiny);
    weights[spike] = 1e30_r;
    out.push_back(weights);
  }
  return out;
}

class StressResampling : public ::testing::TestWithParam<Resampling> {};

// Sorted, finite, and nowhere outside of what came before (whose intervals lie in [0, 1]).
TEST_P(StressResampling, StaysSortedAndInRange) {
  for (const Spacing spacing : {Spacing::kUniform, Spacing::kInverse}) {
    IntervalOptions o = some_options(GetParam());
    o.spacing = spacing;
    const Real near = 0.25_r, far = 1e6_r;
    IntervalSampler sampler(o, near, far);
    const Real low = o.intervals() ? 0.0_r : near, high = o.intervals() ? 1.0_r : far;
    std::vector<Real> out(static_cast<size_t>(sampler.posts(1)));
    int ray = 0;
    for (const auto& before : levels_before(static_cast<size_t>(sampler.posts(0)), low, high))
      for (const auto& weights : weights_before(static_cast<size_t>(sampler.samples(0))))
        for (const Real exponent : {0.0_r, 0.5_r, 1.0_r})
          for (const bool jittered : {false, true}) {
            SCOPED_TRACE("case " + std::to_string(ray));
            Random random(3, 0, static_cast<uint64_t>(ray++));
            sampler.next(1, before, weights, exponent, jittered ? &random : nullptr, out);
            ASSERT_TRUE(std::ranges::is_sorted(out));
            // Proposals leave their support by the dilation.
            const bool proposal = GetParam() == Resampling::kProposal;
            ASSERT_GE(out.front(), proposal ? low : std::min(low, before.front()));
            ASSERT_LE(out.back(), high);
            for (const Real t : out) ASSERT_TRUE(std::isfinite(sampler.distance(t))) << t;
          }
  }
}

// All light from one bin: what is drawn lies in it, up to what a method adds to other bins.
TEST_P(StressResampling, OneSpikeDrawsNearlyAllSamples) {
  IntervalOptions o = some_options(GetParam());
  o.padding = 0;
  IntervalSampler sampler(o, 1, 2);
  std::vector<Real> before(static_cast<size_t>(sampler.posts(0)));
  sampler.first(nullptr, before);
  std::vector<Real> weights(static_cast<size_t>(sampler.samples(0)), 0.0_r);
  weights[7] = 1;
  std::vector<Real> out(static_cast<size_t>(sampler.posts(1)));
  sampler.next(1, before, weights, 1, nullptr, out);
  // A blurred spike covers its neighbours, a dilated one 0.0025 + 0.5 / 16 on either side.
  const Real margin = 2.0_r / kCoarse;
  const auto inside = std::ranges::count_if(
      out, [&](Real t) { return t > before[7] - margin && t < before[8] + margin; });
  EXPECT_GE(inside, kFine - 2);
}

std::string name_of(const ::testing::TestParamInfo<Resampling>& info) {
  constexpr const char* kNames[] = {"coarse_fine", "blurred", "proposal"};
  return kNames[static_cast<int>(info.param)];
}

INSTANTIATE_TEST_SUITE_P(Methods, StressResampling,
                         ::testing::Values(Resampling::kCoarseFine, Resampling::kBlurred,
                                           Resampling::kProposal),
                         name_of);

}  // namespace
}  // namespace nerf::stress
