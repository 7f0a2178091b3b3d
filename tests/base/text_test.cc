#include "nerf/base/text.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace nerf {
namespace {

TEST(Text, LineAndColumnCountFromOne) {
  const std::string text = "ab\ncd\n\nx";
  EXPECT_EQ(line_and_column(text, 0), "1:1");
  EXPECT_EQ(line_and_column(text, 2), "1:3");  // the line's end belongs to it
  EXPECT_EQ(line_and_column(text, 3), "2:1");
  EXPECT_EQ(line_and_column(text, 6), "3:1");
  EXPECT_EQ(line_and_column(text, 7), "4:1");
  EXPECT_EQ(line_and_column(text, 100), "4:2");
  EXPECT_EQ(line_and_column("", 5), "1:1");
}

TEST(Text, NaturalOrderCountsNumbers) {
  const std::vector<std::string> sorted{"",
                                        "a",
                                        "a/1.png",
                                        "a/2.png",
                                        "a/02.png",
                                        "a/10.png",
                                        "a/10b.png",
                                        "a0",
                                        "a00",
                                        "a1",
                                        "a99999999999999999999998",
                                        "a99999999999999999999999",
                                        "b",
                                        "\xc3\xa9"};
  for (size_t i = 0; i < sorted.size(); ++i)
    for (size_t j = 0; j < sorted.size(); ++j)
      EXPECT_EQ(natural_less(sorted[i], sorted[j]), i < j) << sorted[i] << " and " << sorted[j];
}

TEST(NumberIn, TakesNumbersWithinTheBoundsAlone) {
  EXPECT_EQ(number_in("0.25", 0, 1), 0.25);
  EXPECT_EQ(number_in("1", 0, 1), 1);
  EXPECT_EQ(number_in("1e-1", 0, 1), 0.1);
  for (const char* text : {"", "x", "0.5x", " 0.5", "1.01", "-0.1", "nan", "inf"})
    EXPECT_FALSE(number_in(text, 0, 1)) << text;
}

TEST(Shortened, CutsBetweenCharacters) {
  EXPECT_EQ(shortened("abc", 3), "abc");
  EXPECT_EQ(shortened("abcd", 3), "abc");
  EXPECT_EQ(shortened("ab\xc3\xa9", 3), "ab");
  EXPECT_EQ(shortened("a\xe2\x82\xac", 3), "a");
  EXPECT_EQ(shortened("a\xe2\x82\xac"
                      "b",
                      4),
            "a\xe2\x82\xac");
  EXPECT_EQ(shortened("\x80\x80\x80", 2), "");
  EXPECT_EQ(shortened("", 0), "");
}

}  // namespace
}  // namespace nerf
