#include "nerf/io/depth_legend.h"

#include <gtest/gtest.h>

#include <cmath>

namespace nerf {
namespace {

Image8 grey(int width, int height) {
  return {width, height, 3,
          std::vector<uint8_t>(3 * static_cast<size_t>(width) * static_cast<size_t>(height), 90)};
}

const uint8_t* at(const Image8& image, int x, int y) {
  return image.pixels.data() + 3 * (static_cast<size_t>(y) * image.width + x);
}

TEST(ViridisColor, FollowsThePublishedTable) {
  const struct {
    int entry;
    Vec3 color;
  } table[] = {
      {0, {0.267004_r, 0.004874_r, 0.329415_r}},   {25, {0.282623_r, 0.140926_r, 0.457517_r}},
      {76, {0.206756_r, 0.371758_r, 0.553117_r}},  {128, {0.127568_r, 0.566949_r, 0.550556_r}},
      {179, {0.266941_r, 0.748751_r, 0.440573_r}}, {230, {0.741388_r, 0.873449_r, 0.149561_r}},
      {255, {0.993248_r, 0.906157_r, 0.143936_r}}};
  for (const auto& [entry, color] : table) {
    const Vec3 found = viridis_color(static_cast<Real>(entry) / 255.0_r);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(found[c], color[c], 0.01) << entry << " " << c;
  }
  EXPECT_EQ(depth_color(DepthLook::kDisparity, 0.25_r), (Vec3{0.25_r, 0.25_r, 0.25_r}));
  EXPECT_EQ(depth_color(DepthLook::kTurbo, 0.3_r), turbo_color(0.3_r));
}

// The bar goes through the map from the near end to the far one, and pictures stay as they are.
TEST(DepthLegend, StandsBesideThePicture) {
  for (const DepthLook map : {DepthLook::kTurbo, DepthLook::kViridis, DepthLook::kDisparity})
    for (const int height : {120, 800}) {
      const Image8 picture = grey(50, height), out = with_legend(picture, {1, 4}, map);
      ASSERT_EQ(out.width, 50 + legend_width(height));
      ASSERT_EQ(out.height, height);
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < 50; ++x) ASSERT_EQ(at(out, x, y)[1], 90);
      const int scale = height / 360 > 0 ? height / 360 : 1, column = 50 + 4 * scale;
      const int top = 26 * scale, bottom = height - 3 * scale - 1;
      const auto expect_color = [&](int y, Real x) {
        const Vec3 color = depth_color(map, x);
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(at(out, column, y)[c], 255 * color[c], 2) << y;
      };
      expect_color(top, 1);
      expect_color(bottom, 0);
      expect_color((top + bottom) / 2,
                   1 - (((bottom - top) / 2)) / static_cast<Real>(bottom - top));
    }
}

// Numbers are those of the colours: half the inverse depth between 1 and 4 is that of 1.6.
TEST(DepthLegend, NumbersAreThoseOfTheColours) {
  const Image8 out = with_legend(grey(10, 200), {1, 4}, DepthLook::kTurbo);
  // Rows of letters, as they are drawn, read at the middle tick.
  const auto row = [&](int y) {
    std::string dots;
    for (int x = 10 + 3 + 10 + 3; x < out.width; ++x) dots += at(out, x, y)[0] == 255 ? '#' : '.';
    while (!dots.empty() && dots.back() == '.') dots.pop_back();
    return dots;
  };
  const int middle = 26 + static_cast<int>(std::lround(0.5 * (200 - 26 - 3 - 1)));
  EXPECT_EQ(row(middle - 3), "..#...........##");  // 1.6
  EXPECT_EQ(row(middle), "..#.........####");
  EXPECT_EQ(row(middle + 3), ".###...##....###");
}

TEST(DepthLegend, AnEmptyRangeAndASmallPictureAreDrawnToo) {
  const Image8 none = with_legend(grey(10, 20), {}, DepthLook::kTurbo);
  for (int x = 10; x < none.width; ++x) EXPECT_EQ(at(none, x, 5)[0], 0);
  for (int height = 1; height < 60; ++height)
    EXPECT_EQ(with_legend(grey(3, height), {1, 2}, DepthLook::kTurbo).height, height);
}

TEST(NormalImage, IsDarkWhereThereIsNone) {
  const std::vector<Real> normals{1, 0, 0, 0, -1, 0, 0, 0, 0};
  const std::vector<Real> alpha{1, 0.5_r, 1};
  const Image8 image = normal_image(3, 1, normals, alpha);
  EXPECT_EQ(image.pixels, (std::vector<uint8_t>{255, 128, 128, 64, 0, 64, 0, 0, 0}));
}

}  // namespace
}  // namespace nerf
