// Losses on the weights of rays whose bins have no width, coincide or hold all, nothing, next to
// nothing or far too much.
#include "nerf/math/reference/histogram_losses.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "math/complex_step.h"
#include "math/worst_error.h"
#include "nerf/parts/losses.h"
#include "stress/histograms.h"

namespace nerf::stress {
namespace {

using Doubles = std::vector<double>;

constexpr double kTiny = std::numeric_limits<Real>::min();
constexpr double kDouble = 0x1p-53;  // unit roundoff of the sums, in either build
constexpr size_t kBins[] = {1, 2, 9, 33};
// Of the normalised distances that the losses are made for, and of others.
constexpr std::pair<Real, Real> kRanges[] = {{0, 1}, {0, 1e-7_r}, {1e-3_r, 1e6_r}, {0, 1e7_r}};
// Of one loss, of one of many rays, and next to nothing.
constexpr Real kScales[] = {1, 1e-6_r, 1e-30_r};

Doubles doubles(const std::vector<Real>& v) { return {v.begin(), v.end()}; }

// What weights times places may add up to, next to each bin: |m_i| sum_j w_j + sum_j |m_j| w_j.
Doubles moments(const Doubles& middles, const Doubles& weights) {
  double all = 0, all_moment = 0;
  for (size_t i = 0; i < weights.size(); ++i) {
    all += weights[i];
    all_moment += std::fabs(middles[i]) * weights[i];
  }
  Doubles out;
  for (const double m : middles) out.push_back(std::fabs(m) * all + all_moment);
  return out;
}

// No loss is below 0 or not a number, and no gradient below 0: more weight is more loss. Both are
// made from sums of at most n terms in double that cancel where bins are near each other: off by
// (n + 8) roundings of what they would be if nothing did. A gradient is rounded twice more.
template <class Loss>
void check_distortion(const Doubles& middles, const Doubles& widths, const std::vector<Real>& w,
                      Real scale, const Loss& loss, WorstError& value, WorstError& gradient) {
  const Doubles weights = doubles(w);
  const size_t n = w.size();
  std::vector<Real> d(n, 0.0_r);
  const double got = loss(scale, d);
  const Doubles size = moments(middles, weights);
  double all = 0;
  for (size_t i = 0; i < n; ++i)
    all += 2 * weights[i] * size[i] + weights[i] * weights[i] * widths[i];
  const double sums = rounding_bound(static_cast<double>(n) + 8, kDouble), s = scale;
  ASSERT_TRUE(std::isfinite(got));
  ASSERT_GE(got, -sums * s * all);
  const auto exact = [&](const std::vector<Complex>& x) {
    return reference::distortion_loss(middles, widths, x);
  };
  const double want = s * exact(to_complex(weights)).real();
  value.compare(got, want, sums * s * all + rounding_bound(2.0 * n * n, kDouble) * want + 1e-300,
                "bins", n, "scale", s);
  const Doubles slope = complex_step_gradient(exact, weights);
  for (size_t i = 0; i < n; ++i) {
    const double off = 2 * sums * (2 * size[i] + weights[i] * widths[i]);
    ASSERT_TRUE(std::isfinite(d[i])) << "bin " << i;
    ASSERT_GE(d[i], -s * off - kTiny) << "bin " << i;
    gradient.compare(d[i], s * slope[i], s * (off + 2 * kRoundoff * std::fabs(slope[i])) + kTiny,
                     "bins", n, "bin", i, "scale", s);
  }
}

TEST(StressHistogramLosses, DistortionOfEveryHistogram) {
  WorstError value("distortion"), gradient("distortion_gradient");
  for (const size_t n : kBins)
    for (const auto& [low, high] : kRanges)
      for (const std::vector<Real>& edges : levels_before(n + 1, low, high)) {
        Doubles middles, widths;
        for (size_t i = 0; i < n; ++i) {
          middles.push_back(0.5 * (double{edges[i]} + double{edges[i + 1]}));
          widths.push_back(double{edges[i + 1]} - double{edges[i]});
        }
        for (const std::vector<Real>& weights : weights_before(n))
          for (const Real scale : kScales) {
            if (high > 1e6_r && weights[n / 2] > 1e29_r) continue;  // beyond the largest float
            check_distortion(
                middles, widths, weights, scale,
                [&](Real s, std::vector<Real>& d) { return distortion_loss(edges, weights, s, d); },
                value, gradient);
          }
      }
  value.report();
  gradient.report();
}

// Intervals that leave gaps, or have no width, or much more than they are apart.
TEST(StressHistogramLosses, DistortionOfIntervals) {
  WorstError value("distortion_intervals"), gradient("distortion_intervals_gradient");
  for (const size_t n : kBins)
    for (const auto& [low, high] : kRanges)
      for (const std::vector<Real>& middles : levels_before(n, low, high))
        for (const Real width : {0.0_r, 1e-40_r, 1e-7_r, 1e7_r})
          for (const std::vector<Real>& weights : weights_before(n)) {
            if (weights[n / 2] > 1e29_r) continue;
            const std::vector<Real> widths(n, width);
            check_distortion(
                doubles(middles), doubles(widths), weights, 1,
                [&](Real s, std::vector<Real>& d) {
                  return distortion_loss(middles, widths, weights, s, d);
                },
                value, gradient);
          }
  value.report();
  gradient.report();
}

// At least 0 and never more than the weights, with gradients of at most 0: more of a proposal
// bounds more; each final bin gives 2 at most. The sum of the proposal's bins that overlap one is
// kept in double while they enter and leave it: off by 2 m roundings of all weights, which counts
// with the inverse of what the square is divided by.
TEST(StressHistogramLosses, InterlevelOfEveryPairOfHistograms) {
  WorstError value("interlevel"), gradient("interlevel_gradient");
  int active = 0;
  const auto compare = [&](const std::vector<Real>& s, const std::vector<Real>& w,
                           const std::vector<Real>& ps, const std::vector<Real>& pw) {
    const double epsilon = kInterlevelEpsilon;
    double all = 0, total = 0;
    for (const Real p : pw) all += double{p};
    for (const Real x : w) total += double{x};
    const double off = rounding_bound(2.0 * pw.size() + 2, kDouble) * all;
    std::vector<Real> d(pw.size(), 0.0_r);
    const double got = interlevel_loss(s, w, ps, pw, 1, d);
    const double want =
        reference::interlevel_loss(doubles(s), doubles(w), doubles(ps), doubles(pw), epsilon);
    active += want > 0;
    const Doubles slope = complex_step_gradient(
        [&](const std::vector<Complex>& x) {
          return reference::interlevel_loss(doubles(s), doubles(w), doubles(ps), x, epsilon);
        },
        doubles(pw));
    double tolerance = 1e-300;
    Doubles off_slope(pw.size(), 0.0);
    for (size_t i = 0; i < w.size(); ++i) {
      double bound = 0;
      const auto overlaps = [&](size_t j) { return ps[j + 1] > s[i] && ps[j] <= s[i + 1]; };
      for (size_t j = 0; j < pw.size(); ++j) bound += overlaps(j) ? double{pw[j]} : 0;
      const double missing = std::max(0.0, double{w[i]} - bound), by = double{w[i]} + epsilon;
      tolerance += (2 * missing * off + off * off + 6 * kDouble * missing * missing) / by;
      for (size_t j = 0; j < pw.size(); ++j) off_slope[j] += overlaps(j) ? 2 * off / by : 0;
    }
    tolerance += rounding_bound(static_cast<double>(w.size()), kDouble) * want;
    ASSERT_TRUE(std::isfinite(got) && got >= 0) << got;
    ASSERT_LE(got, total + tolerance);
    value.compare(got, want, tolerance, "bins", w.size(), pw.size());
    for (size_t j = 0; j < pw.size(); ++j) {
      ASSERT_TRUE(std::isfinite(d[j]) && d[j] <= 0) << "bin " << j << ": " << d[j];
      ASSERT_GE(d[j], -2.0 * w.size() - off_slope[j]) << "bin " << j;
      gradient.compare(d[j], slope[j],
                       off_slope[j] + rounding_bound(w.size() + 3.0) * std::fabs(slope[j]) + kTiny,
                       "bins", w.size(), pw.size(), "bin", j);
    }
  };
  for (const size_t n : {size_t{1}, size_t{2}, size_t{17}})
    for (const size_t m : {size_t{1}, size_t{2}, size_t{9}})
      for (const auto& [low, high] : {std::pair{0.0_r, 1.0_r}, {0.0_r, 1e-7_r}})
        for (const std::vector<Real>& s : levels_before(n + 1, low, high))
          for (const std::vector<Real>& ps : levels_before(m + 1, low, high))
            for (const std::vector<Real>& w : weights_before(n))
              for (const std::vector<Real>& pw : weights_before(m)) compare(s, w, ps, pw);
  EXPECT_GT(active, 1000);
  value.report();
  gradient.report();
}

}  // namespace
}  // namespace nerf::stress
