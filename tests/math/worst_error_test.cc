#include "math/worst_error.h"

#include <gtest/gtest-spi.h>
#include <gtest/gtest.h>

#include <string>

namespace nerf {
namespace {

// The largest share of a tolerance, on each target, with its place; what is no number is beyond
// any.
TEST(WorstError, NamesTheWorstElementOfEachTarget) {
  const auto report = [](double second) {
    WorstError worst("sums");
    worst::set_target("WIDE");
    worst.compare(1.5, 1, 1, "row", 3, "sample", 17);
    worst.compare(1.25, 1, 1, "row", 4, "sample", 18);
    worst::set_target("NARROW");
    worst.compare(second, 1, 0.5, "row", 5);
    worst::set_target("");
    worst.report();
  };
  report(1.25);
  EXPECT_EQ((worst::of_test[{"sums", "WIDE"}].ratio), 0.5);
  const std::string line = worst::line("WIDE", "sums", worst::of_test[{"sums", "WIDE"}]);
  EXPECT_EQ(line.find("WIDE sums: 0.5 of the bound at row 3 sample 17 (got 1.5, expected 1"), 0u)
      << line;
  EXPECT_NONFATAL_FAILURE(report(2), "NARROW sums: 2 of the bound at row 5");
  EXPECT_NONFATAL_FAILURE(report(std::nan("")), "NARROW sums: inf of the bound at row 5");
  EXPECT_NONFATAL_FAILURE(WorstError("nothing").report(), "nothing");
  worst::of_test.clear();
}

// One object may be reported many times: one line of the worst of all.
TEST(WorstError, ReportsOfOneNameAreOne) {
  for (const double error : {0.125, 0.75, 0.25}) {
    WorstError worst("twice");
    worst.compare(error, 0, 1, "error", error);
    worst.report();
  }
  EXPECT_EQ(worst::of_test.size(), 1u);
  EXPECT_EQ((worst::of_test[{"twice", ""}].ratio), 0.75);
}

}  // namespace
}  // namespace nerf
