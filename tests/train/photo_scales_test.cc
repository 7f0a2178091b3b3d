#include "nerf/io/photo_scales.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "nerf/train/evaluation.h"
#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/ray_batch.h"

namespace nerf {
namespace {

test::SyntheticCapture scaled_capture(int scales, bool training = true) {
  auto c = test::sphere_capture(8, 64);
  ThreadPool pool(2);
  add_photo_scales(c.scene, c.photos, scales, training, pool);
  return c;
}

// The view that another one is a smaller photo of.
size_t full_view(const Scene& scene, size_t v) {
  const View& view = scene.views[v];
  if (view.scale == 1) return v;
  const std::string folder = "scale" + std::to_string(view.scale) + "/";
  EXPECT_EQ(view.name.substr(0, folder.size()), folder);
  const auto found = std::ranges::find(scene.views, view.name.substr(folder.size()), &View::name);
  EXPECT_NE(found, scene.views.end());
  return static_cast<size_t>(found - scene.views.begin());
}

TEST(PhotoScales, OneChangesNothing) {
  const auto before = test::sphere_capture(8, 64), after = scaled_capture(1);
  EXPECT_EQ(after.scene.views.size(), before.scene.views.size());
  EXPECT_EQ(after.photos.photos.size(), before.photos.photos.size());
}

// Means of blocks, colours weighted by alpha; stored numbers are off by half of 1/255 and, of a
// colour, by what rounding alpha adds.
TEST(PhotoScales, PixelsAreTheMeansOfThoseTheyCover) {
  const auto c = scaled_capture(3);
  int reduced = 0;
  for (size_t v = 0; v < c.scene.views.size(); ++v) {
    const Photo& full = c.photos.photos[full_view(c.scene, v)];
    const Photo& photo = c.photos.photos[v];
    const int scale = c.scene.views[v].scale;
    reduced += scale > 1;
    ASSERT_EQ(photo.width, full.width / scale);
    ASSERT_EQ(photo.height, full.height / scale);
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x) {
        double sum[4] = {0, 0, 0, 0};
        for (int j = 0; j < scale; ++j)
          for (int i = 0; i < scale; ++i) {
            Real p[4];
            full.pixel(scale * x + i, scale * y + j, p);
            for (int k = 0; k < 3; ++k) sum[k] += static_cast<double>(p[k] * p[3]);
            sum[3] += static_cast<double>(p[3]);
          }
        Real got[4];
        photo.pixel(x, y, got);
        EXPECT_NEAR(static_cast<double>(got[3]), sum[3] / (scale * scale), 0.51 / 255);
        for (int k = 0; k < 3 && sum[3] > 0; ++k)
          EXPECT_NEAR(static_cast<double>(got[k]), sum[k] / sum[3], 0.51 / 255);
      }
  }
  EXPECT_EQ(reduced, 2 * 8);
}

TEST(PhotoScales, CamerasSeeTheSameAndViewsStayInTheirSplit) {
  const auto original = test::sphere_capture(8, 64);
  for (const bool training : {true, false}) {
    const auto c = scaled_capture(3, training);
    ASSERT_EQ(c.photos.cameras.size(), c.scene.views.size());
    ASSERT_EQ(c.photos.photos.size(), c.scene.views.size());
    for (size_t i = 0; i < c.scene.views.size(); ++i) {
      const View& view = c.scene.views[i];
      const Vec2d at{3.5, 2.5};
      const auto here = unproject(c.photos.cameras[i], at);
      const auto there = unproject(c.photos.cameras[full_view(c.scene, i)],
                                   {at.x * view.scale, at.y * view.scale});
      EXPECT_NEAR(length(normalized(*here) - normalized(*there)), 0, 1e-12);
    }
    for (const auto member : {&Scene::train, &Scene::test}) {
      const std::vector<int>&got = c.scene.*member, &one = original.scene.*member;
      const size_t scales = training || member == &Scene::test ? 3 : 1;
      ASSERT_EQ(got.size(), scales * one.size());
      for (size_t i = 0; i < got.size(); ++i) {
        const size_t v = static_cast<size_t>(got[i]);
        EXPECT_EQ(c.scene.views[v].scale, 1 << (i / one.size()));
        EXPECT_EQ(full_view(c.scene, v), static_cast<size_t>(one[i % one.size()]));
      }
    }
  }
}

// A field of points learns nothing from them.
TEST(PhotoScales, AreTrainedOnWhereTheMethodSeesTheWidthOfAPixel) {
  TrainOptions options;
  EXPECT_FALSE(learns_from_reduced_photos(options));
  options.method = "mipnerf";
  EXPECT_TRUE(learns_from_reduced_photos(options));
}

TEST(PhotoScales, AMaskKeepsWhatIsMostlyKept) {
  auto c = test::sphere_capture(2, 32);
  Photo& photo = c.photos.photos[0];
  photo.mask.assign(static_cast<size_t>(photo.width) * static_cast<size_t>(photo.height), 255);
  const auto hide = [&](int x, int y) {
    photo.mask[static_cast<size_t>(y) * static_cast<size_t>(photo.width) + static_cast<size_t>(x)] =
        0;
  };
  hide(0, 0);                                      // one of four: kept
  hide(2, 0), hide(3, 0);                          // two: kept
  hide(4, 0), hide(5, 0), hide(4, 1);              // three: out
  hide(6, 0), hide(7, 0), hide(6, 1), hide(7, 1);  // all
  ThreadPool pool(1);
  add_photo_scales(c.scene, c.photos, 2, /*training=*/true, pool);
  const auto half_of = [&](size_t v) -> const Photo& {
    const auto at =
        std::ranges::find(c.scene.views, "scale2/" + c.scene.views[v].name, &View::name);
    return c.photos.photos.at(static_cast<size_t>(at - c.scene.views.begin()));
  };
  const Photo& half = half_of(0);
  ASSERT_FALSE(half.mask.empty());
  const std::array<bool, 5> out{false, false, true, true, false};
  for (int x = 0; x < 5; ++x) EXPECT_EQ(half.masked_out(x, 0), out[static_cast<size_t>(x)]) << x;
  EXPECT_TRUE(half_of(1).mask.empty());
}

TEST(PhotoScales, TooSmallPhotosAreAnError) {
  auto c = test::sphere_capture(2, 32);
  ThreadPool pool(1);
  const std::string error =
      test::error_of([&] { add_photo_scales(c.scene, c.photos, 4, /*training=*/true, pool); });
  EXPECT_TRUE(test::contains(error, "1/")) << error;
  EXPECT_TRUE(test::contains(error, "--scales")) << error;
}

// Drawn as often as there are pixels, weighing their area: all scales count alike.
TEST(PhotoScales, EveryScaleWeighsTheSame) {
  const auto c = scaled_capture(3);
  const PixelSource source(c.scene, c.photos);
  EXPECT_NEAR(source.mean_weight(), 3 / (1 + 0.25 + 0.0625), 1e-6);
  std::map<Real, double> weight;
  constexpr int kDraws = 200000;
  for (uint64_t i = 0; i < kDraws; ++i) {
    Random random(1, 2, i);
    PixelSource::Pixel pixel;
    ASSERT_TRUE(source.draw(random, pixel));
    weight[pixel.weight] += static_cast<double>(pixel.weight);
  }
  EXPECT_EQ(source.photos(), c.scene.train.size());
  EXPECT_EQ(source.files().size(), source.photos());  // by name: they have no file
  ASSERT_EQ(weight.size(), 3u);
  for (const auto& [each, sum] : weight) {
    // A binomial count with a share of pixels p: its standard deviation, times the weight.
    const double p = 1 / (static_cast<double>(each) * 1.3125);
    const double deviation = static_cast<double>(each) * std::sqrt(kDraws * p * (1 - p));
    EXPECT_NEAR(sum, kDraws / 1.3125, 4 * deviation) << each;
  }
}

// Held-out views are measured at each scale; training goes on as with one.
TEST(PhotoScales, AreTrainedOnAndMeasuredApart) {
  ThreadPool pool(2);
  for (const char* method : {"grid", "mipnerf"}) {
    TrainOptions options = test::tiny_options(150);
    if (std::string(method) != kGridMethod) {
      options.method = method;
      options.network.width = options.network.proposal_width = options.network.bottleneck = 16;
      options.network.depth = options.network.proposal_depth = 2;
      options.recipe.rays = 64;
      options.steps = 3;
    }
    const auto c = scaled_capture(2, learns_from_reduced_photos(options));
    Trainer trainer(c.scene, c.photos, options, pool);
    trainer.run({});
    const RadianceField field = trainer.snapshot();
    EXPECT_EQ(field.info().views.size(), 8u) << "a path through each camera";
    const Evaluation e = evaluate(field, c.scene, c.photos, {}, pool);
    ASSERT_EQ(e.scales.size(), 2u);
    double sum = 0;
    for (size_t s = 0; s < 2; ++s) {
      EXPECT_EQ(e.scales[s].scale, 1 << s);
      EXPECT_EQ(e.scales[s].counted, static_cast<int>(c.scene.test.size()) / 2);
      sum += e.scales[s].psnr;
    }
    EXPECT_NEAR(sum / 2, e.psnr, 1e-9);
    EXPECT_GT(e.psnr, options.method == kGridMethod ? 15 : 3);  // a white picture has 11 dB
  }
}

}  // namespace
}  // namespace nerf
