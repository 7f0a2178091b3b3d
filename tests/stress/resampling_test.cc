// Resampling of rays from the worst levels that could come before: positions that coincide, bins
// without width, weights that are 0, alone, huge or denormal.
#include "nerf/kernels/resampling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/math/random.h"
#include "nerf/math/step_function.h"
#include "nerf/parts/interval_sampler.h"
#include "stress/histograms.h"

namespace nerf::stress {
namespace {

constexpr double kTiny = std::numeric_limits<Real>::min();
constexpr int kCoarse = 16, kFine = 24;

IntervalOptions some_options(Resampling resampling) {
  IntervalOptions o;
  o.resampling = resampling;
  o.coarse = kCoarse;
  o.fine = kFine;
  if (resampling == Resampling::kProposal) o.padding = 0;  // mip-NeRF 360's
  return o;
}

class StressResampling : public ::testing::TestWithParam<Resampling> {};

// Sorted, finite, and nowhere outside of what came before (whose intervals lie in [0, 1]).
TEST_P(StressResampling, StaysSortedAndInRange) {
  for_each_target([&](const std::string&) {
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
  });
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
  for_each_target([&](const std::string&) {
    sampler.next(1, before, weights, 1, nullptr, out);
    // A blurred spike covers its neighbours, a dilated one 0.0025 + 0.5 / 16 on either side.
    const Real margin = 2.0_r / kCoarse;
    const auto inside = std::ranges::count_if(
        out, [&](Real t) { return t > before[7] - margin && t < before[8] + margin; });
    EXPECT_GE(inside, kFine - 2);
  });
}

constexpr size_t kBins[] = {1, 2, 15, 16, 17, 33, 128};

std::vector<double> exact(const std::vector<Real>& v) { return {v.begin(), v.end()}; }

// The kernels on the same histograms against their templates in double. Shares: two sums of n terms
// and a quotient, all of them positive.
TEST(StressHistograms, SharesOfEveryHistogram) {
  WorstError worst("shares");
  for_each_target([&](const std::string&) {
    for (const size_t n : kBins)
      for (const std::vector<Real>& weights : weights_before(n)) {
        std::vector<Real> cdf(n + 1);
        std::vector<double> want(n + 1);
        histogram_cdf(weights, cdf);
        cumulative_shares<double>(exact(weights), want);
        ASSERT_EQ(cdf.front(), 0);
        ASSERT_EQ(cdf.back(), 1);
        ASSERT_TRUE(std::ranges::is_sorted(cdf));
        for (size_t i = 0; i <= n; ++i)
          worst.compare(cdf[i], want[i],
                        rounding_bound(2 * static_cast<double>(n) + 3) * want[i] + kTiny, "bins", n,
                        "i", i);
      }
  });
  worst.report();
}

// Of the same shares, at their borders, one float to either side and in between. Difference, mass
// and quotient are rounded, the width, the product and the sum: relative to the bin's width and to
// the position.
TEST(StressHistograms, PositionsInEveryHistogram) {
  WorstError worst("positions");
  for_each_target([&](const std::string&) {
    for (const size_t n : kBins)
      for (const auto& [low, high] : {std::pair{0.0_r, 1.0_r}, {1e-3_r, 1e6_r}})
        for (const std::vector<Real>& edges : levels_before(n + 1, low, high))
          for (const std::vector<Real>& weights : weights_before(n)) {
            std::vector<Real> cdf(n + 1), u;
            histogram_cdf(weights, cdf);
            for (size_t i = 0; i < n; ++i)
              for (const Real at : {std::nextafter(cdf[i], 0.0_r), cdf[i],
                                    std::nextafter(cdf[i], 1.0_r), (cdf[i] + cdf[i + 1]) / 2})
                u.push_back(std::min(at, std::nextafter(1.0_r, 0.0_r)));
            std::ranges::sort(u);
            std::vector<Real> out(u.size());
            std::vector<double> want(u.size());
            histogram_inverse(edges, cdf, u, out);
            invert_sorted<double>(exact(edges), exact(cdf), exact(u), want);
            for (size_t i = 0; i < u.size(); ++i) {
              const size_t bin = static_cast<size_t>(
                  std::upper_bound(cdf.begin() + 1, cdf.end() - 1, u[i]) - cdf.begin() - 1);
              const double width = double{edges[bin + 1]} - double{edges[bin]};
              worst.compare(out[i], want[i],
                            rounding_bound(5) * width + kRoundoff * std::fabs(want[i]), "bins", n,
                            "u", u[i]);
            }
          }
  });
  worst.report();
}

// Log is within 4 units in the last place and Exp within one; an exponent's error counts as a share
// of the power. A weight below the normal numbers may count as the smallest of them.
TEST(StressHistograms, AnnealedWeightsOfEveryHistogram) {
  WorstError worst("annealed");
  for_each_target([&](const std::string&) {
    for (const size_t n : kBins)
      for (const std::vector<Real>& edges : levels_before(n + 1, 0, 1))
        for (const std::vector<Real>& weights : weights_before(n))
          for (const Real exponent : {0.0_r, 1e-30_r, 0.1_r, 0.5_r, 0.999_r, 1.0_r}) {
            std::vector<Real> out(n);
            histogram_anneal(edges, weights, exponent, out);
            std::vector<double> raised = exact(weights), want(n), other(n);
            double of_powers = 0;
            for (double& w : raised) {
              if (w > 0 && exponent != 1) {
                w = std::max(w, kTiny);
                of_powers = std::max(of_powers, 9 * exponent * std::fabs(std::log(w)) + 2);
              }
            }
            anneal_weights<double>(exact(edges), exact(weights), exponent, want);
            anneal_weights<double>(exact(edges), raised, exponent, other);
            const double bound = rounding_bound(2 * of_powers + static_cast<double>(n) + 2);
            for (size_t i = 0; i < n; ++i) {
              ASSERT_TRUE(out[i] >= 0) << i;
              worst.compare(out[i], want[i],
                            bound * want[i] + std::fabs(other[i] - want[i]) + 1e-37, "bins", n,
                            "exponent", exponent, "i", i);
            }
          }
  });
  worst.report();
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
