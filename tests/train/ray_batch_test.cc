#include "train/ray_batch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "support/cameras.h"
#include "support/synthetic_scene.h"

namespace nerf {
namespace {

// Which chunk, point and sample a number stands for.
Real label(int array, int chunk, int sample) {
  return static_cast<Real>((array * 4 + chunk) * kChunkSamples + sample);
}

TEST(RayBatch, KeepsThePointsOfTheSamplesThatLearn) {
  const std::vector<int32_t> kept{0, 3, 15, 16, 17, 100, 238, 239};
  constexpr int kChunks = 3, kChanged = 1;
  RayBatch batch(kChunks);
  AlignedArray<Real>* arrays[] = {&batch.x, &batch.y, &batch.z};
  const auto at = [&](int a, int c, int s) -> Real& {
    return (*arrays[a])[static_cast<size_t>(c * kChunkSamples + s)];
  };
  for (int a = 0; a < 3; ++a)
    for (int c = 0; c < kChunks; ++c)
      for (int s = 0; s < kChunkSamples; ++s) at(a, c, s) = label(a, c, s);
  batch.keep_points(kChanged, kept.data(), static_cast<int64_t>(kept.size()));
  for (int a = 0; a < 3; ++a)
    for (int c = 0; c < kChunks; ++c) {
      const int count = c == kChanged ? static_cast<int>(kept.size()) : kChunkSamples;
      for (int s = 0; s < count; ++s)
        ASSERT_EQ(at(a, c, s), label(a, c, c == kChanged ? kept[static_cast<size_t>(s)] : s))
            << "array " << a << " chunk " << c << " sample " << s;
    }
}

// Of a panorama and an ordinary photo of as many pixels: the panorama's caps above 60 degrees are a
// third of its rows and 1 - sin(60) of its sphere, and all of it is 2 / pi of its pixels.
TEST(PixelSource, DrawsPanoramasBySolidAngle) {
  Scene scene;
  PhotoSet photos;
  for (const bool around : {true, false}) {
    View view;
    view.name = around ? "around" : "ahead";
    view.camera = static_cast<int>(scene.views.size());
    scene.train.push_back(view.camera);
    scene.views.push_back(view);
    scene.cameras.push_back(around ? panorama(96, 48) : test::pinhole(96, 48, 50));
    Photo photo;
    photo.width = 96;
    photo.height = 48;
    photo.channels = 3;
    photo.pixels8.assign(3 * 96 * 48, 100);
    photos.photos.push_back(photo);
  }
  photos.cameras = scene.cameras;
  const PixelSource source(scene, photos);
  constexpr int kDraws = 40000;
  int around = 0, caps = 0, ahead_caps = 0;
  for (uint64_t i = 0; i < kDraws; ++i) {
    Random random(3, 0, i);
    PixelSource::Pixel pixel;
    ASSERT_TRUE(source.draw(random, pixel));
    const bool cap = pixel.y < 8 || pixel.y >= 40;
    around += pixel.source == 0;
    (pixel.source == 0 ? caps : ahead_caps) += cap;
  }
  const double share = 2 / std::numbers::pi / (1 + 2 / std::numbers::pi);
  const auto deviation = [](double p, double n) { return std::sqrt(p * (1 - p) / n); };
  EXPECT_NEAR(around, share * kDraws, 4 * kDraws * deviation(share, kDraws));
  const double cap = 1 - std::sqrt(3.0) / 2;
  EXPECT_NEAR(caps, cap * around, 4 * around * deviation(cap, around));
  const double ahead = kDraws - around;
  EXPECT_NEAR(ahead_caps, ahead / 3, 4 * ahead * deviation(1.0 / 3, ahead));
}

}  // namespace
}  // namespace nerf
