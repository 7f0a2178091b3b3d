#include "nerf/kernels/hash_grid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/half.h"
#include "golden/golden.h"
#include "kernels/hash_grid_levels.h"
#include "kernels/kernel_test.h"
#include "kernels/row_states.h"
#include "math/worst_error.h"
#include "nerf/math/reference/hash_grid.h"

namespace nerf {
namespace {

namespace ref = reference;

TEST(HashGrid, Forward) {
  WorstError worst("forward");
  for_each_target([&](const std::string&) {
    Random random(31, 0, 0);
    for (const HashGridLevel& level : levels()) {
      AlignedArray<Real> table(size_of(level));
      for (Real& v : table) v = uniform(random, -1, 1);
      const std::vector<double> exact(table.begin(), table.end());
      for (int64_t n : kCounts) {
        const Positions positions(n, random);
        Matrix features(level.features, n);
        hash_grid_forward(level, table.data(), positions.row(0), positions.row(1), positions.row(2),
                          n, features.data.data(), features.ld);
        for (int64_t s = 0; s < n; ++s) {
          const auto want = ref::grid_interpolate(reference_level(level), exact, positions.at(s));
          // Entries of at most 1: the weights' errors, two products each, and a sum of 8.
          const double tolerance = 2 * place_error(level) + rounding_bound(2 + 8);
          for (int f = 0; f < level.features; ++f)
            worst.compare(features.at(f, s), want[static_cast<size_t>(f)], tolerance, "scale",
                          level.scale, "dense", level.dense, "n", n, "sample", s, "feature", f);
        }
        features.expect_untouched_beyond_padding();
      }
    }
  });
  worst.report();
}

// Half floats are looked up as the numbers that they are, those below the least normal one too.
TEST(HashGrid, ForwardOfHalfFloatsIsThatOfTheirNumbers) {
  for_each_target([&](const std::string& target) {
    Random random(33, 0, 0);
    for (const HashGridLevel& level : levels()) {
      AlignedArray<uint16_t> half(size_of(level));
      AlignedArray<Real> table(half.size());
      for (size_t i = 0; i < half.size(); ++i) {
        half[i] = static_cast<uint16_t>(random.below(0x7c00) | random.below(2) << 15);
        table[i] = static_cast<Real>(internal::half_to_float(half[i]));
      }
      for (int64_t n : kCounts) {
        const Positions at(n, random);
        Matrix want(level.features, n), got(level.features, n);
        hash_grid_forward(level, table.data(), at.row(0), at.row(1), at.row(2), n, want.data.data(),
                          want.ld);
        hash_grid_forward(level, half.data(), at.row(0), at.row(1), at.row(2), n, got.data.data(),
                          got.ld);
        for (int f = 0; f < level.features; ++f)
          for (int64_t s = 0; s < n; ++s)
            ASSERT_EQ(got.at(f, s), want.at(f, s))
                << target << ", scale " << level.scale << ", feature " << f << ", sample " << s;
        got.expect_untouched_beyond_padding();
      }
    }
  });
}

// Table gradients are the sum over samples of the template's; rows that no sample reaches stay as
// they were and unmarked, whatever was in the gradient before is added to.
TEST(HashGrid, BackwardIsTheSumOverSamples) {
  WorstError worst("backward");
  for_each_target([&](const std::string&) {
    Random random(32, 0, 0);
    for (const HashGridLevel& level : levels()) {
      const ref::GridLevel exact_level = reference_level(level);
      const size_t features = exact_level.features;
      for (int64_t n : kCounts) {
        const Positions positions(n, random);
        Matrix g(level.features, n, random, -1, 1, Matrix::Padding::kZero);
        for (int64_t s = 0; s < n; s += 3)  // a third of the samples has no gradient
          for (int f = 0; f < level.features; ++f) g.at(f, s) = 0;
        RowStates states(level.entries, level.features);
        // Some rows already hold a gradient from an earlier chunk, and some are marked.
        const AlignedArray<Real>& gradient = states.gradient;
        std::vector<double> want(gradient.size());
        for (size_t i = 0; i < gradient.size(); i += 7) want[i] = states.gradient[i] = 0.25_r;
        for (size_t row = 0; row < level.entries; row += 14) states.marks[row] = 1;
        hash_grid_backward(level, positions.row(0), positions.row(1), positions.row(2), n,
                           g.data.data(), g.ld, states.gradient.data(), states.marks.data());

        std::vector<double> size = want;  // sum of magnitudes, for the tolerance
        std::vector<double> most(level.entries);
        std::vector<bool> reached(level.entries);
        for (int64_t s = 0; s < n; ++s) {
          std::vector<double> d(features), absolute(features);
          double largest = 0;
          for (size_t f = 0; f < features; ++f) {
            d[f] = g.at(static_cast<int>(f), s);
            absolute[f] = std::fabs(d[f]);
            largest = std::max(largest, absolute[f]);
          }
          if (largest == 0) continue;
          ref::grid_interpolate_backward(exact_level, positions.at(s), d, want);
          ref::grid_interpolate_backward(exact_level, positions.at(s), absolute, size);
          for (const auto& c : ref::grid_corners<double>(exact_level, positions.at(s))) {
            reached[c.row] = true;
            most[c.row] += largest;
          }
        }
        for (uint32_t row = 0; row < level.entries; ++row) {
          ASSERT_LE(states.marks[row], 1) << "row " << row;
          double sum = 0;
          for (size_t f = 0; f < features; ++f) {
            const size_t i = row * features + f;
            // n + 1 additions of products of 4; the weights' errors times the gradients.
            worst.compare(gradient[i], want[i],
                          rounding_bound(static_cast<double>(n) + 4) * size[i] +
                              place_error(level) * most[row],
                          "scale", level.scale, "dense", level.dense, "n", n, "row", row, "feature",
                          f);
            sum += std::fabs(want[i]);
          }
          // A corner of weight ~0 may fall to the neighbouring cell where the place was rounded.
          if (reached[row] && sum > 1 + 8 * place_error(level)) {
            ASSERT_EQ(states.marks[row], 1) << "row " << row;
          }
          if (!states.marks[row]) {
            for (size_t f = 0; f < features; ++f)
              ASSERT_EQ(gradient[row * features + f],
                        (row * features + f) % 7 == 0 ? 0.25_r : 0.0_r)
                  << "row " << row << " changed but is not marked";
          }
        }
      }
    }
  });
  worst.report();
}

// Samples whose gradient is exactly 0 in all features leave no trace, not even marks: their rows'
// counters of steps must not move. One feature that differs from 0 is enough to leave one.
TEST(HashGrid, SamplesWithoutGradientTouchNothing) {
  for_each_target([&](const std::string&) {
    Random random(33, 0, 0);
    for (const HashGridLevel& level : levels()) {
      const Positions positions(48, random);
      for (int feature = -1; feature < level.features; ++feature) {
        Matrix g(level.features, 48);
        for (int f = 0; f < level.features; ++f)
          for (int64_t s = 0; s < g.padded; ++s)
            g.at(f, s) = f == feature && s == 21 ? 1e-30_r : s % 2 ? 0.0_r : -0.0_r;
        RowStates states(level.entries, level.features);
        hash_grid_backward(level, positions.row(0), positions.row(1), positions.row(2), 48,
                           g.data.data(), g.ld, states.gradient.data(), states.marks.data());
        states.take_marked();
        if (feature < 0) {
          EXPECT_EQ(states.count(), 0);
          for (Real v : states.gradient) ASSERT_EQ(v, 0);
        } else {
          EXPECT_GE(states.count(), 1);
          EXPECT_LE(states.count(), 8);
        }
      }
    }
  });
}

// One sample with gradient (1, 0, 0, 0) shows which rows it reads and with what weight; the golden
// rows include hash terms that wrap around 2^32.
TEST(HashGrid, CornersMatchGolden) {
  for_each_target([&](const std::string&) {
    for (const std::vector<double>& v : golden_lines("encodings.txt", "corners")) {
      HashGridLevel level;
      level.scale = static_cast<Real>(v[0]);
      level.resolution = static_cast<uint32_t>(v[1]);
      level.entries = static_cast<uint32_t>(v[2]);
      level.dense = v[3] != 0;
      Matrix p(3, 1), g(level.features, 1);
      for (int i = 0; i < 3; ++i)
        for (int64_t s = 0; s < p.padded; ++s)
          p.at(i, s) = static_cast<Real>(v[4 + static_cast<size_t>(i)]);
      for (int f = 0; f < level.features; ++f)
        for (int64_t s = 0; s < g.padded; ++s) g.at(f, s) = f == 0 && s == 0 ? 1.0_r : 0.0_r;
      RowStates states(level.entries, level.features);
      hash_grid_backward(level, p.data.data(), p.data.data() + p.ld, p.data.data() + 2 * p.ld, 1,
                         g.data.data(), g.ld, states.gradient.data(), states.marks.data());
      std::vector<std::pair<uint32_t, Real>> rows;  // expected sums; corners may share a row
      int64_t expected = 0;
      for (size_t c = 0; c < 8; ++c) {
        const uint32_t row = static_cast<uint32_t>(v[7 + c]);
        double sum = 0;
        bool first = true;
        for (size_t k = 0; k < 8; ++k) {
          if (static_cast<uint32_t>(v[7 + k]) != row) continue;
          sum += v[15 + k];
          first &= k >= c;
        }
        EXPECT_EQ(states.marks[row], 1) << "scale " << v[0] << " corner " << c;
        EXPECT_EQ(states.gradient[size_t{row} * static_cast<size_t>(level.features)],
                  static_cast<Real>(sum))
            << "scale " << v[0] << " place " << v[4] << ' ' << v[5] << ' ' << v[6] << " corner "
            << c;
        expected += first;
      }
      states.take_marked();
      EXPECT_EQ(states.count(), expected) << "scale " << v[0];
    }
  });
}

TEST(HashGrid, ShapesMatchGolden) {
  for (const std::vector<double>& v : golden_lines("encodings.txt", "shape")) {
    const int count = static_cast<int>(v[0]);
    const HashGridShape shape =
        hash_grid_shape(count, static_cast<int>(v[1]), static_cast<int>(v[2]), v[3]);
    ASSERT_EQ(shape.levels.size(), static_cast<size_t>(count));
    ASSERT_EQ(v.size(), 4 + 5 * shape.levels.size());
    EXPECT_EQ(shape.features(), 4 * count);
    EXPECT_EQ(
        hash_grid_shape(count, static_cast<int>(v[1]), static_cast<int>(v[2]), v[3], 2).features(),
        2 * count);
    uint64_t rows = 0;
    for (size_t l = 0; l < shape.levels.size(); ++l) {
      const HashGridLevel& level = shape.levels[l];
      const double* want = &v[4 + 5 * l];
      EXPECT_FLOAT_EQ(level.scale, static_cast<Real>(want[0])) << "level " << l;
      EXPECT_EQ(level.resolution, want[1]) << "level " << l;
      EXPECT_EQ(level.entries, want[2]) << "level " << l;
      EXPECT_EQ(static_cast<double>(level.offset), want[3]) << "level " << l;
      EXPECT_EQ(level.dense, want[4] != 0) << "level " << l;
      EXPECT_EQ(level.entries % 8, 0u) << "rows come in blocks of 8 (adam_rows)";
      rows += level.entries;
    }
    EXPECT_EQ(shape.rows, rows);
  }
}

// Whatever the position, no row outside the table is read.
TEST(HashGrid, PositionsThatAreNoNumbersStayInTheTable) {
  for_each_target([&](const std::string&) {
    for (const HashGridLevel& level : levels()) {
      Matrix p(3, 16), features(level.features, 16);
      const Real odd[] = {Real{NAN}, INFINITY, -INFINITY, 1e30_r, -1e30_r, 1 + 1e-6_r};
      for (int i = 0; i < 3; ++i)
        for (int64_t s = 0; s < 16; ++s) p.at(i, s) = odd[(s + i * (s / 6)) % 6];
      // A table of exactly the level's size: memory checkers see any row beyond it.
      AlignedArray<Real> table(size_of(level));
      for (Real& v : table) v = 1;
      hash_grid_forward(level, table.data(), p.data.data(), p.data.data() + p.ld,
                        p.data.data() + 2 * p.ld, 16, features.data.data(), features.ld);
      for (int64_t s = 0; s < 16; ++s) {
        bool number = true;
        for (int i = 0; i < 3; ++i) number &= !std::isnan(p.at(i, s));
        if (number) {
          EXPECT_NEAR(features.at(0, s), 1, 1e-5) << "weights add up to 1, sample " << s;
        }
      }
    }
  });
}

}  // namespace
}  // namespace nerf
