#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "math/complex_step.h"
#include "math/worst_error.h"
#include "nerf/math/random.h"
#include "nerf/math/reference/histogram_losses.h"
#include "nerf/parts/losses.h"
#include "parts/exact_sums.h"

namespace nerf {
namespace {

using test::Doubles;
using test::doubles;
using test::kSum;

TEST(DepthLoss, MatchesTheTemplateAndItsGradient) {
  WorstError loss("depth"), gradient("depth_gradient");
  for (const int n : {0, 1, 2, 17, 64}) {
    for (const Real depth : {0.01_r, 0.3_r, 0.5_r, 0.97_r}) {
      Random random(6, static_cast<uint64_t>(n), 0);
      std::vector<Real> middles, w;
      Real at = 0;
      for (int i = 0; i < n; ++i) {
        at += random.uniform() / static_cast<Real>(n);
        middles.push_back(at);
        w.push_back(random.uniform() / static_cast<Real>(n));
      }
      std::vector<Real> d(w.size(), 1.0_r);  // added to
      const auto exact = [&](const std::vector<Complex>& x) {
        return reference::depth_loss(doubles(middles), x, static_cast<double>(depth),
                                     kDepthTolerance);
      };
      const std::vector<Complex> x(w.begin(), w.end());
      loss.compare(depth_loss(middles, w, depth, 0.25_r, d), 0.25 * exact(x).real(), kSum, "n", n);
      const auto want = complex_step_gradient(exact, doubles(w));
      for (size_t i = 0; i < w.size(); ++i)
        gradient.compare(d[i], 1 + 0.25 * want[i], 3 * kRoundoff * (1 + 0.25 * std::fabs(want[i])),
                         "n", n, "i", i);
    }
  }
  loss.report();
  gradient.report();
}

// Distances in m = 1 - 1 / (1 + d): the surface at d = 1 is at 1/2, and one hundredth of it at
// 1/400 more.
TEST(DepthLoss, ClosedForms) {
  const Real depth = 0.5_r;
  const auto of = [&](std::vector<Real> m, std::vector<Real> w) {
    std::vector<Real> d(w.size());
    return depth_loss(m, w, depth, 1, d);
  };
  constexpr double kTolerance = 0.25 * kDepthTolerance;
  // All of the light there, or within the tolerance.
  EXPECT_EQ(of({0.5_r}, {1}), 0);
  EXPECT_EQ(of({0.501_r}, {1}), 0);
  EXPECT_NEAR(of({0.25_r}, {1}), 0.25 - kTolerance, kSum);
  EXPECT_NEAR(of({0.75_r}, {1}), 0.25 - kTolerance, kSum);
  // None: all of it passes.
  EXPECT_NEAR(of({}, {}), 0.5 - kTolerance, kSum);
  EXPECT_NEAR(of({0.5_r}, {0.5_r}), 0.5 * (0.5 - kTolerance), kSum);
  // Half before and half behind is right in the mean, and as wrong as each.
  EXPECT_NEAR(of({0.25_r, 0.75_r}, {0.5_r, 0.5_r}), 0.25 - kTolerance, kSum);
}

TEST(DepthLoss, ALittleLightThereIsBetterThanAnywhereElse) {
  const std::vector<Real> m{0.1_r, 0.4_r, 0.5_r, 0.6_r, 0.9_r};
  std::vector<Real> d(5);
  depth_loss(m, std::vector<Real>(5, 0.0_r), 0.5_r, 1, d);
  for (size_t i = 0; i < 5; ++i) {
    EXPECT_LT(d[i], 0);  // of what would pass all of them
    if (i != 2) {
      EXPECT_LT(d[2], d[i]);
    }
  }
}

}  // namespace
}  // namespace nerf
