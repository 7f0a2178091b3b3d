// What the kernels' tests share: every target that this processor has, and padded matrices of known
// contents around which nothing may be written.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "math/worst_error.h"
#include "nerf/base/aligned.h"
#include "nerf/base/error.h"
#include "nerf/kernels/bf16.h"
#include "nerf/kernels/linear.h"
#include "nerf/kernels/simd.h"
#include "nerf/math/random.h"

namespace nerf {

// Runs `body(target)` on every target; the best one is in force again afterwards.
template <class Body>
void for_each_target(const Body& body) {
  struct Restore {
    ~Restore() {
      force_simd_target("");
      worst::set_target("");
    }
  } restore;
  for (const std::string& target : simd_targets()) {
    SCOPED_TRACE("target " + target);
    force_simd_target(target);
    worst::set_target(target);
    body(target);
  }
}

// Runs `body(unit)` on every bf16 unit of this processor. Where it has none, bf16 is refused.
template <class Body>
void for_each_bf16_unit(const Body& body) {
  if (bf16_unit() == Bf16Unit::kNone) {
    EXPECT_THROW(resolve_precision(Precision::kBf16), Error);
    return;
  }
  struct Restore {
    Bf16Unit before = bf16_unit();
    ~Restore() {
      force_bf16_unit(before);
      worst::set_target("");
    }
  } restore;
  for (const Bf16Unit unit : bf16_units()) {
    SCOPED_TRACE(bf16_unit_name(unit));
    force_bf16_unit(unit);
    worst::set_target(bf16_unit_name(unit));
    body(unit);
  }
}

inline constexpr int64_t kCounts[] = {0, 1, 15, 16, 17, 240};  // of samples
inline constexpr int kWidths[] = {1, 3, 5, 16, 31, 64};        // of layers

inline Real uniform(Random& random, double low, double high) {
  return static_cast<Real>(low + (high - low) * static_cast<double>(random.uniform()));
}

// A number of random sign and magnitude: any power of ten in [low, high], 0 at times.
inline Real any_size(Random& random, double low, double high) {
  if (random.uniform() < 0.05_r) return random.uniform() < 0.5_r ? 0.0_r : -0.0_r;
  const double v = std::pow(10.0, uniform(random, low, high));
  return static_cast<Real>(random.uniform() < 0.5_r ? v : -v);
}

// [rows x n] with a stride beyond n rounded up. Padding columns are finite but not 0 unless they
// are to be; whatever lies beyond them holds kCanary.
struct Matrix {
  static constexpr Real kCanary = 12345.678_r;
  enum class Padding { kNoise, kZero };

  Matrix(int r, int64_t count)
      : rows(r),
        n(count),
        padded(round_up(count, kLane)),
        ld(padded + kLane),
        data(static_cast<size_t>(rows * ld)) {
    for (Real& v : data) v = kCanary;
  }
  Matrix(int r, int64_t count, Random& random, double low, double high,
         Padding padding = Padding::kNoise)
      : Matrix(r, count) {
    for (int i = 0; i < rows; ++i)
      for (int64_t s = 0; s < padded; ++s)
        at(i, s) = s < n || padding == Padding::kNoise ? uniform(random, low, high) : 0.0_r;
  }

  Real& at(int row, int64_t s) { return data[static_cast<size_t>(row * ld + s)]; }
  Real at(int row, int64_t s) const { return data[static_cast<size_t>(row * ld + s)]; }

  std::vector<double> column(int64_t s) const {
    std::vector<double> out;
    for (int i = 0; i < rows; ++i) out.push_back(at(i, s));
    return out;
  }

  // Everything right of the padding still holds kCanary.
  void expect_untouched_beyond_padding() const {
    for (int i = 0; i < rows; ++i)
      for (int64_t s = padded; s < ld; ++s)
        ASSERT_EQ(at(i, s), kCanary) << "row " << i << " column " << s << " of " << n;
  }

  int rows;
  int64_t n, padded, ld;
  AlignedArray<Real> data;
};

// One row of these values, and finite ones in its padding.
inline Matrix row_of(const std::vector<Real>& values) {
  Matrix m(1, static_cast<int64_t>(values.size()));
  for (int64_t i = 0; i < m.padded; ++i)
    m.at(0, i) = i < m.n ? values[static_cast<size_t>(i)] : 0.5_r;
  return m;
}

}  // namespace nerf
