// The gradient of a hash grid's lookup by its position.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "base/half.h"
#include "kernels/hash_grid_levels.h"
#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/kernels/hash_grid.h"
#include "nerf/math/reference/hash_grid.h"

namespace nerf {
namespace {

namespace ref = reference;

template <class T>
void position_backward(const HashGridLevel& level, const AlignedArray<T>& table, const Matrix& p,
                       const Matrix& d_features, Matrix& d_p) {
  hash_grid_position_backward(level, table.data(), p.data.data(), p.data.data() + p.ld,
                              p.data.data() + 2 * p.ld, p.n, d_features.data.data(), d_features.ld,
                              d_p.data.data(), d_p.data.data() + d_p.ld,
                              d_p.data.data() + 2 * d_p.ld);
}

template <class T>
Matrix features_at(const HashGridLevel& level, const AlignedArray<T>& table, const Matrix& p) {
  Matrix out(level.features, p.n);
  hash_grid_forward(level, table.data(), p.data.data(), p.data.data() + p.ld,
                    p.data.data() + 2 * p.ld, p.n, out.data.data(), out.ld);
  return out;
}

// Of entries of at most 1, the largest product of a row with the gradient of a sample.
double largest_product(const Matrix& d_features, int64_t s) {
  double sum = 0;
  for (double g : d_features.column(s)) sum += std::fabs(g);
  return sum;
}

// Products of rows are at most `product`, their differences along two axes four times as much, and
// F + 6 rounded operations follow each other. Errors of place along the two other axes move the
// weights of four pairs of corners, whose products differ by 2 `product` at most.
double slope_error(const HashGridLevel& level, double product) {
  return level.scale * product *
         (8 * rounding_bound(level.features + 6) + 8 * place_error(level) / 3);
}

// Where rounding decides which cell a place is in.
bool at_a_border(const HashGridLevel& level, const std::array<double, 3>& p) {
  for (double x : p) {
    const double at = x * double{level.scale} + 0.5;
    if (std::fabs(at - std::round(at)) <= place_error(level)) return true;
  }
  return false;
}

AlignedArray<Real> table_of(const HashGridLevel& level, Random& random) {
  AlignedArray<Real> table(size_of(level));
  for (Real& v : table) v = uniform(random, -1, 1);
  return table;
}

// d_p of Matrix columns [0, n): what was there before and the template's.
TEST(HashGridPosition, AddsTheTemplate) {
  WorstError worst("slope");
  int64_t left_out = 0;
  for_each_target([&](const std::string&) {
    Random random(61, 0, 0);
    for (const HashGridLevel& level : levels()) {
      const AlignedArray<Real> table = table_of(level, random);
      const std::vector<double> exact(table.begin(), table.end());
      for (int64_t n : kCounts) {
        const Positions positions(n, random);
        const Matrix g(level.features, n, random, -1, 1);
        const Matrix before(3, n, random, -1, 1);
        Matrix d_p = before;
        position_backward(level, table, positions.p, g, d_p);
        for (int64_t s = 0; s < n; ++s) {
          if (at_a_border(level, positions.at(s))) {
            ++left_out;
            continue;
          }
          const auto want = ref::grid_position_backward<double>(reference_level(level), exact,
                                                                positions.at(s), g.column(s));
          const double tolerance = slope_error(level, largest_product(g, s));
          for (int i = 0; i < 3; ++i) {
            const double sum = double{before.at(i, s)} + want[static_cast<size_t>(i)];
            worst.compare(d_p.at(i, s), sum, tolerance + rounding_bound(1) * std::fabs(sum),
                          "scale", level.scale, "dense", level.dense, "n", n, "sample", s, "axis",
                          i);
          }
        }
        d_p.expect_untouched_beyond_padding();
      }
    }
  });
  worst.report();
  EXPECT_LT(left_out, worst.count() / 3 / 20) << "samples whose cell rounding decides";
}

// Half floats are looked up as the numbers that they are, those below the least normal one too.
TEST(HashGridPosition, OfHalfFloatsIsThatOfTheirNumbers) {
  for_each_target([&](const std::string&) {
    Random random(62, 0, 0);
    for (const HashGridLevel& level : levels()) {
      AlignedArray<uint16_t> half(size_of(level));
      AlignedArray<Real> table(half.size());
      for (size_t i = 0; i < half.size(); ++i) {
        half[i] = static_cast<uint16_t>(random.below(0x7c00) | random.below(2) << 15);
        table[i] = static_cast<Real>(internal::half_to_float(half[i]));
      }
      for (int64_t n : kCounts) {
        const Positions positions(n, random);
        const Matrix g(level.features, n, random, -1, 1), before(3, n, random, -1, 1);
        Matrix want = before, got = before;
        position_backward(level, table, positions.p, g, want);
        position_backward(level, half, positions.p, g, got);
        for (int i = 0; i < 3; ++i)
          for (int64_t s = 0; s < n; ++s)
            ASSERT_EQ(got.at(i, s), want.at(i, s))
                << "scale " << level.scale << ", axis " << i << ", sample " << s;
        got.expect_untouched_beyond_padding();
      }
    }
  });
}

// Along an axis features are linear within a cell, so that the difference of two lookups in a cell
// is the derivative anywhere between them.
TEST(HashGridPosition, IsTheDifferenceOfLookupsInACell) {
  WorstError worst("slope");
  for_each_target([&](const std::string&) {
    Random random(63, 0, 0);
    for (const HashGridLevel& level : levels()) {
      constexpr int64_t kSamples = 64;
      const AlignedArray<Real> table = table_of(level, random);
      for (int axis = 0; axis < 3; ++axis) {
        Matrix low(3, kSamples, random, 0.01, 0.99);
        for (int64_t s = 0; s < low.padded; ++s) {
          const uint64_t cells = static_cast<uint64_t>(level.scale - 0.5f);
          const double cell = 1 + static_cast<double>(random.below(cells));
          low.at(axis, s) = static_cast<Real>((cell + 0.125 - 0.5) / double{level.scale});
        }
        Matrix high = low, middle = low;
        for (int64_t s = 0; s < low.padded; ++s) {
          high.at(axis, s) += static_cast<Real>(0.75 / double{level.scale});
          middle.at(axis, s) += static_cast<Real>(uniform(random, 0, 0.75) / Real{level.scale});
        }
        const Matrix g(level.features, kSamples, random, -1, 1);
        const Matrix at_low = features_at(level, table, low),
                     at_high = features_at(level, table, high);
        Matrix d_p(3, kSamples, random, 0, 0);
        position_backward(level, table, middle, g, d_p);
        for (int64_t s = 0; s < kSamples; ++s) {
          double difference = 0;
          for (int f = 0; f < level.features; ++f)
            difference += double{g.at(f, s)} * (double{at_high.at(f, s)} - double{at_low.at(f, s)});
          const double step = double{high.at(axis, s)} - double{low.at(axis, s)};
          const double product = largest_product(g, s);
          // As of HashGrid.Forward, twice.
          const double features = 2 * (2 * place_error(level) + rounding_bound(2 + 8)) * product;
          worst.compare(d_p.at(axis, s), difference / step,
                        slope_error(level, product) + features / step, "scale", level.scale,
                        "dense", level.dense, "axis", axis, "sample", s);
        }
      }
    }
  });
  worst.report();
}

// Eight cells, so that every place at a vertex is a number: there the derivative is that of the
// upper cell, in which the vertex itself is looked up.
TEST(HashGridPosition, AtAVertexIsThatOfTheUpperCell) {
  WorstError worst("slope");
  for_each_target([&](const std::string&) {
    Random random(64, 0, 0);
    for (int features : {4, 2})
      for (bool dense : {true, false}) {
        HashGridLevel level;
        level.scale = 8;
        level.resolution = 10;
        level.entries = dense ? 1000 : 256;
        level.features = features;
        level.dense = dense;
        const AlignedArray<Real> table = table_of(level, random);
        const std::vector<double> exact(table.begin(), table.end());
        Matrix p(3, 256);
        for (Real& v : p.data)
          v = (static_cast<Real>(1 + random.below(8)) - 0.5_r) / 8 +
              static_cast<Real>(random.below(2)) / 32;
        const Matrix g(features, p.n, random, -1, 1);
        Matrix d_p(3, p.n, random, 0, 0);
        position_backward(level, table, p, g, d_p);
        for (int64_t s = 0; s < p.n; ++s) {
          const auto want = ref::grid_position_backward<double>(
              reference_level(level), exact, {p.at(0, s), p.at(1, s), p.at(2, s)}, g.column(s));
          for (int i = 0; i < 3; ++i)  // places are exact
            worst.compare(d_p.at(i, s), want[static_cast<size_t>(i)],
                          level.scale * largest_product(g, s) * 8 * rounding_bound(features + 6),
                          "dense", dense, "features", features, "sample", s, "axis", i);
        }
      }
  });
  worst.report();
}

// A clamped coordinate does not move the lookup: nothing is added along it, whatever the table
// holds, and along the other axes what is added at the border itself.
TEST(HashGridPosition, NothingIsAddedAlongAClampedAxis) {
  const std::vector<Real> outside = {0,  -0.0_r,  1,        -1e-3_r,         1 + 1e-6_r,
                                     30, -1e30_r, INFINITY, -Real{INFINITY}, Real{NAN}};
  for_each_target([&](const std::string&) {
    Random random(65, 0, 0);
    for (const HashGridLevel& level : levels())
      for (const bool infinite : {false, true}) {
        AlignedArray<Real> table = table_of(level, random);
        if (infinite)
          for (Real& v : table) v = INFINITY;
        const int64_t n = 48;
        for (int axis = 0; axis < 3; ++axis) {
          Matrix p(3, n, random, 0.01, 0.99);
          Matrix border = p;
          for (int64_t s = 0; s < n; ++s) {
            p.at(axis, s) = outside[static_cast<size_t>(s) % outside.size()];
            border.at(axis, s) = p.at(axis, s) >= 1 ? 1.0_r : 0.0_r;
          }
          const Matrix g(level.features, n, random, -1, 1), before(3, n, random, -1, 1);
          Matrix got = before, want = before;
          position_backward(level, table, p, g, got);
          position_backward(level, table, border, g, want);
          for (int64_t s = 0; s < n; ++s)
            for (int i = 0; i < 3; ++i) {
              if (i == axis) {
                ASSERT_EQ(got.at(i, s), before.at(i, s)) << "at " << p.at(i, s);
              } else if (!infinite) {
                ASSERT_EQ(got.at(i, s), want.at(i, s)) << "at " << p.at(axis, s);
                ASSERT_NE(got.at(i, s), before.at(i, s)) << "at " << p.at(axis, s);
              }
            }
        }
      }
  });
}

}  // namespace
}  // namespace nerf
