#include "nerf/kernels/resampling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/math/step_function.h"

namespace nerf {
namespace {

using Reals = std::vector<Real>;

constexpr size_t kBins[] = {1, 2, 3, 15, 16, 17, 31, 32, 33, 64, 127, 200};

std::vector<double> exact(const Reals& v) { return {v.begin(), v.end()}; }

// Histograms of n bins: even, spread over many orders of magnitude, a single spike, none, small
// enough to be padded, with many bins that are empty.
std::vector<Reals> histograms(size_t n, Random& random) {
  std::vector<Reals> out;
  for (const double decades : {0.0, 6.0, 30.0}) {
    Reals w(n);
    for (Real& v : w) v = static_cast<Real>(std::pow(10.0, uniform(random, -decades, 0)));
    out.push_back(w);
  }
  out.emplace_back(n, 0.0_r);
  out.push_back(out.back());
  out.back()[n / 2] = 1;
  out.push_back(Reals(n, 1e-9_r));
  out.push_back(out[1]);
  for (size_t i = 0; i < n; i += 2) out.back()[i] = 0;
  return out;
}

// n + 1 edges, some of which coincide.
Reals edges_of(size_t n, Random& random) {
  Reals out(n + 1);
  for (Real& v : out) v = uniform(random, 0, 5);
  std::sort(out.begin(), out.end());
  for (size_t i = 4; i < n; i += 7) out[i] = out[i - 1];
  return out;
}

TEST(Resampling, SharesMatchTemplateAndNeverFall) {
  WorstError worst("shares");
  for_each_target([&](const std::string&) {
    Random random(61, 0, 0);
    for (const size_t n : kBins)
      for (const Reals& w : histograms(n, random)) {
        Reals cdf(n + 2, Matrix::kCanary);
        std::vector<double> want(n + 1);
        histogram_cdf(w, std::span(cdf).first(n + 1));
        cumulative_shares<double>(exact(w), want);
        EXPECT_EQ(cdf[0], 0);
        EXPECT_EQ(cdf[n], 1);
        EXPECT_EQ(cdf[n + 1], Matrix::kCanary);
        EXPECT_TRUE(std::is_sorted(cdf.begin(), cdf.end() - 1)) << n << " bins";
        for (size_t i = 0; i <= n; ++i) {
          // Two sums of n terms and a quotient, all of them positive.
          worst.compare(cdf[i], want[i], rounding_bound(2 * static_cast<double>(n) + 3) * want[i],
                        "bins", n, "i", i);
        }
      }
  });
  worst.report();
}

TEST(Resampling, InverseMatchesTemplate) {
  WorstError worst("positions");
  for_each_target([&](const std::string&) {
    Random random(62, 0, 0);
    for (const size_t n : kBins)
      for (const Reals& w : histograms(n, random)) {
        const Reals edges = edges_of(n, random);
        Reals cdf(n + 1);
        histogram_cdf(w, cdf);
        for (const size_t drawn : {size_t{1}, size_t{5}, size_t{16}, size_t{33}, size_t{128}}) {
          Reals u(drawn);
          for (Real& v : u) v = random.uniform();
          // What falls on a border belongs to the bin behind it.
          for (size_t i = 0; i < drawn; i += 3)
            u[i] = std::min(cdf[i % n], 1 - 2 * Real(kRoundoff));
          u[0] = 0;
          std::sort(u.begin(), u.end());
          Reals out(drawn + 1, Matrix::kCanary);
          histogram_inverse(edges, cdf, u, std::span(out).first(drawn));
          std::vector<double> want(drawn);
          invert_sorted<double>(exact(edges), exact(cdf), exact(u), want);
          for (size_t i = 0; i < drawn; ++i) {
            // Difference, mass and quotient are rounded once each, then the width, the product and
            // the sum: relative to the bin's width and to the position.
            const size_t bin = static_cast<size_t>(
                std::upper_bound(cdf.begin() + 1, cdf.end() - 1, u[i]) - cdf.begin() - 1);
            const double width = static_cast<double>(edges[bin + 1]) - edges[bin];
            worst.compare(out[i], want[i],
                          rounding_bound(5) * width + kRoundoff * std::fabs(want[i]), "bins", n,
                          "of", drawn, "i", i);
          }
          EXPECT_EQ(out[drawn], Matrix::kCanary);
        }
      }
  });
  worst.report();
}

TEST(Resampling, AnnealedWeightsMatchTemplate) {
  WorstError worst("annealed");
  for_each_target([&](const std::string&) {
    Random random(63, 0, 0);
    for (const size_t n : kBins)
      for (const Reals& w : histograms(n, random)) {
        const Reals edges = edges_of(n, random);
        for (const Real exponent : {0.0_r, 0.1_r, 0.5_r, 0.999_r, 1.0_r}) {
          Reals out(n + 1, Matrix::kCanary);
          std::copy(w.begin(), w.end(), out.begin());
          const std::span<Real> in_place = std::span(out).first(n);
          histogram_anneal(edges, in_place, exponent, in_place);
          std::vector<double> want(n);
          anneal_weights<double>(exact(edges), exact(w), exponent, want);
          // Log is within 4 units in the last place, Exp within one; an exponent's error counts as
          // a share of the power.
          double of_powers = 0;
          for (const Real v : w)
            if (v > 0 && exponent != 1)
              of_powers = std::max(of_powers, 9 * exponent * std::fabs(std::log(double{v})) + 2);
          const double bound = rounding_bound(2 * of_powers + static_cast<double>(n) + 2);
          for (size_t i = 0; i < n; ++i)
            worst.compare(out[i], want[i], bound * want[i] + 1e-37, "bins", n, "exponent", exponent,
                          "i", i);
          EXPECT_EQ(out[n], Matrix::kCanary);
        }
      }
  });
  worst.report();
}

}  // namespace
}  // namespace nerf
