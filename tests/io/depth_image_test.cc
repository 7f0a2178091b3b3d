#include "nerf/io/depth_image.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace nerf {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

Vec3 pixel(const Image8& image, int i) {
  return {static_cast<float>(image.pixels[3 * i]), static_cast<float>(image.pixels[3 * i + 1]),
          static_cast<float>(image.pixels[3 * i + 2])};
}

TEST(DepthImage, TurboFollowsThePublishedTable) {
  const struct {
    int entry;
    Vec3 color;
  } table[] = {{0, {0.18995f, 0.07176f, 0.23217f}},   {8, {0.22500f, 0.16354f, 0.45096f}},
               {64, {0.15844f, 0.73551f, 0.92305f}},  {100, {0.24797f, 0.96423f, 0.54303f}},
               {128, {0.64362f, 0.98999f, 0.23356f}}, {192, {0.98360f, 0.49291f, 0.12849f}},
               {248, {0.57103f, 0.04474f, 0.00529f}}, {255, {0.47960f, 0.01583f, 0.01055f}}};
  // Between 18 knots the curve is straight: off by at most an eighth of its second difference.
  const auto knot = [](int k) { return turbo_color(static_cast<float>(k) / 17.0f); };
  float bend = 0;
  for (int k = 1; k < 17; ++k)
    for (int c = 0; c < 3; ++c)
      bend = std::max(bend, std::abs(knot(k - 1)[c] - 2 * knot(k)[c] + knot(k + 1)[c]) / 8);
  for (const auto& [entry, color] : table) {
    const Vec3 found = turbo_color(static_cast<float>(entry) / 255.0f);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(found[c], color[c], bend) << entry << " " << c;
  }
  EXPECT_EQ(turbo_color(-3), turbo_color(0));
  EXPECT_EQ(turbo_color(kNan), turbo_color(0));
  EXPECT_EQ(turbo_color(7), turbo_color(1));
}

TEST(DepthImage, RangeIsWeightedByAlpha) {
  // Ten pixels: 1 ... 10, of which the near five weigh next to nothing.
  std::vector<float> depth, alpha;
  for (int i = 10; i >= 1; --i) {
    depth.push_back(static_cast<float>(i));
    alpha.push_back(i > 5 ? 1.0f : 0.001f);
  }
  const DepthRange range = depth_range(depth, alpha, 0.1, 0.9);
  EXPECT_EQ(range.near, 6);
  EXPECT_EQ(range.far, 10);
  const std::vector<float> opaque(10, 1.0f);
  const DepthRange even = depth_range(depth, opaque, 0.15, 0.75);
  EXPECT_EQ(even.near, 2);
  EXPECT_EQ(even.far, 8);
}

TEST(DepthImage, RangeLeavesOutWhatHasNoDepth) {
  const std::vector<float> depth{0, 2, kNan, kInfinity, -1, 4, 9};
  const std::vector<float> alpha{1, 1, 1, 1, 1, 0.5f, 0};
  const DepthRange range = depth_range(depth, alpha, 0, 1);
  EXPECT_EQ(range.near, 2);
  EXPECT_EQ(range.far, 4);
  EXPECT_TRUE(depth_range({}, {}).empty());
  EXPECT_TRUE(depth_range(std::vector<float>{0, 1}, std::vector<float>{1, 0}).empty());
  const DepthRange ranges[] = {{}, {2, 5}, {1, 3}, {}};
  EXPECT_EQ(merged(ranges).near, 1);
  EXPECT_EQ(merged(ranges).far, 5);
  EXPECT_TRUE(merged({}).empty());
}

TEST(DepthImage, NearIsRedFarIsBlueOverBlack) {
  const std::vector<float> depth{1, 4, 1.6f, 0.5f, 8, 1, 0, kNan};
  const std::vector<float> alpha{1, 1, 1, 1, 1, 0.5f, 1, 1};
  const Image8 image = depth_image(4, 2, depth, alpha, {1, 4});
  ASSERT_EQ(image.width, 4);
  ASSERT_EQ(image.height, 2);
  ASSERT_EQ(image.channels, 3);
  ASSERT_EQ(image.pixels.size(), 24u);
  const auto expect = [&](int i, const Vec3& color) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(pixel(image, i)[c], 255 * color[c], 0.51) << i;
  };
  expect(0, turbo_color(1));
  expect(1, turbo_color(0));
  expect(2, turbo_color(0.5f));  // 1 / 1.6 is halfway between 1 and 1 / 4
  expect(3, turbo_color(1));
  expect(4, turbo_color(0));
  expect(5, turbo_color(1) * 0.5f);
  expect(6, {});
  expect(7, {});
  EXPECT_GT(pixel(image, 0).x, pixel(image, 0).z) << "near is red";
  EXPECT_LT(pixel(image, 1).x, pixel(image, 1).z) << "far is blue";
}

TEST(DepthImage, EmptyAndFlatRanges) {
  const std::vector<float> depth{2, 2}, alpha{1, 1};
  for (const uint8_t v : depth_image(2, 1, depth, alpha, {}).pixels) EXPECT_EQ(v, 0);
  const Image8 flat = depth_image(2, 1, depth, alpha, {2, 2});
  EXPECT_GT(pixel(flat, 0).x, 0);
  EXPECT_EQ(pixel(flat, 0), pixel(flat, 1));
  EXPECT_TRUE(depth_image(0, 0, {}, {}, {1, 2}).pixels.empty());
}

}  // namespace
}  // namespace nerf
