// Comparison of many numbers, each with its own tolerance. What came nearest to its tolerance, or
// beyond it, is named on each SIMD target: printed once a test is over, whether or not it passed,
// and recorded with the test's results.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <map>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>

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

namespace worst {

// The SIMD target, or the bf16 unit, that what is compared ran on; none outside of
// for_each_target() and for_each_bf16_unit().
struct Target {
  std::string name;
  int64_t changes = 0;
};
inline Target target;
inline void set_target(const std::string& name) {
  target.name = name;
  ++target.changes;
}

struct Element {
  double ratio = -1;  // of its error to its tolerance
  std::string where;  // and what it was
};

// "AVX2 forward: 0.31 of the bound at row 3 sample 17: ..."
inline std::string line(const std::string& target_name, const std::string& name, const Element& e) {
  std::ostringstream s;
  s.precision(3);
  s << target_name << (target_name.empty() ? "" : " ") << name << ": " << e.ratio
    << " of the bound at " << e.where;
  return s.str();
}

// Of the running test, by what was compared and where it ran: several reports of one name, as of an
// operation in many shapes, are one line.
inline std::map<std::pair<std::string, std::string>, Element> of_test;

class Printer : public testing::EmptyTestEventListener {
  void OnTestStart(const testing::TestInfo&) override { of_test.clear(); }
  void OnTestEnd(const testing::TestInfo&) override {
    for (const auto& [key, element] : of_test)
      std::printf("[ worst    ] %s\n", line(key.second, key.first, element).c_str());
    std::fflush(stdout);
  }
};
inline const bool kPrints = [] {
  testing::UnitTest::GetInstance()->listeners().Append(new Printer);
  return true;
}();

}  // namespace worst

class WorstError {
 public:
  // `name` is that of the recorded property: letters and underscores.
  explicit WorstError(std::string name) : name_(std::move(name)) {}
  WorstError(WorstError&&) = default;  // a copy would write to the original

  template <class... Where>
  void compare(double got, double want, double tolerance, const Where&... where) {
    ++count_;
    const double error = std::fabs(got - want);
    double ratio = error == 0 || got == want ? 0 : error / tolerance;
    if (!(ratio >= 0)) ratio = std::numeric_limits<double>::infinity();  // not a number
    if (!here_ || changes_ != worst::target.changes) {
      here_ = &worst_[worst::target.name];
      changes_ = worst::target.changes;
    }
    if (ratio <= here_->ratio) return;
    here_->ratio = ratio;
    std::ostringstream s;
    s.precision(9);
    ((s << where << ' '), ...);
    s << "(got " << got << ", expected " << want << ", error " << error << ", bound " << tolerance
      << ')';
    here_->where = s.str();
  }

  double ratio() const {
    double most = 0;
    for (const auto& [target, element] : worst_) most = std::max(most, element.ratio);
    return most;
  }
  int64_t count() const { return count_; }

  // Checks, records and lets the worst be printed. At least one number must have been compared.
  void report() const {
    static_cast<void>(worst::kPrints);
    EXPECT_GT(count_, 0) << name_;
    for (const auto& [target, element] : worst_) {
      EXPECT_LE(element.ratio, 1.0) << worst::line(target, name_, element);
      worst::Element& all = worst::of_test[{name_, target}];
      if (element.ratio > all.ratio) all = element;
      testing::Test::RecordProperty(name_ + (target.empty() ? "" : "_" + target) + "_of_tolerance",
                                    std::to_string(all.ratio));
    }
  }

 private:
  std::string name_;
  std::map<std::string, worst::Element> worst_;  // by target
  worst::Element* here_ = nullptr;               // of the target in force
  int64_t changes_ = -1, count_ = 0;
};

}  // namespace nerf
