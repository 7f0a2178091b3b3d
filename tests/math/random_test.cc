#include "nerf/math/random.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace nerf {
namespace {

// Chi-square statistic of counts against a uniform distribution, in standard deviations from its
// mean (k - 1, variance 2 (k - 1)): beyond 5 has a chance under 1e-5, and the seeds are fixed.
double chi_square_deviations(const std::vector<int64_t>& counts) {
  double total = 0, sum = 0;
  for (int64_t c : counts) total += static_cast<double>(c);
  const double expected = total / static_cast<double>(counts.size());
  for (int64_t c : counts)
    sum += (static_cast<double>(c) - expected) * (static_cast<double>(c) - expected) / expected;
  const double freedom = static_cast<double>(counts.size()) - 1;
  return (sum - freedom) / std::sqrt(2 * freedom);
}

// Draws along each part of the key and along the dimension; counts 256 bins of single values and
// 32 x 32 bins of neighbouring pairs, which tell a lattice from noise.
TEST(Random, UniformAlongEveryPartOfTheKey) {
  constexpr int kDraws = 1 << 18;
  for (int along = 0; along < 4; ++along) {
    std::vector<int64_t> bins(256), pairs(1024);
    Random fixed(11, 12, 13);
    Real previous = 0;
    double mean = 0;
    for (uint64_t i = 0; i < kDraws; ++i) {
      Random keyed(along == 0 ? i : 7, along == 1 ? i : 8, along == 2 ? i : 9);
      const Real u = along == 3 ? fixed.uniform() : keyed.uniform();
      ASSERT_GE(u, 0.0_r);
      ASSERT_LT(u, 1.0_r);
      ++bins[static_cast<size_t>(u * 256)];
      if (i & 1) ++pairs[static_cast<size_t>(previous * 32) * 32 + static_cast<size_t>(u * 32)];
      previous = u;
      mean += u;
    }
    const double single = chi_square_deviations(bins), pair = chi_square_deviations(pairs);
    EXPECT_LT(std::fabs(single), 5) << "key part " << along;
    EXPECT_LT(std::fabs(pair), 5) << "key part " << along;
    // Standard deviation of a mean of n uniform numbers: 1 / sqrt(12 n).
    EXPECT_NEAR(mean / kDraws, 0.5, 5 / std::sqrt(12.0 * kDraws)) << "key part " << along;
    RecordProperty("deviations_" + std::to_string(along), std::to_string(std::max(single, pair)));
  }
}

TEST(Random, DependsOnTheKeyAlone) {
  std::vector<uint64_t> forwards, backwards;
  for (uint64_t i = 0; i < 100; ++i) forwards.push_back(Random(1, 2, i).bits());
  for (uint64_t i = 100; i-- > 0;) {
    Random other(5, 5, i);
    other.bits();
    backwards.push_back(Random(1, 2, i).bits());
  }
  std::reverse(backwards.begin(), backwards.end());
  EXPECT_EQ(forwards, backwards);

  Random a(3, 4, 5), b(3, 4, 5);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(a.bits(), b.bits());
  Random copy = a;
  EXPECT_EQ(copy.uniform(), a.uniform());
}

TEST(Random, KeysDoNotCollide) {
  std::vector<uint64_t> seen;
  for (uint64_t seed = 0; seed < 30; ++seed)
    for (uint64_t step = 0; step < 30; ++step)
      for (uint64_t index = 0; index < 30; ++index) {
        Random random(seed, step, index);
        for (int k = 0; k < 3; ++k) seen.push_back(random.bits());
      }
  std::sort(seen.begin(), seen.end());
  // 81,000 values of 64 bits: a chance of 2e-10 that two of them are the same.
  EXPECT_EQ(std::adjacent_find(seen.begin(), seen.end()), seen.end());
}

TEST(Random, BelowStaysBelowAndIsUniform) {
  Random random(2, 3, 4);
  for (int i = 0; i < 100; ++i) EXPECT_EQ(random.below(1), 0u);
  for (uint64_t n : {3ull, 10ull, 1000ull}) {
    std::vector<int64_t> bins(n);
    for (int i = 0; i < 200000; ++i) {
      const uint64_t v = random.below(n);
      ASSERT_LT(v, n);
      ++bins[v];
    }
    EXPECT_LT(std::fabs(chi_square_deviations(bins)), 5) << n;
  }
  const uint64_t huge = ~uint64_t{0};
  for (int i = 0; i < 100; ++i) EXPECT_LT(random.below(huge), huge);
  int upper = 0;
  for (int i = 0; i < 1000; ++i) upper += random.below(uint64_t{3} << 62) >= uint64_t{1} << 63;
  EXPECT_NEAR(upper, 1000 / 3.0, 5 * std::sqrt(1000 * 2.0 / 9));
}

}  // namespace
}  // namespace nerf
