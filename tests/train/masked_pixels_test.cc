// Pixels that masks leave out: no photo shows them, and they are drawn as transparent ones.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>

#include "nerf/model/network_field.h"
#include "nerf/model/renderer.h"
#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"
#include "train/ray_batch.h"

namespace nerf {
namespace {

constexpr int kSize = 32;

// The sphere before a wall of another colour in each photo, without alpha. Every photo's mask
// leaves out the wall, which cuts the sphere out; with `spoilt` photos, whose masks leave out the
// sphere too, the set says that masks are of what stands in the way.
test::SyntheticCapture masked_capture(int photos, int spoilt) {
  test::SyntheticCapture c = test::sphere_capture(photos, kSize);
  c.scene.alpha = false;
  double masked = 0;
  for (int v = 0; v < photos; ++v) {
    Photo& photo = c.photos.photos[static_cast<size_t>(v)];
    photo.mask.assign(size_t{kSize} * kSize, 255);
    for (size_t i = 0; i < photo.mask.size(); ++i) {
      uint8_t* rgba = photo.pixels8.data() + 4 * i;
      if (rgba[3] < 255) {
        photo.mask[i] = 0;
        for (size_t k = 0; k < 3; ++k) rgba[k] = static_cast<uint8_t>(v * (40 + 31 * k));
        rgba[3] = 255;
      }
      if (v % 4 != 0 && v / 4 < spoilt) photo.mask[i] = 0;
      masked += photo.mask[i] == 0;
    }
  }
  c.photos.fraction_masked = spoilt > 0 ? 0.4 : masked / (photos * kSize * kSize);
  return c;
}

TEST(MaskedPixels, AreDrawnAsOftenAsTheyAreSaidTo) {
  const test::SyntheticCapture c = masked_capture(4, 0);
  PixelSource source(c.scene, c.photos);
  constexpr int kDraws = 20000;
  const auto count_masked = [&] {
    int masked = 0;
    for (uint64_t i = 0; i < kDraws; ++i) {
      Random random(1, 0, i);
      PixelSource::Pixel pixel;
      if (!source.draw(random, pixel)) continue;
      EXPECT_EQ(pixel.masked, pixel.photo->masked_out(pixel.x, pixel.y));
      EXPECT_EQ(pixel.ray.photo < 0, pixel.masked);
      EXPECT_EQ(pixel.alpha, pixel.masked ? 0 : 1);
      masked += pixel.masked;
    }
    return masked;
  };
  EXPECT_EQ(count_masked(), 0);
  source.draw_masked(0.25_r);
  int64_t out = 0;
  for (const int v : c.scene.train)
    for (const uint8_t m : c.photos.photos[static_cast<size_t>(v)].mask) out += m == 0;
  const double share =
      0.25 * static_cast<double>(out) / (static_cast<double>(c.scene.train.size()) * kSize * kSize);
  EXPECT_NEAR(count_masked(), share * kDraws, 4 * std::sqrt(share * (1 - share) * kDraws));
}

// Opacity of a view that training has not seen: means over the sphere and over what is beside it.
struct Opacity {
  double sphere = 0, beside = 0;
};
Opacity trained_opacity(const std::string& method, const test::SyntheticCapture& c,
                        double masked_share) {
  ThreadPool pool(2);
  TrainOptions options = test::tiny_options(method, method == kGridMethod ? 600 : 1500);
  options.pixel_recipe.masked_share = masked_share;
  Trainer trainer(c.scene, c.photos, options, pool);
  trainer.run({});
  const View& view = c.scene.views[0];
  const Photo cut_out = test::sphere_photo(c.scene.cameras[0], view.pose);
  const Frame frame = render(trainer.snapshot(), c.scene.cameras[0], view.pose, {}, pool);
  Opacity mean;
  int sphere = 0, beside = 0;
  for (size_t i = 0; i < frame.alpha.size(); ++i) {
    const uint8_t covered = cut_out.pixels8[4 * i + 3];
    if (covered != 0 && covered != 255) continue;  // the rim
    const bool on = covered != 0;
    (on ? mean.sphere : mean.beside) += frame.alpha[i];
    ++(on ? sphere : beside);
  }
  mean.sphere /= sphere;
  mean.beside /= beside;
  return mean;
}

TEST(MaskedPixels, AreMoreAndStayWhereMasksCutOut) {
  PhotoSet photos;
  TrainOptions options;
  EXPECT_EQ(masked_share(options, photos).first, 0);
  photos.fraction_masked = 0.2;
  MaskedShare share = masked_share(options, photos);
  EXPECT_DOUBLE_EQ(share.last, 0.01 * share.first);
  const double in_the_way = share.first;
  photos.fraction_masked = 0.6;
  share = masked_share(options, photos);
  EXPECT_GT(share.first, in_the_way);
  EXPECT_EQ(share.last, share.first);
  options.method = "nerf";
  EXPECT_EQ(masked_share(options, photos).first, 0);
  options.pixel_recipe.masked_share = 0.4;
  EXPECT_EQ(masked_share(options, photos).first, 0.4);
}

// Of a network that is opaque at the end nothing can be transparent.
TEST(MaskedPixels, OpenTheEndOfRays) {
  const auto options_after = [](const char* method, double share) {
    const test::SyntheticCapture c = masked_capture(8, 0);
    ThreadPool pool(1);
    TrainOptions options = test::tiny_method_options(method, 4);
    options.pixel_recipe.masked_share = share;
    return Trainer(c.scene, c.photos, options, pool).snapshot().network().options;
  };
  EXPECT_TRUE(options_after("mipnerf360", 0).opaque_end);
  EXPECT_FALSE(options_after("mipnerf360", 0.1).opaque_end);
  EXPECT_GT(options_after("nerfw", 0).last_interval, 0);
  EXPECT_EQ(options_after("nerfw", 0.1).last_interval, 0);
}

class MaskedPixelsOf : public ::testing::TestWithParam<std::string> {};

TEST_P(MaskedPixelsOf, AreEmptyWhereNoPhotoShowsAnything) {
  const test::SyntheticCapture c = masked_capture(24, 0);
  const Opacity without = trained_opacity(GetParam(), c, 0),
                with = trained_opacity(GetParam(), c, 0.5);
  RecordProperty("without", std::to_string(without.beside));
  EXPECT_GT(without.beside, 0.2);  // what nothing is said of is anything
  EXPECT_LT(with.beside, 0.05);
  EXPECT_GT(with.sphere, 0.95);
}

// Of one photo's rays, and of rays whose photo has codes.
INSTANTIATE_TEST_SUITE_P(Methods, MaskedPixelsOf, ::testing::Values("grid", "nerf", "nerfw"),
                         [](const auto& info) { return info.param; });

TEST(MaskedPixels, GiveWayToPhotosThatShowSomething) {
  const Opacity mean = trained_opacity(kGridMethod, masked_capture(24, 3), 0.5);
  EXPECT_LT(mean.beside, 0.05);
  EXPECT_GT(mean.sphere, 0.95);
}

}  // namespace
}  // namespace nerf
