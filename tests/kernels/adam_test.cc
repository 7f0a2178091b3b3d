#include "nerf/kernels/adam.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "base/half.h"
#include "kernels/exact_adam.h"
#include "kernels/kernel_test.h"
#include "kernels/row_states.h"

namespace nerf {
namespace {

struct State {
  State(size_t n, Random& random) : gradient(n), m(n), v(n), w(n) {
    for (size_t i = 0; i < n; ++i) {
      gradient[i] = uniform(random, -1, 1) * std::pow(10.0_r, uniform(random, -6, 1));
      m[i] = uniform(random, -1, 1) * 0.1_r;
      v[i] = uniform(random, 1e-3, 1) * 0.1_r;
      w[i] = uniform(random, -1, 1);
    }
  }
  AlignedArray<Real> gradient, m, v, w;
};

TEST(Adam, DenseStep) {
  WorstError worst("dense");
  for_each_target([&](const std::string&) {
    Random random(41, 0, 0);
    for (const AdamStep& options :
         {AdamStep{},
          AdamStep{
              .rate = 0.3_r, .beta1 = 0.8_r, .beta2 = 0.999_r, .epsilon = 1e-3_r, .l2 = 0.01_r}})
      for (int64_t step : {1, 2, 17, 1000, 1000000})
        for (int64_t n : {0, 16, 32, 240}) {
          // 16 more that must not change.
          State s(static_cast<size_t>(n) + 16, random);
          const State before = s;
          adam_dense(options, step, n, s.gradient.data(), s.m.data(), s.v.data(), s.w.data());
          for (size_t i = 0; i < s.w.size(); ++i) {
            ASSERT_EQ(s.gradient[i], before.gradient[i]);
            if (static_cast<int64_t>(i) >= n) {
              ASSERT_EQ(s.w[i], before.w[i]) << "beyond n";
              ASSERT_EQ(s.m[i], before.m[i]) << "beyond n";
              ASSERT_EQ(s.v[i], before.v[i]) << "beyond n";
              continue;
            }
            const ExactStep want(options, step, before.gradient[i], before.m[i], before.v[i],
                                 before.w[i]);
            worst.compare(s.m[i], want.m, want.m_error, "m, step", step, "element", i);
            worst.compare(s.v[i], want.v, want.v_error, "v, step", step, "element", i);
            worst.compare(s.w[i], want.w, want.w_error, "weight, step", step, "element", i);
          }
        }
  });
  worst.report();
}

// Weights without any gradient stay where they are: no 0 / 0.
TEST(Adam, ZeroGradientFromTheStartMovesNothing) {
  for_each_target([&](const std::string&) {
    AlignedArray<Real> g(16), m(16), v(16), w(16);
    for (Real& x : w) x = 0.75_r;
    adam_dense(AdamStep{}, 1, 16, g.data(), m.data(), v.data(), w.data());
    for (Real x : w) EXPECT_EQ(x, 0.75_r);
  });
}

TEST(Adam, BiasCorrections) {
  const AdamStep o{.rate = 1, .beta1 = 0.9_r, .beta2 = 0.99_r, .epsilon = 0, .l2 = 0};
  std::vector<Real> c(2 * kBiasCorrections);
  bias_corrections(o, c.data());
  for (int t = 1; t < kBiasCorrections; ++t) {
    const size_t at = static_cast<size_t>(2 * t);
    const double b1 = o.beta1, b2 = o.beta2;
    EXPECT_FLOAT_EQ(c[at], static_cast<Real>(1 / (1 - std::pow(b1, t)))) << t;
    EXPECT_FLOAT_EQ(c[at + 1], static_cast<Real>(1 / std::sqrt(1 - std::pow(b2, t)))) << t;
  }
  EXPECT_EQ(c[2 * kBiasCorrections - 2], 1.0_r);
  EXPECT_EQ(c[2 * kBiasCorrections - 1], 1.0_r);
  EXPECT_TRUE(std::isfinite(c[0]) && std::isfinite(c[1]));
}

// Marked rows are listed once each, in order, whatever their mark; the marks are cleared, and none
// beyond the rows are read as theirs.
TEST(Adam, MarkedRowsAreListed) {
  for_each_target([&](const std::string&) {
    Random random(44, 0, 0);
    for (const size_t rows : {0, 8, 56, 64, 72, 128, 1000})
      for (const Real share : {0.0_r, 0.02_r, 0.5_r, 1.0_r}) {
        AlignedArray<uint8_t> marks(rows + 64);
        std::vector<uint32_t> want;
        for (size_t row = 0; row < marks.size(); ++row) {
          if (row < rows && random.uniform() >= share) continue;
          marks[row] = row % 3 ? 1 : 0x80;
          if (row < rows) want.push_back(static_cast<uint32_t>(row));
        }
        std::vector<uint32_t> list(rows + 1, 77u);
        ASSERT_EQ(list_rows(static_cast<int64_t>(rows), marks.data(), list.data()),
                  static_cast<int64_t>(want.size()));
        EXPECT_EQ(list.back(), 77u) << "beyond the room for all rows";
        list.resize(want.size());
        EXPECT_EQ(list, want);
        for (size_t row = 0; row < marks.size(); ++row)
          ASSERT_EQ(marks[row] != 0, row >= rows) << row;
      }
  });
}

// Rows touched at random, each with its own counter: touched ones step, the others keep every bit.
TEST(Adam, RowsStepAloneAndUntouchedOnesKeepEveryBit) {
  WorstError worst("rows");
  for_each_target([&](const std::string&) {
    Random random(42, 0, 0);
    const AdamStep options{
        .rate = 0.02_r, .beta1 = 0.9_r, .beta2 = 0.99_r, .epsilon = 1e-15_r, .l2 = 1e-3_r};
    std::vector<Real> correction(2 * kBiasCorrections);
    bias_corrections(options, correction.data());
    for (const size_t features : {size_t{4}, size_t{2}})
      for (int64_t rows : {0, 1, 8, 16, 31, 32, 33, 240}) {
        State s(static_cast<size_t>(rows) * features, random);
        std::vector<Real> steps(static_cast<size_t>(rows));
        const Real counters[] = {0, 1, 5, 999, 4094, 4095, 4096, 65533, 65534, 65535};
        for (Real& t : steps) t = counters[random.below(std::size(counters))];
        const State before = s;
        const std::vector<Real> steps_before = steps;
        RowStates states(steps.size(), static_cast<int>(features));
        states.set(s.gradient, s.m, s.v, steps);
        std::vector<bool> touched(steps.size());
        for (size_t r = 0; r < touched.size(); ++r)
          states.marks[r] = touched[r] = random.uniform() < 0.3_r;
        states.take_marked();
        adam_rows(options, static_cast<int>(features), states.list(), states.count(),
                  states.gradient.data(), states.data(), s.w.data(), correction.data());
        states.take(s.gradient, s.m, s.v, steps);
        for (size_t r = 0; r < touched.size(); ++r) {
          if (!touched[r]) {
            ASSERT_EQ(steps[r], steps_before[r]) << r;
            for (const auto member : {&State::gradient, &State::m, &State::v, &State::w})
              ASSERT_EQ(
                  std::memcmp((s.*member).data() + features * r,
                              (before.*member).data() + features * r, features * sizeof(Real)),
                  0)
                  << "row " << r;
            continue;
          }
          const int64_t step = static_cast<int64_t>(std::min(65535.0_r, steps_before[r] + 1));
          ASSERT_EQ(steps[r], static_cast<Real>(step));
          for (size_t i = features * r; i < features * (r + 1); ++i) {
            ASSERT_EQ(s.gradient[i], 0);
            const ExactStep want(options, step, before.gradient[i], before.m[i], before.v[i],
                                 before.w[i]);
            worst.compare(s.m[i], want.m, want.m_error, "m, step", step, "row", r);
            worst.compare(s.v[i], want.v, want.v_error, "v, step", step, "row", r);
            worst.compare(s.w[i], want.w, want.w_error, "weight, step", step, "row", r);
          }
        }
      }
  });
  worst.report();
}

// Weights that stand in the states go where those of a table do, bit for bit, and the table
// receives them rounded; that of other rows stays.
TEST(Adam, RowsOfHalfFloatsAreRoundedFromTheirWeights) {
  for_each_target([&](const std::string& target) {
    Random random(45, 0, 0);
    const AdamStep options{.rate = 1e-4_r};
    std::vector<Real> correction(2 * kBiasCorrections);
    bias_corrections(options, correction.data());
    for (const size_t features : {size_t{4}, size_t{2}}) {
      constexpr size_t kRows = 3000;
      State s(kRows * features, random);
      // From below the least half to beyond the largest, and what is no number.
      for (Real& w : s.w) w *= std::pow(10.0_r, uniform(random, -9, 6));
      s.w[1] = std::numeric_limits<Real>::quiet_NaN();
      RowStates apart(kRows, static_cast<int>(features)), within(kRows, static_cast<int>(features));
      const std::vector<Real> steps(kRows, 3.0_r);
      for (RowStates* states : {&apart, &within}) states->set(s.gradient, s.m, s.v, steps);
      within.set(kRowWeights, s.w);
      for (size_t row = 0; row < kRows; ++row)
        apart.marks[row] = within.marks[row] = row < 2 || random.uniform() < 0.3_r;
      const AlignedArray<uint8_t> touched = apart.marks;
      const AlignedArray<Real> before = s.w;
      constexpr uint16_t kOld = 0x1234;
      AlignedArray<uint16_t> rounded(s.w.size());
      std::ranges::fill(rounded, kOld);
      apart.take_marked();
      within.take_marked();
      adam_rows(options, static_cast<int>(features), apart.list(), apart.count(),
                apart.gradient.data(), apart.data(), s.w.data(), correction.data());
      adam_rows(options, static_cast<int>(features), within.list(), within.count(),
                within.gradient.data(), within.data(), rounded.data(), correction.data());
      const auto bits = [](const std::vector<Real>& values) {
        return std::string(reinterpret_cast<const char*>(values.data()),
                           values.size() * sizeof(Real));
      };
      for (const RowPart part : {kRowM, kRowV, kRowSteps})
        EXPECT_EQ(bits(apart.part(part)), bits(within.part(part))) << part;
      EXPECT_TRUE(std::ranges::equal(apart.gradient, within.gradient));
      const std::vector<Real> weights = within.part(kRowWeights);
      EXPECT_EQ(bits(weights), bits({s.w.begin(), s.w.end()}));
      for (size_t i = 0; i < weights.size(); ++i) {
        if (!touched[i / features]) {
          ASSERT_EQ(rounded[i], kOld) << i;
        } else if (std::isnan(weights[i])) {
          ASSERT_TRUE(std::isnan(internal::half_to_float(rounded[i])));
        } else {
          ASSERT_EQ(rounded[i], internal::float_to_half(static_cast<float>(weights[i])))
              << target << ": " << weights[i] << " was " << before[i];
        }
      }
    }
  });
}

// Rows that are touched in every step go where dense parameters go: the moments bit for bit, the
// weights up to the one rounding by which the two corrections differ.
TEST(Adam, RowsTouchedEveryStepEqualDense) {
  WorstError worst("rows_against_dense");
  for_each_target([&](const std::string&) {
    Random random(43, 0, 0);
    constexpr size_t kRows = 24, kSize = 4 * kRows;
    constexpr int kSteps = 50;
    const AdamStep options{};
    std::vector<Real> correction(2 * kBiasCorrections);
    bias_corrections(options, correction.data());
    State rows(kSize, random);
    std::fill(rows.m.begin(), rows.m.end(), 0.0_r);
    std::fill(rows.v.begin(), rows.v.end(), 0.0_r);
    State dense = rows;
    std::vector<Real> steps(kRows);
    for (int step = 1; step <= kSteps; ++step) {
      for (size_t i = 0; i < kSize; ++i)
        rows.gradient[i] = dense.gradient[i] = uniform(random, -1, 1);
      RowStates states(kRows, 4);
      states.set(rows.gradient, rows.m, rows.v, steps);
      std::ranges::fill(states.marks, uint8_t{1});
      states.take_marked();
      adam_rows(options, 4, states.list(), states.count(), states.gradient.data(), states.data(),
                rows.w.data(), correction.data());
      states.take(rows.gradient, rows.m, rows.v, steps);
      adam_dense(options, step, kSize, dense.gradient.data(), dense.m.data(), dense.v.data(),
                 dense.w.data());
      ASSERT_EQ(std::memcmp(rows.m.data(), dense.m.data(), kSize * sizeof(Real)), 0) << step;
      ASSERT_EQ(std::memcmp(rows.v.data(), dense.v.data(), kSize * sizeof(Real)), 0) << step;
    }
    // Each step moves a weight by at most rate (1 - beta1) / sqrt(1 - beta2) = rate (Kingma and Ba,
    // section 2.1), of which two roundings may differ, and each result is rounded once in either.
    const double tolerance = kSteps * kRoundoff * (3 * options.rate + 2 * 1.5);
    for (size_t i = 0; i < kSize; ++i)
      worst.compare(rows.w[i], dense.w[i], tolerance, "element", i);
  });
  worst.report();
}

}  // namespace
}  // namespace nerf
