#include "nerf/kernels/roulette.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/kernels/linear_bf16.h"
#include "nerf/math/reference/roulette.h"

namespace nerf {
namespace {

struct Draw {
  Draw(const std::vector<Real>& norms, Real least, double offset)
      : kept(norms.size()), factor(norms.size()) {
    const int64_t count = gradient_roulette(static_cast<int64_t>(norms.size()), norms.data(), least,
                                            offset, kept.data(), factor.data());
    kept.resize(static_cast<size_t>(count));
    factor.resize(kept.size());
  }
  std::vector<int32_t> kept;
  std::vector<Real> factor;
};

// From 1e-6 to 1, every seventh 0.
std::vector<Real> some_norms(size_t n) {
  Random random(51, n, 0);
  std::vector<Real> norms(n);
  for (size_t i = 0; i < n; ++i) {
    norms[i] = std::pow(10.0_r, uniform(random, -6, 0));
    if (i % 7 == 3) norms[i] = 0;
  }
  return norms;
}

double bound_of(const std::vector<Real>& norms, Real least) {
  double sum = 0;
  for (const Real x : norms) sum += static_cast<double>(x);
  return static_cast<double>(least) * sum / static_cast<double>(norms.size());
}

TEST(Roulette, NormsAreSumsOfMagnitudes) {
  WorstError worst("column_norms");
  for (const int64_t n : kCounts)
    for (const int rows : {1, 5, 16})
      for_each_target([&](const std::string&) {
        Random random(50, static_cast<uint64_t>(n), 0);
        const Matrix x(rows, n, random, -1, 1);
        Matrix norms(1, n);
        column_norms(rows, n, x.data.data(), x.ld, norms.data.data());
        norms.expect_untouched_beyond_padding();
        for (int64_t i = 0; i < n; ++i) {
          const double want = reference::column_norm(x.column(i));
          worst.compare(norms.at(0, i), want, rows * kRoundoff * want, "column", i, "of", n);
        }
      });
  worst.report();
}

std::vector<int32_t> some_of(int64_t n, double share, Random& random) {
  std::vector<int32_t> kept;
  for (int32_t i = 0; i < n; ++i)
    if (static_cast<double>(random.uniform()) < share) kept.push_back(i);
  return kept;
}

TEST(Roulette, KeptColumnsMoveToTheFront) {
  for (const int64_t n : kCounts)
    for (const double share : {0.0, 0.1, 0.5, 1.0}) {
      Random random(52, static_cast<uint64_t>(n), static_cast<uint64_t>(10 * share));
      const std::vector<int32_t> kept = some_of(n, share, random);
      const Matrix before(3, n, random, -1, 1);
      for_each_target([&](const std::string&) {
        Matrix x = before;
        keep_columns(3, kept.data(), static_cast<int64_t>(kept.size()), x.data.data(), x.ld);
        x.expect_untouched_beyond_padding();
        for (int k = 0; k < 3; ++k)
          for (size_t j = 0; j < kept.size(); ++j)
            ASSERT_EQ(x.at(k, static_cast<int64_t>(j)), before.at(k, kept[j]))
                << "row " << k << " column " << kept[j] << " of " << n;
      });
    }
}

TEST(Roulette, KeptColumnsOfPairsMoveToTheFront) {
  for (const int rows : {16, 33, 64})
    for (const int64_t n : kCounts)
      for (const double share : {0.0, 0.1, 0.5, 1.0}) {
        Random random(53, static_cast<uint64_t>(n), static_cast<uint64_t>(10 * share));
        const std::vector<int32_t> kept = some_of(n, share, random);
        const size_t size = static_cast<size_t>(pairs_size(rows, n));
        AlignedArray<uint16_t> before(size + 1);  // and one behind them
        for (uint16_t& x : before) x = static_cast<uint16_t>(random.below(1 << 16));
        for_each_target([&](const std::string&) {
          AlignedArray<uint16_t> x = before;
          keep_pairs(rows, kept.data(), static_cast<int64_t>(kept.size()), x.data());
          EXPECT_EQ(x[size], before[size]);
          const auto at = [&](const AlignedArray<uint16_t>& a, int row, int64_t column) {
            return a[static_cast<size_t>(pair_index(rows, row, column))];
          };
          for (int k = 0; k < rows; ++k)
            for (size_t j = 0; j < kept.size(); ++j)
              ASSERT_EQ(at(x, k, static_cast<int64_t>(j)), at(before, k, kept[j]))
                  << "row " << k << " column " << kept[j] << " of " << n;
        });
      }
}

TEST(Roulette, KeepsWhatIsLargeAndOfTheRestWhatTheyAddUpTo) {
  for (const size_t n : {1, 16, 17, 240})
    for (const Real least : {0.0_r, 0.5_r, 1.0_r, 4.0_r})
      for (const double offset : {0.0, 0.3, 0.999}) {
        SCOPED_TRACE("n " + std::to_string(n) + " least " + std::to_string(least));
        const std::vector<Real> norms = some_norms(n);
        const double bound = bound_of(norms, least);
        const Draw draw(norms, least, offset);
        double small = 0;  // expected number of small ones
        size_t large = 0, kept_small = 0;
        for (const Real x : norms) {
          if (static_cast<double>(x) < bound)
            small += static_cast<double>(x) / bound;
          else
            large += x != 0;
        }
        for (size_t j = 0; j < draw.kept.size(); ++j) {
          if (j > 0) {
            ASSERT_GT(draw.kept[j], draw.kept[j - 1]);
          }
          const double norm = norms[static_cast<size_t>(draw.kept[j])];
          ASSERT_GT(norm, 0);
          kept_small += norm < bound;
          EXPECT_NEAR(draw.factor[j], norm < bound ? bound / norm : 1, 1e-6 * (1 + bound / norm));
        }
        EXPECT_EQ(draw.kept.size() - kept_small, large);
        EXPECT_LT(std::fabs(static_cast<double>(kept_small) - small), 1);
      }
}

// The same columns and factors as the template's, whose sums are in double too.
TEST(Roulette, DrawsAreTheTemplates) {
  for (const size_t n : {0, 1, 16, 17, 240, 3000})
    for (const Real least : {0.0_r, 1e-6_r, 0.5_r, 1.0_r, 4.0_r, 1e30_r})
      for (const double offset : {0.0, 0.3, 0.999}) {
        SCOPED_TRACE("n " + std::to_string(n) + " least " + std::to_string(least));
        const std::vector<Real> norms = some_norms(n);
        const std::vector<double> exact(norms.begin(), norms.end());
        const Draw draw(norms, least, offset);
        const auto want = reference::kept_columns(exact, static_cast<double>(least), offset);
        const double bound = reference::roulette_bound(exact, static_cast<double>(least));
        ASSERT_EQ(draw.kept.size(), want.size());
        for (size_t j = 0; j < want.size(); ++j) {
          ASSERT_EQ(static_cast<size_t>(draw.kept[j]), want[j]);
          ASSERT_EQ(draw.factor[j], static_cast<Real>(reference::factor(exact[want[j]], bound)));
        }
      }
}

// Over K offsets at equal distances a column's share of the draws is its chance, but for one draw.
TEST(Roulette, ChancesAreTheSharesOfTheBound) {
  constexpr int kDraws = 1000;
  const std::vector<Real> norms = some_norms(100);
  const double bound = bound_of(norms, 1);
  std::vector<int> times(norms.size());
  for (int k = 0; k < kDraws; ++k)
    for (const int32_t i : Draw(norms, 1, (k + 0.5) / kDraws).kept) ++times[static_cast<size_t>(i)];
  for (size_t i = 0; i < norms.size(); ++i)
    EXPECT_NEAR(times[i], kDraws * std::min(1.0, static_cast<double>(norms[i]) / bound), 1) << i;
}

TEST(Roulette, KeepsWhatIsNotFinite) {
  constexpr Real kInfinity = std::numeric_limits<Real>::infinity();
  const Real nan = std::numeric_limits<Real>::quiet_NaN();
  const std::vector<int32_t> all_but_zero{0, 1, 3};
  for (const Real odd : {kInfinity, nan}) {
    const Draw draw({1e-9_r, odd, 0, 1}, 1, 0.5);
    EXPECT_EQ(draw.kept, all_but_zero);
    for (const Real f : draw.factor) EXPECT_EQ(f, 1);
  }
  EXPECT_TRUE(Draw({}, 1, 0).kept.empty());
  EXPECT_TRUE(Draw({0, 0}, 1, 0.999).kept.empty());
  // What is next to nothing is not enlarged beyond what a float holds.
  for (const double offset : {0.0, 0.5, std::nextafter(1.0, 0.0)})
    for (const Real f : Draw({1e-37_r, 1, 1e-38_r}, 1, offset).factor) EXPECT_LT(f, 2e30);
}

}  // namespace
}  // namespace nerf
