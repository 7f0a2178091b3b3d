#include "nerf/io/depth_image.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace nerf {
namespace {

constexpr Real kNan = std::numeric_limits<Real>::quiet_NaN();
constexpr Real kInfinity = std::numeric_limits<Real>::infinity();

Vec3 pixel(const Image8& image, int i) {
  return {static_cast<Real>(image.pixels[3 * i]), static_cast<Real>(image.pixels[3 * i + 1]),
          static_cast<Real>(image.pixels[3 * i + 2])};
}

TEST(DepthImage, TurboFollowsThePublishedTable) {
  const struct {
    int entry;
    Vec3 color;
  } table[] = {{0, {0.18995_r, 0.07176_r, 0.23217_r}},   {8, {0.22500_r, 0.16354_r, 0.45096_r}},
               {64, {0.15844_r, 0.73551_r, 0.92305_r}},  {100, {0.24797_r, 0.96423_r, 0.54303_r}},
               {128, {0.64362_r, 0.98999_r, 0.23356_r}}, {192, {0.98360_r, 0.49291_r, 0.12849_r}},
               {248, {0.57103_r, 0.04474_r, 0.00529_r}}, {255, {0.47960_r, 0.01583_r, 0.01055_r}}};
  // Between 18 knots the curve is straight: off by at most an eighth of its second difference.
  const auto knot = [](int k) { return turbo_color(static_cast<Real>(k) / 17.0_r); };
  Real bend = 0;
  for (int k = 1; k < 17; ++k)
    for (int c = 0; c < 3; ++c)
      bend = std::max(bend, std::abs(knot(k - 1)[c] - 2 * knot(k)[c] + knot(k + 1)[c]) / 8);
  for (const auto& [entry, color] : table) {
    const Vec3 found = turbo_color(static_cast<Real>(entry) / 255.0_r);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(found[c], color[c], bend) << entry << " " << c;
  }
  EXPECT_EQ(turbo_color(-3), turbo_color(0));
  EXPECT_EQ(turbo_color(kNan), turbo_color(0));
  EXPECT_EQ(turbo_color(7), turbo_color(1));
}

TEST(DepthImage, RangeIsWeightedByAlpha) {
  // Ten pixels: 1 ... 10, of which the near five weigh next to nothing.
  std::vector<Real> depth, alpha;
  for (int i = 10; i >= 1; --i) {
    depth.push_back(static_cast<Real>(i));
    alpha.push_back(i > 5 ? 1.0_r : 0.001_r);
  }
  const DepthRange range = depth_range(depth, alpha, 0.1, 0.9);
  EXPECT_EQ(range.near, 6);
  EXPECT_EQ(range.far, 10);
  const std::vector<Real> opaque(10, 1.0_r);
  const DepthRange even = depth_range(depth, opaque, 0.15, 0.75);
  EXPECT_EQ(even.near, 2);
  EXPECT_EQ(even.far, 8);
}

TEST(DepthImage, RangeLeavesOutWhatHasNoDepth) {
  const std::vector<Real> depth{0, 2, kNan, kInfinity, -1, 4, 9};
  const std::vector<Real> alpha{1, 1, 1, 1, 1, 0.5_r, 0};
  const DepthRange range = depth_range(depth, alpha, 0, 1);
  EXPECT_EQ(range.near, 2);
  EXPECT_EQ(range.far, 4);
  EXPECT_TRUE(depth_range({}, {}).empty());
  EXPECT_TRUE(depth_range(std::vector<Real>{0, 1}, std::vector<Real>{1, 0}).empty());
  const DepthRange ranges[] = {{}, {2, 5}, {1, 3}, {}};
  EXPECT_EQ(merged(ranges).near, 1);
  EXPECT_EQ(merged(ranges).far, 5);
  EXPECT_TRUE(merged({}).empty());
}

TEST(DepthImage, NearIsRedFarIsBlueOverBlack) {
  const std::vector<Real> depth{1, 4, 1.6_r, 0.5_r, 8, 1, 0, kNan};
  const std::vector<Real> alpha{1, 1, 1, 1, 1, 0.5_r, 1, 1};
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
  expect(2, turbo_color(0.5_r));  // 1 / 1.6 is halfway between 1 and 1 / 4
  expect(3, turbo_color(1));
  expect(4, turbo_color(0));
  expect(5, turbo_color(1) * 0.5_r);
  expect(6, {});
  expect(7, {});
  EXPECT_GT(pixel(image, 0).x, pixel(image, 0).z) << "near is red";
  EXPECT_LT(pixel(image, 1).x, pixel(image, 1).z) << "far is blue";
}

TEST(DepthImage, EmptyAndFlatRanges) {
  const std::vector<Real> depth{2, 2}, alpha{1, 1};
  for (const uint8_t v : depth_image(2, 1, depth, alpha, {}).pixels) EXPECT_EQ(v, 0);
  const Image8 flat = depth_image(2, 1, depth, alpha, {2, 2});
  EXPECT_GT(pixel(flat, 0).x, 0);
  EXPECT_EQ(pixel(flat, 0), pixel(flat, 1));
  EXPECT_TRUE(depth_image(0, 0, {}, {}, {1, 2}).pixels.empty());
}

}  // namespace
}  // namespace nerf
