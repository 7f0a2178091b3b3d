// The hash grid at the places where cells meet and end, and with tables of extreme magnitudes.
#include "nerf/kernels/hash_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "base/half.h"
#include "kernels/kernel_test.h"
#include "kernels/row_states.h"
#include "math/worst_error.h"
#include "nerf/base/threads.h"
#include "nerf/math/reference/hash_grid.h"

namespace nerf::stress {
namespace {

namespace ref = reference;
constexpr Real kInf = std::numeric_limits<Real>::infinity();
constexpr double kTiny = std::numeric_limits<Real>::min();

ref::GridLevel reference_level(const HashGridLevel& l) {
  return {l.scale, l.resolution, l.entries, l.dense, static_cast<size_t>(l.features)};
}

std::vector<HashGridLevel> levels() {
  std::vector<HashGridLevel> out;
  // Dense and hashed; scales that are whole numbers and others; cells near float's resolution.
  for (int features : {4, 2})
    for (const HashGridShape& shape :
         {hash_grid_shape(3, 14, 5, 40, features), hash_grid_shape(2, 10, 17, 4097, features),
          hash_grid_shape(2, 10, 2, 1 << 20, features)})
      out.insert(out.end(), shape.levels.begin(), shape.levels.end());
  return out;
}

size_t size_of(const HashGridLevel& level) {
  return size_t{level.entries} * static_cast<size_t>(level.features);
}

// Coordinates at vertices, one float to either side of them, in the middle of cells, at the borders
// and outside of [0, 1].
std::vector<Real> coordinates(const HashGridLevel& level) {
  std::vector<Real> out = {0.0_r,          -0.0_r, 1.0_r,  std::nextafter(1.0_r, 0.0_r),
                           1.0_r + 1e-6_r, 2.0_r,  1e6_r,  std::numeric_limits<Real>::max(),
                           -1e-6_r,        -1e6_r, 1e-7_r, std::numeric_limits<Real>::denorm_min(),
                           -1e-40_r,       kInf,   -kInf,  std::numeric_limits<Real>::min()};
  const double cells = std::floor(double{level.scale} + 0.5);
  for (double vertex : {1.0, 2.0, std::floor(cells / 2), cells - 1, cells})
    for (double off : {0.0, 0.5}) {
      const Real at = static_cast<Real>((vertex + off - 0.5) / double{level.scale});
      for (Real x : {std::nextafter(at, -kInf), at, std::nextafter(at, kInf)}) out.push_back(x);
    }
  return out;
}

// Triples of them, at random.
struct Places {
  Places(const HashGridLevel& level, int64_t n, Random& random) : p(3, n) {
    const std::vector<Real> all = coordinates(level);
    for (int i = 0; i < 3; ++i)
      for (int64_t s = 0; s < p.padded; ++s) p.at(i, s) = all[random.below(all.size())];
  }
  const Real* row(int i) const { return p.data.data() + i * p.ld; }
  std::array<double, 3> at(int64_t s) const { return {p.at(0, s), p.at(1, s), p.at(2, s)}; }
  Matrix p;
};

// As tests/kernels/hash_grid_test.cc: a place x scale + 1/2 is rounded once, the distances to both
// vertices once more, and the errors of all weights together are at most twice the sum over axes.
double place_error(const HashGridLevel& level) {
  return 3 * (kRoundoff * (level.scale + 1.5) + kRoundoff);
}

TEST(StressHashGrid, CornersEdgesAndFaces) {
  WorstError worst("features"), ones("weights");
  for_each_target([&](const std::string&) {
    Random random(51, 0, 0);
    for (const HashGridLevel& level : levels())
      for (bool flush : {false, true}) {
        AlignedArray<Real> table(size_of(level));
        for (Real& v : table) v = uniform(random, -1, 1);
        // The last feature is 1 everywhere and shows the sum of the weights.
        const int last = level.features - 1;
        for (size_t i = static_cast<size_t>(last); i < table.size();
             i += static_cast<size_t>(level.features))
          table[i] = 1;
        const std::vector<double> exact(table.begin(), table.end());
        const Places places(level, 4096, random);
        Matrix features(level.features, places.p.n);
        {
          const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
          hash_grid_forward(level, table.data(), places.row(0), places.row(1), places.row(2),
                            places.p.n, features.data.data(), features.ld);
        }
        for (int64_t s = 0; s < places.p.n; ++s) {
          const auto want = ref::grid_interpolate(reference_level(level), exact, places.at(s));
          const double tolerance = 2 * place_error(level) + rounding_bound(2 + 8);
          for (int f = 0; f < last; ++f)
            worst.compare(features.at(f, s), want[static_cast<size_t>(f)], tolerance, "scale",
                          level.scale, "place", places.at(s)[0], places.at(s)[1], places.at(s)[2]);
          // near + far is off by one rounding of near in each axis, then two products, then a sum.
          ones.compare(features.at(last, s), 1, rounding_bound(3 + 2 + 8), "scale", level.scale,
                       "place", places.at(s)[0], places.at(s)[1], places.at(s)[2]);
        }
      }
  });
  worst.report();
  ones.report();
}

// Half floats below their normal numbers, the largest, and all of them, at all places: as near to
// the exact sum as numbers are, relative to the largest feature, and the bits that the same
// features give as numbers. A half's subnormals are normal floats and are not flushed.
TEST(StressHashGrid, HalfFloatsOfEveryMagnitude) {
  WorstError worst("features");
  struct Kind {
    uint32_t least, most;  // bits, but the sign
  };
  for_each_target([&](const std::string&) {
    Random random(55, 0, 0);
    for (const HashGridLevel& level : levels())
      for (const Kind kind : {Kind{0x0001, 0x0001},
                              {0x0000, 0x03ff},
                              {0x03ff, 0x0400},
                              {0x7bff, 0x7bff},
                              {0x0000, 0x7bff}})
        for (bool flush : {false, true}) {
          AlignedArray<uint16_t> half(size_of(level));
          AlignedArray<Real> table(half.size());
          double largest = 0;
          for (size_t i = 0; i < half.size(); ++i) {
            half[i] = static_cast<uint16_t>(
                (kind.least + random.below(kind.most - kind.least + 1)) | random.below(2) << 15);
            table[i] = static_cast<Real>(internal::half_to_float(half[i]));
            largest = std::max(largest, std::fabs(double{table[i]}));
          }
          const std::vector<double> exact(table.begin(), table.end());
          const Places places(level, 256, random);
          Matrix features(level.features, places.p.n), same(level.features, places.p.n);
          {
            const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
            hash_grid_forward(level, half.data(), places.row(0), places.row(1), places.row(2),
                              places.p.n, features.data.data(), features.ld);
            hash_grid_forward(level, table.data(), places.row(0), places.row(1), places.row(2),
                              places.p.n, same.data.data(), same.ld);
          }
          const double tolerance =
              (2 * place_error(level) + rounding_bound(2 + 8)) * largest + 8 * kTiny;
          for (int64_t s = 0; s < places.p.n; ++s) {
            const auto want = ref::grid_interpolate(reference_level(level), exact, places.at(s));
            for (int f = 0; f < level.features; ++f) {
              ASSERT_EQ(features.at(f, s), same.at(f, s)) << "scale " << level.scale;
              worst.compare(features.at(f, s), want[static_cast<size_t>(f)], tolerance, "scale",
                            level.scale, "bits up to", kind.most, "place", places.at(s)[0],
                            places.at(s)[1], places.at(s)[2]);
            }
          }
        }
  });
  worst.report();
}

// Exactly on a vertex only that vertex counts, to the last bit, whatever the others hold.
TEST(StressHashGrid, OnAVertexItsRowAlone) {
  int hits = 0;
  for_each_target([&](const std::string&) {
    Random random(52, 0, 0);
    for (const HashGridLevel& level : levels()) {
      const auto on_vertex = [&](Real x) {
        if (!(x >= 0 && x <= 1)) return false;
        const Real at = std::fma(x, level.scale, 0.5_r);
        return at == std::floor(at);
      };
      AlignedArray<Real> table(size_of(level));
      for (Real& v : table) v = uniform(random, -1, 1) * 1e30_r;
      const Places places(level, 16384, random);
      Matrix features(level.features, places.p.n);
      hash_grid_forward(level, table.data(), places.row(0), places.row(1), places.row(2),
                        places.p.n, features.data.data(), features.ld);
      for (int64_t s = 0; s < places.p.n; ++s) {
        uint32_t at[3];
        bool all = true;
        for (int i = 0; i < 3; ++i) {
          all = all && on_vertex(places.p.at(i, s));
          if (all) at[i] = static_cast<uint32_t>(std::fma(places.p.at(i, s), level.scale, 0.5_r));
        }
        if (!all) continue;
        ++hits;
        const uint32_t row = ref::grid_row(reference_level(level), at[0], at[1], at[2]);
        for (int f = 0; f < level.features; ++f)
          ASSERT_EQ(features.at(f, s),
                    table[row * static_cast<size_t>(level.features) + static_cast<size_t>(f)])
              << "scale " << level.scale << " sample " << s;
      }
    }
  });
  EXPECT_GT(hits, 500);
}

// Outside of [0, 1] a place counts as the nearest one inside: the same bits, forward and backward.
TEST(StressHashGrid, OutsideIsTheBorder) {
  for_each_target([&](const std::string&) {
    Random random(53, 0, 0);
    for (const HashGridLevel& level : levels()) {
      AlignedArray<Real> table(size_of(level));
      for (Real& v : table) v = uniform(random, -1, 1);
      const Places places(level, 512, random);
      Places clamped = places;
      for (int i = 0; i < 3; ++i)
        for (int64_t s = 0; s < clamped.p.padded; ++s)
          clamped.p.at(i, s) = std::clamp(clamped.p.at(i, s), 0.0_r, 1.0_r);
      Matrix g(level.features, 512, random, -1, 1);
      std::vector<AlignedArray<Real>> gradients;
      Matrix features[2] = {{level.features, 512}, {level.features, 512}};
      for (int k = 0; k < 2; ++k) {
        const Places& p = k ? clamped : places;
        hash_grid_forward(level, table.data(), p.row(0), p.row(1), p.row(2), 512,
                          features[k].data.data(), features[k].ld);
        RowStates states(level.entries, level.features);
        hash_grid_backward(level, p.row(0), p.row(1), p.row(2), 512, g.data.data(), g.ld,
                           states.gradient.data(), states.marks.data());
        gradients.push_back(states.gradient);
      }
      for (int f = 0; f < level.features; ++f)
        for (int64_t s = 0; s < 512; ++s)
          ASSERT_EQ(features[0].at(f, s), features[1].at(f, s)) << level.scale << " sample " << s;
      for (size_t i = 0; i < table.size(); ++i) ASSERT_EQ(gradients[0][i], gradients[1][i]) << i;
    }
  });
}

// Gradients of any magnitude, scattered from corners and from outside: finite, and as much arrives
// as was sent, for weights add up to 1. Sums of 8 x 256 products in any order.
TEST(StressHashGrid, GradientsOfEveryMagnitudeArrive) {
  WorstError worst("sum");
  for_each_target([&](const std::string&) {
    Random random(54, 0, 0);
    for (const HashGridLevel& level : levels())
      for (double size : {1e-42, 1e-30, 1.0, 1e20, 1e34})
        for (bool flush : {false, true}) {
          constexpr int64_t kSamples = 256;
          const size_t features = static_cast<size_t>(level.features);
          const Places places(level, kSamples, random);
          Matrix g(level.features, kSamples, random, 0.1 * size, size, Matrix::Padding::kZero);
          RowStates states(level.entries, level.features);
          {
            const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
            hash_grid_backward(level, places.row(0), places.row(1), places.row(2), kSamples,
                               g.data.data(), g.ld, states.gradient.data(), states.marks.data());
          }
          const AlignedArray<Real>& gradient = states.gradient;
          for (size_t f = 0; f < features; ++f) {
            double sent = 0, arrived = 0;
            for (int64_t s = 0; s < kSamples; ++s) sent += double{g.at(static_cast<int>(f), s)};
            for (uint32_t row = 0; row < level.entries; ++row) {
              ASSERT_TRUE(std::isfinite(gradient[row * features + f])) << row;
              arrived += double{gradient[row * features + f]};
            }
            worst.compare(arrived, sent,
                          rounding_bound(3 + 2 + kSamples * 8.0) * sent + 8 * kSamples * kTiny,
                          "scale", level.scale, "size", size, "feature", f);
          }
        }
  });
  worst.report();
}

// No dense level of any options asks for a vertex beyond its side, even at the upper corner.
TEST(StressHashGrid, NoDenseLevelLeavesItsTable) {
  int dense = 0;
  for (int base : {2, 3, 5, 8, 16, 31, 64, 100, 255})
    for (int finest : {base, base + 1, 2 * base + 1, 333, 2048})
      for (int count : {1, 2, 7, 16})
        for (int log2 : {10, 16, 24}) {
          if (finest < base) continue;
          for (const HashGridLevel& level : hash_grid_shape(count, log2, base, finest).levels) {
            if (!level.dense) continue;
            ++dense;
            const uint32_t last = static_cast<uint32_t>(std::fma(1.0_r, level.scale, 0.5_r)) + 1;
            ASSERT_LT(last, level.resolution) << "scale " << level.scale;
            const uint32_t row = ref::grid_row(reference_level(level), last, last, last);
            ASSERT_LT(row, level.entries) << "scale " << level.scale;
          }
        }
  EXPECT_GT(dense, 1000);
}

}  // namespace
}  // namespace nerf::stress
