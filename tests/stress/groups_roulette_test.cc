// Means over groups of samples and Russian roulette, on numbers of every magnitude.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/kernels/bf16.h"
#include "nerf/kernels/linear_bf16.h"
#include "nerf/kernels/roulette.h"
#include "nerf/kernels/sample_groups.h"
#include "stress/magnitudes.h"

namespace nerf::stress {
namespace {

constexpr int kRows = 5;
constexpr int64_t kSamples[] = {0, 1, 17, 240};
// Powers of ten of what is averaged and of its gradient, and of the samples' shares.
struct Sizes {
  double x_low, x_high, dy_low, dy_high, share_low;
};
constexpr Sizes kSizes[] = {{-18, 18, -18, 8, -38},
                            {15, 35, -20, -9, -2},
                            {-44, -30, -44, -30, -44},
                            {-44, -1, 20, 35, -44}};

// Groups of 1 to `longest` samples; every seventh sample belongs to none.
struct Groups {
  Groups(int64_t n, uint64_t longest, const Sizes& sizes)
      : x(kRows, n), y(kRows, n), dy(kRows, n), samples(n) {
    Random random(61, static_cast<uint64_t>(n), longest);
    const size_t padded = static_cast<size_t>(x.padded);
    of.assign(padded, 0);
    share.assign(padded, 0);
    per_light.assign(padded, 0);
    uint64_t left = 0;
    for (size_t i = 0; i < padded; ++i) {
      const bool used = static_cast<int64_t>(i) < n;
      if (used && left == 0) left = 1 + random.below(longest), ++count;
      of[i] = count - 1;
      if (!used) continue;
      --left;
      if (i % 7 == 6) continue;
      share[i] = std::fabs(any_size(random, sizes.share_low, 0));
      per_light[i] = std::fabs(any_size(random, 0, 10));
    }
    for (Matrix* m : {&x, &y, &dy})
      for (int k = 0; k < kRows; ++k)
        for (int64_t i = 0; i < m->padded; ++i)
          m->at(k, i) = m == &dy ? any_size(random, sizes.dy_low, sizes.dy_high)
                                 : any_size(random, sizes.x_low, sizes.x_high);
  }
  SampleGroups groups() const {
    return {samples, count, of.data(), share.data(), per_light.data()};
  }
  Matrix mean() const {
    Matrix out = y;
    mean_of_groups_forward(groups(), kRows, x.data.data(), x.ld, out.data.data(), out.ld);
    return out;
  }

  Matrix x, y, dy;
  int64_t samples;
  int count = 0;
  std::vector<int32_t> of;
  std::vector<Real> share, per_light;
};

// A mean is a sum of products in any order; each product and sum below the normal numbers may be 0,
// and so may each factor where denormals are flushed: the other one times kTiny.
TEST(StressGroups, MeansOfEveryMagnitude) {
  WorstError worst("means");
  for (const int64_t n : kSamples)
    for (const uint64_t longest : {1, 7, 500})
      for (const Sizes& sizes : kSizes) {
        const Groups g(n, longest, sizes);
        Matrix got = g.y;
        for_each_mode(
            [&] { got = g.mean(); },
            [&] {
              for (int k = 0; k < kRows; ++k) {
                std::vector<double> sum(static_cast<size_t>(g.count)), size(sum), off(sum);
                for (int64_t i = 0; i < n; ++i) {
                  const size_t s = static_cast<size_t>(i);
                  const size_t to = static_cast<size_t>(g.of[s]);
                  const double share = g.share[s], x = g.x.at(k, i);
                  sum[to] += share * x;
                  size[to] += std::fabs(share * x);
                  off[to] += kTiny * (2 + share + std::fabs(x));
                }
                for (size_t to = 0; to < sum.size(); ++to) {
                  const double mean = got.at(k, static_cast<int64_t>(to));
                  ASSERT_TRUE(std::isfinite(mean));
                  worst.compare(mean, sum[to],
                                rounding_bound(static_cast<double>(n) + 1) * size[to] + off[to],
                                "row", k, "group", to, "samples", n);
                }
              }
            });
      }
  worst.report();
}

// A weight's gradient is a sum over rows of slopes times differences, times what a mean grows by;
// both gradients are added to what is there.
TEST(StressGroups, GradientsOfEveryMagnitude) {
  WorstError of_weight("of_weight"), of_x("of_x");
  for (const int64_t n : kSamples)
    for (const uint64_t longest : {1, 7, 500})
      for (const Sizes& sizes : kSizes) {
        if (sizes.x_high + sizes.dy_high + 10 > 37) continue;  // beyond the largest float
        const Groups g(n, longest, sizes);
        Random random(62, 0, 0);
        Matrix before(kRows + 1, n);
        for (int k = 0; k <= kRows; ++k)
          for (int64_t i = 0; i < before.padded; ++i) before.at(k, i) = any_size(random, -30, 1);
        Matrix dx(kRows, n), dw(1, n);
        for_each_mode(
            [&] {
              for (int64_t i = 0; i < before.padded; ++i) {
                dw.at(0, i) = before.at(kRows, i);
                for (int k = 0; k < kRows; ++k) dx.at(k, i) = before.at(k, i);
              }
              mean_of_groups_backward(g.groups(), kRows, g.x.data.data(), g.x.ld, g.y.data.data(),
                                      g.dy.data.data(), g.y.ld, dw.data.data(), dx.data.data());
            },
            [&] {
              for (int64_t i = 0; i < n; ++i) {
                const size_t s = static_cast<size_t>(i);
                double want = 0, size = 0, off = 0;
                for (int k = 0; k < kRows; ++k) {
                  const double slope = g.dy.at(k, g.of[s]), x = g.x.at(k, i),
                               mean = g.y.at(k, g.of[s]), share = g.share[s], had = before.at(k, i);
                  want += slope * (x - mean);
                  size += std::fabs(slope) * (std::fabs(x) + std::fabs(mean));
                  off += kTiny * (2 + 3 * std::fabs(slope) + std::fabs(x) + std::fabs(mean));
                  ASSERT_TRUE(std::isfinite(dx.at(k, i)));
                  of_x.compare(dx.at(k, i), had + share * slope,
                               rounding_bound(2) * (std::fabs(had) + std::fabs(share * slope)) +
                                   kTiny * (2 + share + std::fabs(slope)),
                               "row", k, "sample", i, "of", n);
                }
                const double had = before.at(kRows, i), by = g.per_light[s];
                ASSERT_TRUE(std::isfinite(dw.at(0, i)));
                of_weight.compare(
                    dw.at(0, i), had + by * want,
                    rounding_bound(kRows + 4) * (std::fabs(had) + by * size) + by * off + 2 * kTiny,
                    "sample", i, "of", n);
              }
            });
      }
  of_weight.report();
  of_x.report();
}

// What is not finite stays in its group: all others keep every bit.
TEST(StressGroups, ABrokenGroupTouchesNoOther) {
  for_each_target([&](const std::string&) {
    for (const uint64_t longest : {1, 3, 40})
      for (const Real odd : {kInf, Real{NAN}})
        for (const int64_t at : {0, 7, 8, 31, 100}) {
          const Groups g(240, longest, kSizes[0]);
          Groups broken = g;
          const int32_t group = g.of[static_cast<size_t>(at)];
          broken.share[static_cast<size_t>(at)] = 1;
          for (int k = 0; k < kRows; ++k) broken.x.at(k, at) = odd;
          Groups whole = g;
          whole.share[static_cast<size_t>(at)] = 1;
          const Matrix want = whole.mean(), got = broken.mean();
          for (int k = 0; k < kRows; ++k)
            for (int32_t i = 0; i < g.count; ++i) {
              if (i == group) {
                ASSERT_FALSE(std::isfinite(got.at(k, i)));
              } else {
                ASSERT_EQ(got.at(k, i), want.at(k, i)) << "group " << i << " beside " << group;
              }
            }
        }
  });
}

// Sums of magnitudes in any order, none of which cancels; finite but where a column is not.
TEST(StressRoulette, NormsOfEveryMagnitude) {
  WorstError worst("norms");
  for (const int rows : {1, 5, 64})
    for (const auto& [low, high] : {std::pair{-18.0, 18.0}, {-45.0, -36.0}, {30.0, 36.0}}) {
      constexpr int64_t kCount = 113;
      Random random(63, static_cast<uint64_t>(rows), 0);
      Matrix x(rows, kCount), norms(1, kCount);
      for (int k = 0; k < rows; ++k)
        for (int64_t i = 0; i < x.padded; ++i) x.at(k, i) = any_size(random, low, high);
      for (int64_t i = 0; i < kCount; i += 29) x.at(rows - 1, i) = i % 2 ? -kInf : Real{NAN};
      for_each_mode([&] { column_norms(rows, kCount, x.data.data(), x.ld, norms.data.data()); },
                    [&] {
                      for (int64_t i = 0; i < kCount; ++i) {
                        if (i % 29 == 0) {
                          ASSERT_FALSE(std::isfinite(norms.at(0, i))) << i;
                          continue;
                        }
                        double want = 0;
                        for (const double v : x.column(i)) want += std::fabs(v);
                        ASSERT_TRUE(norms.at(0, i) >= 0) << i;
                        worst.compare(norms.at(0, i), want,
                                      rounding_bound(rows) * want + 2 * rows * kTiny, "column", i,
                                      "rows", rows, "size", high);
                      }
                    });
    }
  worst.report();
}

// Columns are moved, not computed with: every bit of a denormal, a zero of either sign, an infinity
// and of what is no number.
TEST(StressRoulette, KeptColumnsKeepEveryBit) {
  std::vector<Real> values = all_magnitudes(0x1ffff1, true);
  values.push_back(Real{NAN});
  values.push_back(-0.0_r);
  const Matrix before = row_of(values);
  for (const int64_t each : {1, 2, 15, 16, 40}) {
    std::vector<int32_t> kept;
    for (int64_t i = each - 1; i < before.n; i += each) kept.push_back(static_cast<int32_t>(i));
    Matrix x = before;
    for_each_mode(
        [&] {
          std::memcpy(x.data.data(), before.data.data(), before.data.size() * sizeof(Real));
          keep_columns(1, kept.data(), static_cast<int64_t>(kept.size()), x.data.data(), x.ld);
        },
        [&] {
          for (size_t j = 0; j < kept.size(); ++j)
            ASSERT_EQ(
                std::memcmp(&x.data[j], &before.data[static_cast<size_t>(kept[j])], sizeof(Real)),
                0)
                << "column " << kept[j] << ": " << x.data[j];
        });
  }
}

// The pairs of the columns that are kept, whatever they hold: as if these had been rounded after
// they were moved.
TEST(StressRoulette, KeptPairsAreTheKeptColumns) {
  std::vector<Real> values = all_magnitudes(0x1ffff1, true);
  constexpr double kMostOfFloat = std::numeric_limits<float>::max();
  std::erase_if(values, [](Real v) { return std::isfinite(v) && std::fabs(v) > kMostOfFloat; });
  values.push_back(Real{NAN});
  values.push_back(-0.0_r);
  const int64_t n = static_cast<int64_t>(values.size());
  const auto pair = [](Real v) {
    const float x = static_cast<float>(v);
    uint16_t bits = 0;
    round_to_bf16(1, &x, &bits);
    return bits;
  };
  Matrix before(kRows, n);
  AlignedArray<uint16_t> pairs_before(static_cast<size_t>(pairs_size(kRows, n)));
  for (int k = 0; k < kRows; ++k)
    for (int64_t i = 0; i < n; ++i) {
      before.at(k, i) = values[static_cast<size_t>(i + 17 * k) % values.size()];
      pairs_before[static_cast<size_t>(pair_index(kRows, k, i))] = pair(before.at(k, i));
    }
  for (const int64_t each :
       {int64_t{1}, int64_t{2}, int64_t{15}, int64_t{16}, int64_t{40}, n + 1}) {
    std::vector<int32_t> kept;
    for (int64_t i = each - 1; i < n; i += each) kept.push_back(static_cast<int32_t>(i));
    const int64_t count = static_cast<int64_t>(kept.size());
    Matrix x = before;
    AlignedArray<uint16_t> pairs = pairs_before;
    for_each_mode(
        [&] {
          std::memcpy(x.data.data(), before.data.data(), before.data.size() * sizeof(Real));
          std::copy(pairs_before.begin(), pairs_before.end(), pairs.begin());
          keep_columns(kRows, kept.data(), count, x.data.data(), x.ld);
          keep_pairs(kRows, kept.data(), count, pairs.data());
        },
        [&] {
          for (int k = 0; k < kRows; ++k)
            for (int64_t j = 0; j < count; ++j)
              ASSERT_EQ(pairs[static_cast<size_t>(pair_index(kRows, k, j))], pair(x.at(k, j)))
                  << "row " << k << " column " << kept[static_cast<size_t>(j)] << ": "
                  << x.at(k, j);
        });
  }
}

// Norms, bounds and draws of every size: large columns are kept as they are, each small one that is
// kept stands for the bound, and as many are kept as the chances add up to. No factor is infinite.
TEST(StressRoulette, DrawsOfEveryMagnitude) {
  WorstError worst("stands_for");
  std::vector<std::vector<Real>> cases = {{kMax, kMax, kMax}, {kDenormal, kDenormal}, {kMax, 1, 0}};
  std::vector<Real> all = all_magnitudes(0x1ffff1, false);
  std::erase_if(all, [](Real v) { return v == kInf; });
  cases.push_back(all);
  std::erase_if(all, [](Real v) { return v > 1e-38_r; });
  cases.push_back(all);
  cases.push_back(std::vector<Real>(999, 1e-42_r));
  cases.back()[500] = 1;
  for (const std::vector<Real>& norms : cases)
    for (const Real least : {0.0_r, 1e-30_r, 0.5_r, 1.0_r, 1e30_r})
      for (const double offset : {0.0, 0.5, std::nextafter(1.0, 0.0)}) {
        const int64_t n = static_cast<int64_t>(norms.size());
        std::vector<int32_t> kept(norms.size());
        std::vector<Real> factor(norms.size());
        const int64_t count =
            gradient_roulette(n, norms.data(), least, offset, kept.data(), factor.data());
        double bound = 0, chances = 0;
        for (const Real x : norms) bound += double{x};
        bound *= double{least} / static_cast<double>(n);
        if (!std::isfinite(bound)) bound = 0;  // all are kept; of Reals that are double
        int64_t large = 0, kept_large = 0;
        for (const Real x : norms) {
          large += x > 0 && x >= bound;
          chances += x < bound ? x / bound : 0;
        }
        for (int64_t j = 0; j < count; ++j) {
          const size_t at = static_cast<size_t>(j);
          if (j > 0) {
            ASSERT_GT(kept[at], kept[at - 1]);
          }
          const double norm = norms[static_cast<size_t>(kept[at])];
          ASSERT_TRUE(std::isfinite(factor[at]) && factor[at] >= 1) << factor[at];
          ASSERT_GT(norm, 0);
          kept_large += norm >= bound;
          if (norm >= bound) {
            ASSERT_EQ(factor[at], 1);
          } else {
            worst.compare(factor[at] * norm, bound, rounding_bound(3) * bound, "norm", norm,
                          "least", least);
          }
        }
        ASSERT_EQ(kept_large, large) << "least " << least;
        // Chances below 1e-30 are none.
        ASSERT_LT(std::fabs(static_cast<double>(count - large) - chances), 1 + 1e-9) << least;
      }
  worst.report();
}

}  // namespace
}  // namespace nerf::stress
