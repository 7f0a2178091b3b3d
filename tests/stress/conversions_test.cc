// bf16 and half floats of every kind of float, and lists of marked rows wherever marks may be.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <string>
#include <vector>

#include "base/half.h"
#include "kernels/kernel_test.h"
#include "nerf/kernels/adam.h"
#include "nerf/kernels/bf16.h"
#include "nerf/math/reference/bf16.h"
#include "nerf/math/reference/half.h"
#include "stress/magnitudes.h"

namespace nerf::stress {
namespace {

// Every upper half of a float, denormals, infinities and what is no number among them, with the
// lower halves around the tie and at both ends: exactly the template's number. Not a number stays
// one, of its sign.
TEST(StressBf16, EveryUpperHalfAndItsTies) {
  std::vector<float> x;
  for (uint32_t high = 0; high < 0x10000; ++high)
    for (const uint32_t low : {0x0000u, 0x0001u, 0x7fffu, 0x8000u, 0x8001u, 0xffffu})
      x.push_back(std::bit_cast<float>(high << 16 | low));
  const int64_t n = static_cast<int64_t>(x.size());
  std::vector<uint16_t> rounded(x.size());
  std::vector<float> back(x.size());
  int64_t ties = 0;
  for_each_mode(
      [&] {
        round_to_bf16(n, x.data(), rounded.data());
        widen_bf16(n, rounded.data(), back.data());
      },
      [&] {
        for (size_t i = 0; i < x.size(); ++i) {
          const uint32_t bits = std::bit_cast<uint32_t>(x[i]),
                         got = std::bit_cast<uint32_t>(back[i]);
          ASSERT_EQ(got, uint32_t{rounded[i]} << 16) << "widening is exact";
          if (std::isnan(x[i])) {
            ASSERT_TRUE(std::isnan(back[i])) << std::hex << bits;
            ASSERT_EQ(got >> 31, bits >> 31) << std::hex << bits;
            continue;
          }
          ties += (bits & 0xffff) == 0x8000;
          ASSERT_EQ(got, std::bit_cast<uint32_t>(reference::nearest_bf16(x[i])))
              << std::hexfloat << x[i] << " became " << back[i];
        }
      });
  EXPECT_GT(ties, 60000);
}

// All half floats, and floats with every upper half and lower halves around the ties of either size
// of half: exactly the template's number, of the float's sign.
TEST(StressHalf, EveryHalfAndItsTies) {
  for (uint32_t bits = 0; bits < 0x10000; ++bits) {
    const auto half = static_cast<uint16_t>(bits);
    const double want = reference::half_value(half);
    const float got = internal::half_to_float(half);
    ASSERT_TRUE(got == want || (std::isnan(got) && std::isnan(want))) << std::hex << bits;
    ASSERT_EQ(std::signbit(got), (bits & 0x8000) != 0) << std::hex << bits;
  }
  std::vector<float> x;
  for (uint32_t high = 0; high < 0x10000; ++high)
    for (const uint32_t low : {0x0000u, 0x0fffu, 0x1000u, 0x1001u, 0x3000u, 0x8000u, 0xffffu})
      x.push_back(std::bit_cast<float>(high << 16 | low));
  std::vector<uint16_t> rounded(x.size());
  for_each_mode(
      [&] {
        for (size_t i = 0; i < x.size(); ++i) rounded[i] = internal::float_to_half(x[i]);
      },
      [&] {
        for (size_t i = 0; i < x.size(); ++i) {
          const double got = reference::half_value(rounded[i]),
                       want = reference::nearest_half(x[i]);
          ASSERT_TRUE(got == want || (std::isnan(got) && std::isnan(want)))
              << std::hexfloat << x[i] << " became " << got;
          ASSERT_EQ((rounded[i] & 0x8000) != 0, std::signbit(x[i])) << std::hexfloat << x[i];
        }
      });
}

// One mark of any value at any row, all rows but one, every second one, and none: listed in order,
// each once, cleared, and nothing beyond is touched.
TEST(StressListRows, MarksAnywhere) {
  for_each_target([&](const std::string&) {
    for (const size_t rows : {size_t{8}, size_t{136}, size_t{65536 + 24}}) {
      const auto check = [&](const auto& marked, uint8_t mark) {
        std::vector<uint32_t> want;
        AlignedArray<uint8_t> marks(rows + 64);
        for (size_t row = 0; row < marks.size(); ++row) {
          if (row < rows && !marked(row)) continue;
          marks[row] = mark;
          if (row < rows) want.push_back(static_cast<uint32_t>(row));
        }
        std::vector<uint32_t> list(rows + 1, 77u);
        const int64_t count = list_rows(static_cast<int64_t>(rows), marks.data(), list.data());
        ASSERT_EQ(count, static_cast<int64_t>(want.size()));
        ASSERT_EQ(list.back(), 77u);
        list.resize(want.size());
        ASSERT_EQ(list, want);
        ASSERT_EQ(std::accumulate(marks.begin(), marks.begin() + static_cast<ptrdiff_t>(rows), 0),
                  0);
        for (size_t row = rows; row < marks.size(); ++row) ASSERT_EQ(marks[row], mark) << row;
      };
      for (size_t at = 0; at < rows; at += rows > 1000 ? 8191 : 1) {
        SCOPED_TRACE("row " + std::to_string(at) + " of " + std::to_string(rows));
        check([&](size_t row) { return row == at; }, static_cast<uint8_t>(1 + at % 255));
        check([&](size_t row) { return row != at; }, 0x80);
      }
      check([](size_t row) { return row % 2 == 0; }, 1);
      check([](size_t row) { return row % 64 == 63; }, 0xff);
      check([](size_t) { return true; }, 0x7f);
      check([](size_t) { return false; }, 1);
    }
  });
}

}  // namespace
}  // namespace nerf::stress
