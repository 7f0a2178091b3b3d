// Photos of one sphere through fog and water of known coefficients.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "nerf/model/renderer.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/medium_recipe.h"
#include "nerf/train/trainer.h"
#include "support/fogged_sphere.h"
#include "support/repeatable.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

Medium fog() {
  Medium m;
  m.attenuation = m.backscatter = {0.3, 0.3, 0.3};
  m.colour = {0.7_r, 0.75_r, 0.8_r};
  return m;
}

Medium water() {
  Medium m;
  m.attenuation = {0.9, 0.6, 0.5};
  m.backscatter = {0.7, 0.6, 0.5};
  m.colour = {0.2_r, 0.35_r, 0.8_r};
  return m;
}

TrainOptions options_with(LearntMedium medium, int64_t steps) {
  TrainOptions o = test::tiny_options(steps);
  o.grid_recipe.medium.medium = medium;
  return o;
}

// Within 10 %.
void expect_recovered(const Medium& learnt, const Medium& truth) {
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(learnt.attenuation[k], truth.attenuation[k], 0.1 * truth.attenuation[k]) << k;
    EXPECT_NEAR(learnt.backscatter[k], truth.backscatter[k], 0.1 * truth.backscatter[k]) << k;
    EXPECT_NEAR(learnt.colour[k], truth.colour[k], 0.1_r * truth.colour[k]) << k;
  }
}

// PSNR of the sphere's pixels without the medium, against its own colours.
double clear_psnr(const RadianceField& field, const test::SyntheticCapture& c, ThreadPool& pool) {
  RenderOptions options;
  options.medium.emplace();
  double squares = 0;
  size_t count = 0;
  for (const int v : c.scene.test) {
    const View& view = c.scene.views[static_cast<size_t>(v)];
    const Camera& camera = c.scene.cameras[0];
    const Photo truth = test::sphere_photo(camera, view.pose);
    const Frame seen = render(field, camera, view.pose, options, pool);
    for (size_t p = 0; p < seen.alpha.size(); ++p)
      for (size_t k = 0; k < 3 && truth.pixels8[4 * p + 3] == 255; ++k, ++count)
        squares += std::pow(truth.pixels8[4 * p + k] / 255.0 - double{seen.rgb[3 * p + k]}, 2);
  }
  return -10 * std::log10(squares / static_cast<double>(count));
}

void expect_learnt(LearntMedium kind, const Medium& truth, int64_t steps) {
  const auto c = test::fogged_capture(truth);
  ThreadPool pool(2);
  TrainOptions o = options_with(kind, steps);
  o.rate = 0.02;
  o.grid_recipe.batch_samples = 1920;
  Trainer trainer(c.scene, c.photos, o, pool);
  trainer.run({});
  const RadianceField field = trainer.snapshot();
  ASSERT_TRUE(field.medium());
  expect_recovered(*field.medium(), truth);
  EXPECT_GT(evaluate(field, c.scene, c.photos, {}, pool).psnr, 28) << "held-out photos, as taken";
  EXPECT_GT(clear_psnr(field, c, pool), 20);
}

TEST(LearntMedium, FogIsRecovered) { expect_learnt(LearntMedium::kFog, fog(), 1500); }
// Coefficients that differ slowly come apart from the colours of things.
TEST(LearntMedium, WaterIsRecovered) { expect_learnt(LearntMedium::kWater, water(), 6000); }

TEST(LearntMedium, ModelFilesKeepItAndPicturesShowItUnlessToldOtherwise) {
  const auto c = test::fogged_capture(water(), 8);
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, options_with(LearntMedium::kWater, 30), pool);
  trainer.run({});
  const test::TempFolder folder;
  const RadianceField field = trainer.snapshot();
  field.save(folder / "model");
  const RadianceField loaded = RadianceField::load(folder / "model");
  ASSERT_TRUE(loaded.medium());
  EXPECT_EQ(loaded.medium()->attenuation, field.medium()->attenuation);
  EXPECT_EQ(loaded.medium()->backscatter, field.medium()->backscatter);
  EXPECT_EQ(loaded.medium()->colour, field.medium()->colour);
  RenderOptions usual, own, clear;
  own.medium = field.medium();
  clear.medium.emplace();
  const auto picture = [&](const RadianceField& f, const RenderOptions& o) {
    return render(f, c.scene.cameras[0], c.scene.views[0].pose, o, pool).rgb;
  };
  EXPECT_EQ(picture(loaded, usual), picture(field, usual));
  EXPECT_EQ(picture(field, usual), picture(field, own));
  EXPECT_NE(picture(field, usual), picture(field, clear));
}

TEST(LearntMedium, ThreadsAndInterruptionsChangeNothing) {
  test::expect_repeatable(test::fogged_capture(water(), 8), options_with(LearntMedium::kWater, 24));
}

TEST(LearntMedium, PhotosWithAlphaAreRefused) {
  const auto c = test::sphere_capture();
  ThreadPool pool(1);
  const std::string problem = test::error_of(
      [&] { Trainer(c.scene, c.photos, options_with(LearntMedium::kFog, 10), pool); });
  EXPECT_TRUE(test::contains(problem, "alpha")) << problem;
}

}  // namespace
}  // namespace nerf
