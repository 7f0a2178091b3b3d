#include "nerf/train/metrics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace nerf {
namespace {

// The pictures of tests/golden/metrics.py.
std::vector<int> noise(uint32_t state, int count) {
  std::vector<int> out;
  for (int i = 0; i < count; ++i) {
    state = state * 1664525u + 1013904223u;
    out.push_back(static_cast<int>(state >> 24));
  }
  return out;
}

struct Pair {
  Image8 a, b;
};

Pair pictures(int number, int width, int height, int channels) {
  const int count = width * height * channels;
  const auto n = noise(static_cast<uint32_t>(number) + 1, count);
  const auto m = noise(static_cast<uint32_t>(number) + 1001, count);
  std::vector<int> a(n.size()), b;
  const auto at = [&](int x, int y, int c) {
    return static_cast<size_t>((y * width + x) * channels + c);
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < channels; ++c) {
        const size_t i = at(x, y, c);
        a[i] = number == 2 ? 200 : (x * 3 + y * 2 + c * 40 + n[i] / 4) % 256;
      }
    }
  }
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < channels; ++c) {
        const size_t i = at(x, y, c);
        const int values[] = {
            std::clamp(a[i] + m[i] / 16 - 8, 0, 255), 255 - a[i], 190, m[i], a[i] / 2 + 60,
            a[at((x + width - 1) % width, y, c)]};
        b.push_back(values[number]);
      }
    }
  }
  const auto image = [&](const std::vector<int>& values) {
    return Image8{width, height, channels, std::vector<uint8_t>(values.begin(), values.end())};
  };
  return {image(a), image(b)};
}

TEST(Metrics, AgreeWithAnIndependentCalculation) {
  std::ifstream in(std::string(NERF_SOURCE_DIR) + "/tests/golden/metrics.txt");
  ThreadPool pool(2);
  int lines = 0;
  for (std::string line; std::getline(in, line);) {
    if (line[0] == '#') continue;
    std::istringstream words(line);
    int number, width, height, channels, masked;
    double expected_psnr, expected_ssim;
    ASSERT_TRUE(words >> number >> width >> height >> channels >> masked >> expected_psnr >>
                expected_ssim)
        << line;
    const Pair pair = pictures(number, width, height, channels);
    std::vector<uint8_t> mask;
    if (masked) {
      for (const int n : noise(static_cast<uint32_t>(number) + 5001, width * height)) {
        mask.push_back(n >= 100 ? 255 : 0);
      }
    }
    const auto p = psnr(pair.a, pair.b, mask);
    const auto s = ssim(pair.a, pair.b, pool, mask);
    ASSERT_TRUE(p && s) << line;
    EXPECT_NEAR(*p, expected_psnr, 1e-11 * expected_psnr) << line;
    // Flat pictures' variances are pure rounding, some 1e-16 beside k2^2 = 9e-4.
    EXPECT_NEAR(*s, expected_ssim, 1e-12) << line;
    ++lines;
  }
  EXPECT_EQ(lines, 12);
}

TEST(Metrics, IdenticalPictures) {
  const Image8 image = pictures(0, 40, 30, 3).a;
  ThreadPool pool(1);
  EXPECT_EQ(psnr(image, image), kHighestPsnr);
  EXPECT_NEAR(*ssim(image, image, pool), 1, 1e-15);
}

TEST(Metrics, OneStepOfOneValue) {
  Image8 a{10, 10, 3, std::vector<uint8_t>(300, 7)}, b = a;
  b.pixels[17] = 8;
  EXPECT_NEAR(*psnr(a, b), 10 * std::log10(255.0 * 255.0 * 300), 1e-12);
}

TEST(Metrics, MaskedPixelsDoNotCount) {
  Pair pair = pictures(0, 40, 40, 3);
  std::vector<uint8_t> left(1600);
  for (size_t i = 0; i < left.size(); ++i) left[i] = i % 40 < 15 ? 255 : 0;
  ThreadPool pool(1);
  const auto p = psnr(pair.a, pair.b, left);
  const auto s = ssim(pair.a, pair.b, pool, left);
  for (size_t i = 0; i < pair.b.pixels.size(); ++i) {
    if (i / 3 % 40 >= 15) pair.b.pixels[i] = 0;
  }
  EXPECT_EQ(psnr(pair.a, pair.b, left), p);
  EXPECT_EQ(ssim(pair.a, pair.b, pool, left), s);
  EXPECT_NE(psnr(pair.a, pair.b), psnr(pictures(0, 40, 40, 3).a, pictures(0, 40, 40, 3).b));
}

TEST(Metrics, NothingThatCountsIsNoValue) {
  const Pair pair = pictures(3, 20, 20, 3);
  ThreadPool pool(1);
  std::vector<uint8_t> mask(400, 0);
  EXPECT_FALSE(psnr(pair.a, pair.b, mask));
  EXPECT_FALSE(ssim(pair.a, pair.b, pool, mask));
  mask[0] = 255;  // a corner is the centre of no window
  EXPECT_TRUE(psnr(pair.a, pair.b, mask));
  EXPECT_FALSE(ssim(pair.a, pair.b, pool, mask));
  const Pair small = pictures(3, 10, 40, 3);
  EXPECT_TRUE(psnr(small.a, small.b));
  EXPECT_FALSE(ssim(small.a, small.b, pool));
}

TEST(Metrics, SameBitsForAnyNumberOfThreads) {
  const Pair pair = pictures(4, 150, 211, 3);
  ThreadPool one(1);
  const double expected = *ssim(pair.a, pair.b, one);
  for (int threads = 2; threads <= 5; ++threads) {
    ThreadPool pool(threads);
    for (int repeat = 0; repeat < 5; ++repeat) ASSERT_EQ(*ssim(pair.a, pair.b, pool), expected);
  }
}

TEST(Metrics, DifferentSizesAreABug) {
  const Pair pair = pictures(0, 20, 20, 3);
  const Image8 other = pictures(0, 20, 21, 3).a;
  ThreadPool pool(1);
  EXPECT_THROW(psnr(pair.a, other), std::logic_error);
  EXPECT_THROW(ssim(pair.a, other, pool), std::logic_error);
  const std::vector<uint8_t> mask(399, 255);
  EXPECT_THROW(psnr(pair.a, pair.b, mask), std::logic_error);
}

}  // namespace
}  // namespace nerf
