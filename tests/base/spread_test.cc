#include "nerf/base/spread.h"

#include <gtest/gtest.h>

namespace nerf {
namespace {

TEST(SpreadEvenly, TakesMiddlesOfEqualParts) {
  EXPECT_EQ(spread_evenly(10, 2), (std::vector<size_t>{2, 7}));
  EXPECT_EQ(spread_evenly(9, 3), (std::vector<size_t>{1, 4, 7}));
  EXPECT_EQ(spread_evenly(3, 3), (std::vector<size_t>{0, 1, 2}));
  EXPECT_EQ(spread_evenly(3, 100), (std::vector<size_t>{0, 1, 2}));
  EXPECT_EQ(spread_evenly(7, 1), (std::vector<size_t>{3}));
  EXPECT_TRUE(spread_evenly(0, 5).empty());
  EXPECT_TRUE(spread_evenly(5, 0).empty());
}

}  // namespace
}  // namespace nerf
