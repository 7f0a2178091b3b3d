// Comparison of many numbers, each with its own tolerance: the worst element is named when it is
// out of bounds, and how much of its tolerance it used is recorded with the test's results either
// way.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string>
#include <type_traits>

#include "nerf/base/real.h"

namespace nerf {

// Unit roundoff of float, for templates which a test runs on float in every build.
inline constexpr double kFloatRoundoff = 0x1p-24;
// That of Real: a rounded operation has relative error of at most this. Beside double's own, 2^-53,
// what a test compares with is rounded too, and so is what the library sums in double in either
// build: sixteen times as much leaves room for both.
inline constexpr double kRoundoff = std::is_same_v<Real, float> ? kFloatRoundoff : 0x1p-49;

// What a rounding in double adds where the library computes in double in either build: nothing to
// speak of beside float's, but in double there is no other.
inline constexpr double kDoubleRoundoff = std::is_same_v<Real, float> ? 0 : 0x1p-52;

// Relative error bound of n rounded operations in a row, n u / (1 - n u) (Higham 2002, lemma 3.1).
// A sum of n products in any order has an error of at most rounding_bound(n) sum |a| |b|.
inline double rounding_bound(double n, double roundoff = kRoundoff) {
  return n * roundoff / (1 - n * roundoff);
}

class WorstError {
 public:
  // `name` is that of the recorded property: letters and underscores.
  explicit WorstError(std::string name) : name_(std::move(name)) {}

  template <class... Where>
  void compare(double got, double want, double tolerance, const Where&... where) {
    ++count_;
    const double error = std::fabs(got - want);
    double ratio = error == 0 || got == want ? 0 : error / tolerance;
    if (!(ratio >= 0)) ratio = std::numeric_limits<double>::infinity();  // not a number
    if (ratio <= worst_) return;
    worst_ = ratio;
    std::ostringstream s;
    s.precision(9);
    s << "worst element";
    ((s << ' ' << where), ...);
    s << ": got " << got << ", expected " << want << ", error " << error << ", tolerance "
      << tolerance;
    at_ = s.str();
  }

  double ratio() const { return worst_; }
  int64_t count() const { return count_; }

  // Checks and records. At least one number must have been compared.
  void report() const {
    EXPECT_GT(count_, 0) << name_;
    EXPECT_LE(worst_, 1.0) << name_ << ": " << at_;
    testing::Test::RecordProperty(name_ + "_of_tolerance", std::to_string(worst_));
  }

 private:
  std::string name_, at_;
  int64_t count_ = 0;
  double worst_ = 0;
};

}  // namespace nerf
