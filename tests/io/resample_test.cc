#include "io/resample.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace nerf::internal {
namespace {

std::vector<float> average(const std::vector<float>& pixels, int width, int height, int channels,
                           int new_width, int new_height) {
  std::vector<float> result;
  int last_row = -1;
  area_average(
      width, height, channels,
      [&](int y, std::span<float> out) {
        EXPECT_GE(y, last_row);  // in order
        last_row = y;
        ASSERT_EQ(out.size(), static_cast<size_t>(width * channels));
        std::copy_n(pixels.begin() + y * width * channels, out.size(), out.begin());
      },
      new_width, new_height,
      [&](int y, std::span<const float> row) {
        EXPECT_EQ(result.size(), static_cast<size_t>(y * new_width * channels));
        result.insert(result.end(), row.begin(), row.end());
      });
  return result;
}

TEST(AreaAverage, WholeBlocks) {
  const std::vector<float> pixels{1, 3, 10, 20, 5, 7, 30, 40};  // 4 x 2
  EXPECT_EQ(average(pixels, 4, 2, 1, 2, 1), (std::vector<float>{4, 25}));
}

TEST(AreaAverage, PixelsCutByABorderCountInPart) {
  // 3 to 2: the middle pixel belongs to both halves.
  const auto result = average({6, 12, 30}, 3, 1, 1, 2, 1);
  EXPECT_NEAR(result[0], (6 + 12 * 0.5) / 1.5, 1e-6);
  EXPECT_NEAR(result[1], (30 + 12 * 0.5) / 1.5, 1e-5);
}

// Against the definition, by cutting every pixel into pieces that no border cuts.
TEST(AreaAverage, AnySizeAgreesWithTheDefinition) {
  for (const auto& [w, h, nw, nh] :
       {std::array{7, 5, 3, 2}, std::array{13, 11, 5, 7}, std::array{6, 9, 6, 1},
        std::array{10, 10, 1, 9}, std::array{8, 8, 8, 8}}) {
    std::vector<float> pixels(static_cast<size_t>(w * h * 3));
    for (size_t i = 0; i < pixels.size(); ++i) pixels[i] = static_cast<float>(i * 7919 % 101);
    const auto result = average(pixels, w, h, 3, nw, nh);
    ASSERT_EQ(result.size(), static_cast<size_t>(nw * nh * 3));
    for (int y = 0; y < nh; ++y) {
      for (int x = 0; x < nw; ++x) {
        for (int c = 0; c < 3; ++c) {
          double sum = 0;
          // The picture nw * w pieces wide has nw pieces in each source pixel, w in each result.
          for (int v = y * h; v < (y + 1) * h; ++v) {
            for (int u = x * w; u < (x + 1) * w; ++u) {
              sum += pixels[static_cast<size_t>(((v / nh) * w + u / nw) * 3 + c)];
            }
          }
          ASSERT_NEAR(result[static_cast<size_t>((y * nw + x) * 3 + c)], sum / (w * h), 1e-4);
        }
      }
    }
  }
}

TEST(AreaAverage, LargePicturesDoNotOverflow) {
  const int width = 65536;
  std::vector<float> row(width, 0.25f);
  EXPECT_NEAR(average(row, width, 1, 1, 65535, 1).back(), 0.25, 1e-6);
}

TEST(ResizeNearest, TakesThePixelUnderTheCentre) {
  EXPECT_EQ(resize_nearest(std::vector<uint8_t>{1, 2, 3, 4}, 2, 2, 4, 2),
            (std::vector<uint8_t>{1, 1, 2, 2, 3, 3, 4, 4}));
  EXPECT_EQ(resize_nearest(std::vector<uint8_t>{1, 2, 3, 4, 5, 6}, 6, 1, 2, 1),
            (std::vector<uint8_t>{2, 5}));
  EXPECT_EQ(resize_nearest(std::vector<uint8_t>{1, 2, 3}, 3, 1, 2, 1),
            (std::vector<uint8_t>{1, 3}));
}

}  // namespace
}  // namespace nerf::internal
