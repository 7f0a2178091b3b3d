// Depth between the pixels of a map.
#include "nerf/io/depth_map.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "base/half.h"

namespace nerf {
namespace {

DepthMap make_map(int width, int height, const std::function<double(int, int)>& z) {
  DepthMap map{width, height, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      map.z.push_back(internal::float_to_half(static_cast<float>(z(x, y))));
  return map;
}

constexpr double kHalf = 0x1p-11;  // relative rounding of a stored depth

// Of a plane 1/z is linear in the picture: 1/z = a + b x + c y.
TEST(DepthMap, PlanesAreExactBetweenPixels) {
  const auto inverse = [](double x, double y) { return 0.5 + 0.004 * x - 0.003 * y; };
  const DepthMap map =
      make_map(16, 12, [&](int x, int y) { return 1 / inverse(x + 0.5, y + 0.5); });
  for (const auto& [x, y] : {std::pair{0.5, 0.5}, {7.0, 3.0}, {3.25, 10.75}, {15.5, 11.5}})
    EXPECT_NEAR(map.at(x / 16, y / 12) * inverse(x, y), 1, 1.01 * kHalf) << x << " " << y;
  // Beyond the middles of the outer pixels: theirs.
  EXPECT_NEAR(map.at(0, 0) * inverse(0.5, 0.5), 1, 1.01 * kHalf);
  EXPECT_NEAR(map.at(1, 1) * inverse(15.5, 11.5), 1, 1.01 * kHalf);
}

TEST(DepthMap, NothingIsKnownAcrossAnEdge) {
  const DepthMap map = make_map(8, 8, [](int x, int) { return x < 4 ? 1.0 : 2.0; });
  EXPECT_EQ(map.at(3.5 / 8, 0.5), 1);
  EXPECT_EQ(map.at(4.5 / 8, 0.5), 2);
  EXPECT_EQ(map.at(4.0 / 8, 0.5), 0);
  EXPECT_EQ(map.at(3.6 / 8, 0.5), 0);
}

// So that a map of the photo's size is known up to its edges.
TEST(DepthMap, TheMiddleOfAPixelIsItsOwn) {
  const DepthMap map = make_map(49, 47, [](int x, int y) { return (x + y) % 2 ? 1.0 : 2.0; });
  for (int y = 0; y < 47; ++y)
    for (int x = 0; x < 49; ++x)
      EXPECT_EQ(map.at((x + 0.5) / 49, (y + 0.5) / 47), map.pixel(x, y)) << x << " " << y;
}

TEST(DepthMap, NothingIsKnownBesideTheUnknown) {
  const DepthMap map = make_map(8, 8, [](int x, int y) { return x == 4 && y == 4 ? 0.0 : 1.0; });
  EXPECT_EQ(map.at(4.5 / 8, 4.5 / 8), 0);
  EXPECT_EQ(map.at(4.0 / 8, 4.0 / 8), 0);
  EXPECT_EQ(map.at(3.0 / 8, 3.0 / 8), 1);
  EXPECT_EQ(DepthMap().at(0.5, 0.5), 0);
}

}  // namespace
}  // namespace nerf
