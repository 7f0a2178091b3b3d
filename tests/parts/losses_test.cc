#include "nerf/parts/losses.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "golden/golden.h"
#include "math/complex_step.h"
#include "math/worst_error.h"
#include "nerf/math/random.h"
#include "nerf/math/reference/histogram_losses.h"
#include "parts/exact_sums.h"

namespace nerf {
namespace {

using test::Doubles;
using test::doubles;
using test::kSum;

std::vector<Real> floats(const Doubles& v, size_t from, size_t n) {
  return {v.begin() + static_cast<ptrdiff_t>(from), v.begin() + static_cast<ptrdiff_t>(from + n)};
}

TEST(HistogramLosses, DistortionMatchesGoldenAndItsGradientTheTemplate) {
  WorstError loss("distortion"), gradient("distortion_gradient");
  for (const Doubles& v : golden_lines("sampling.txt", "distortion")) {
    const size_t n = static_cast<size_t>(v[0]);
    const auto s = floats(v, 1, n + 1), w = floats(v, n + 2, n);
    const Real scale = 0.25_r;
    std::vector<Real> d(n, 1.0_r);  // added to
    loss.compare(distortion_loss(s, w, scale, d), 0.25 * v[2 * n + 2], kSum, "n", n);
    const auto want = complex_step_gradient(
        [&](const std::vector<Complex>& x) { return reference::distortion_loss(doubles(s), x); },
        doubles(w));
    for (size_t i = 0; i < n; ++i)
      gradient.compare(d[i], 1 + 0.25 * want[i], 3 * kRoundoff * (1 + 0.25 * std::fabs(want[i])),
                       "n", n, "bin", i);
  }
  loss.report();
  gradient.report();
}

// Intervals that touch are the bins between their edges; ones with gaps are the template's.
TEST(HistogramLosses, DistortionOfIntervalsWithGaps) {
  WorstError worst("distortion_gaps"), gradient("distortion_gaps_gradient");
  for (const int n : {0, 1, 2, 17, 64}) {
    Random random(5, static_cast<uint64_t>(n), 0);
    std::vector<Real> middles, widths, w;
    Real at = 0;
    for (int i = 0; i < n; ++i) {
      const Real width = random.uniform() / 64;
      middles.push_back(at + 0.5_r * width);
      widths.push_back(width);
      w.push_back(random.uniform() / static_cast<Real>(n));
      at += width + random.uniform() / 64;
    }
    std::vector<Real> d(w.size());
    const auto exact = [&](const std::vector<Complex>& x) {
      return reference::distortion_loss(doubles(middles), doubles(widths), x);
    };
    const std::vector<Complex> x(w.begin(), w.end());
    worst.compare(distortion_loss(middles, widths, w, 1, d), exact(x).real(), kSum, "n", n);
    const auto want = complex_step_gradient(exact, doubles(w));
    for (size_t i = 0; i < w.size(); ++i)
      gradient.compare(d[i], want[i], 3 * kRoundoff * std::fabs(want[i]) + kSum, "n", n, "i", i);
  }
  worst.report();
  gradient.report();
}

TEST(HistogramLosses, InterlevelMatchesGoldenAndItsGradientTheTemplate) {
  WorstError loss("interlevel"), gradient("interlevel_gradient");
  int active = 0;
  for (const Doubles& v : golden_lines("sampling.txt", "interlevel")) {
    const size_t n = static_cast<size_t>(v[0]), m = static_cast<size_t>(v[1]);
    const auto s = floats(v, 2, n + 1), w = floats(v, n + 3, n);
    const auto ps = floats(v, 2 * n + 3, m + 1), pw = floats(v, 2 * n + m + 4, m);
    std::vector<Real> d(m, 0.0_r);
    const double want = v[2 * n + 2 * m + 4];
    loss.compare(interlevel_loss(s, w, ps, pw, 1, d), want, kSum + 1e-13 * want, "n", n, "m", m);
    active += want > 0;
    const auto slope = complex_step_gradient(
        [&](const std::vector<Complex>& x) {
          return reference::interlevel_loss(doubles(s), doubles(w), doubles(ps), x,
                                            static_cast<double>(kInterlevelEpsilon));
        },
        doubles(pw));
    // A proposal bin gets at most n terms, each rounded, added in float.
    for (size_t j = 0; j < m; ++j)
      gradient.compare(d[j], slope[j],
                       rounding_bound(static_cast<double>(n) + 3) * std::fabs(slope[j]) + 1e-12,
                       "n", n, "m", m, "bin", j);
  }
  EXPECT_GE(active, 5);
  loss.report();
  gradient.report();
}

// A proposal that is the histogram itself bounds it; one with less mass does not.
TEST(HistogramLosses, AnEqualProposalCostsNothing) {
  const std::vector<Real> s{0, 0.25_r, 0.5_r, 1}, w{0.2_r, 0.5_r, 0.3_r};
  std::vector<Real> d(3, 0.0_r), less{0.1_r, 0.25_r, 0.15_r};
  EXPECT_EQ(interlevel_loss(s, w, s, w, 1, d), 0);
  EXPECT_EQ(d, std::vector<Real>(3, 0.0_r));
  const std::vector<Real> apart{0, 0.2_r, 0.3_r, 1};
  EXPECT_GT(interlevel_loss(s, w, s, std::vector<Real>{0.1_r, 0.1_r, 0.1_r}, 1, d), 0);
  for (const Real g : d) EXPECT_LE(g, 0);  // more mass lowers it
}

TEST(MatterLoss, MatchesTheDefinitionAndItsGradient) {
  WorstError loss("matter"), gradient("matter_gradient");
  for (const int n : {0, 1, 17, 64})
    for (const Real thickness : {0.001_r, 1.0_r, 1000.0_r}) {
      Random random(7, static_cast<uint64_t>(n), 0);
      std::vector<Real> densities, deltas;
      for (int i = 0; i < n; ++i) {
        densities.push_back(thickness * random.uniform());
        deltas.push_back(random.uniform() / 8);
      }
      const auto exact = [&](const std::vector<Complex>& x) {
        Complex tau = 0;
        for (size_t i = 0; i < x.size(); ++i) tau += x[i] * static_cast<double>(deltas[i]);
        return tau / (1.0 + tau);
      };
      std::vector<Real> d(densities.size(), 1.0_r);  // overwritten
      const std::vector<Complex> x(densities.begin(), densities.end());
      // A sum of n products and a few operations more.
      const double rounding = (n + 6) * kRoundoff;
      const double want = 0.25 * exact(x).real();
      loss.compare(matter_loss(densities, deltas, 0.25_r, d), want, rounding * want, "n", n);
      const auto slopes = complex_step_gradient(exact, doubles(densities));
      for (size_t i = 0; i < d.size(); ++i)
        gradient.compare(d[i], 0.25 * slopes[i], 2 * rounding * 0.25 * slopes[i], "n", n, "i", i);
    }
  loss.report();
  gradient.report();
}

}  // namespace
}  // namespace nerf
