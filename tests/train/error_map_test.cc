// Pixels are drawn where the photos are not learnt yet.
#include "train/error_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <vector>

#include "support/synthetic_scene.h"
#include "train/ray_batch.h"

namespace nerf {
namespace {

PhotoSet photos_of(const std::vector<std::pair<int, int>>& sizes) {
  PhotoSet set;
  for (const auto& [width, height] : sizes) {
    Photo photo;
    photo.width = width;
    photo.height = height;
    photo.channels = 3;
    photo.pixels8.resize(static_cast<size_t>(3 * width * height));
    set.photos.push_back(photo);
  }
  return set;
}

TEST(ErrorMap, TilesOfEveryPhotoAreDisjoint) {
  const PhotoSet photos = photos_of({{17, 9}, {8, 8}, {1, 25}});
  const std::vector<int> views = {2, 0, 1};
  ErrorMap map(photos, views, 0.5_r);
  std::set<int32_t> seen;
  for (size_t i = 0; i < views.size(); ++i) {
    const Photo& photo = photos.photos[static_cast<size_t>(views[i])];
    std::set<int32_t> own;
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x) own.insert(map.tile_of(i, x, y));
    EXPECT_EQ(own.size(), static_cast<size_t>((photo.width + 7) / 8 * ((photo.height + 7) / 8)));
    for (int32_t tile : own) {
      EXPECT_TRUE(seen.insert(tile).second);
      EXPECT_LT(static_cast<size_t>(tile), map.errors().size());
    }
  }
  EXPECT_EQ(seen.size(), map.errors().size());
}

TEST(ErrorMap, ChanceFollowsTheRootOfTheErrorAgainstItsMean) {
  const PhotoSet photos = photos_of({{32, 8}});
  const std::vector<int> views = {0};
  constexpr Real kGuidance = 0.8_r;
  ErrorMap map(photos, views, kGuidance);
  const Real average = 1 / ErrorMap::kMostFavoured;
  for (int32_t t = 0; t < 4; ++t) EXPECT_NEAR(map.chance(t), average, 1.0 / 256) << "unseen";
  map.observe(0, 0.0_r);
  map.observe(1, 0.01_r);
  map.observe(2, 0.09_r);  // roots 0, 0.1, 0.3: mean 0.4 / 3
  map.refresh();
  const Real ratio[] = {0, 0.75_r, 2.25_r, 1};
  for (int32_t t = 0; t < 4; ++t) {
    const Real want = std::min(1.0_r, (1 - kGuidance + kGuidance * ratio[t]) * average);
    EXPECT_NEAR(map.chance(t), want, 1.01 / 256) << t;
  }
  for (int i = 0; i < 200; ++i) map.observe(0, 0.09_r);  // forgets: 0.9^200
  map.refresh();
  EXPECT_EQ(map.chance(0), map.chance(2));
  map.reset();
  EXPECT_NEAR(map.chance(2), average, 1.0 / 256);
}

// The shares of the tiles among the drawn pixels are those of their chances. Binomial: 4 standard
// deviations of 40000 draws are below 0.01.
TEST(ErrorMap, PixelsAreDrawnByTheirChances) {
  auto capture = test::sphere_capture();
  ErrorMap map(capture.photos, capture.scene.train, 0.9_r);
  for (size_t t = 0; t < map.errors().size(); ++t)
    map.observe(static_cast<int32_t>(t), t % 3 == 0 ? 0.04_r : 0.0_r);
  map.refresh();
  const PixelSource source(capture.scene, capture.photos);
  const Photo& photo = capture.photos.photos[static_cast<size_t>(capture.scene.train[0])];
  std::vector<double> expected(map.errors().size());
  double all = 0;
  for (size_t i = 0; i < capture.scene.train.size(); ++i)
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x) {
        const int32_t t = map.tile_of(i, x, y);
        expected[static_cast<size_t>(t)] += static_cast<double>(map.chance(t));
        all += static_cast<double>(map.chance(t));
      }
  double wanted = 0, got = 0, plain = 0;
  constexpr int kDraws = 40000;
  for (uint64_t i = 0; i < kDraws; ++i) {
    PixelSource::Pixel pixel;
    Random random(1, 2, i), again(1, 2, i);
    ASSERT_TRUE(source.locate(random, &map, pixel));
    got += pixel.tile % 3 == 0;
    ASSERT_TRUE(source.locate(again, nullptr, pixel));
  }
  for (size_t t = 0; t < expected.size(); t += 3) wanted += expected[t] / all;
  for (size_t t = 0; t < expected.size(); t += 3)
    plain += 1.0 / static_cast<double>(expected.size());
  EXPECT_NEAR(got / kDraws, wanted, 0.01);
  EXPECT_GT(wanted, plain + 0.2);  // it makes a difference at all
}

}  // namespace
}  // namespace nerf
