// Photos of one sphere in several lights.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "nerf/math/srgb.h"
#include "nerf/model/field.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/light_probe.h"
#include "nerf/train/trainer.h"
#include "support/repeatable.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

// Photo i is so bright, against the others.
double gain_of(int i) { return 0.7 + 0.15 * (i % 4) - 0.1 * (i % 3); }

test::SyntheticCapture in_many_lights(int views = 24, int size = 32) {
  auto c = test::sphere_capture(views, size);
  for (int i = 0; i < views; ++i) {
    auto& pixels = c.photos.photos[static_cast<size_t>(i)].pixels8;
    for (size_t at = 0; at < pixels.size(); ++at)
      if (at % 4 < 3)
        pixels[at] =
            static_cast<uint8_t>(std::lround(gain_of(i) * static_cast<double>(pixels[at])));
  }
  return c;
}

TrainOptions options_with(int appearance, Switch colours, int64_t steps) {
  TrainOptions o = test::tiny_options(steps);
  o.grid_recipe.light.appearance = {false, appearance};
  o.grid_recipe.light.colour_correction = colours;
  return o;
}

double held_out(const test::SyntheticCapture& c, const TrainOptions& options, ThreadPool& pool) {
  Trainer trainer(c.scene, c.photos, options, pool);
  trainer.run({});
  EvaluationOptions how;
  how.fit_light = FitLight::kOn;
  const Evaluation e = evaluate(trainer.snapshot(), c.scene, c.photos, how, pool);
  EXPECT_TRUE(e.halves);
  return e.psnr;
}

TEST(Light, CodesAndCorrectionsExplainIt) {
  const auto c = in_many_lights();
  ThreadPool pool(2);
  const double plain = held_out(c, options_with(0, Switch::kOff, 300), pool);
  const double codes = held_out(c, options_with(4, Switch::kOff, 300), pool);
  const double corrected = held_out(c, options_with(0, Switch::kOn, 300), pool);
  RecordProperty("plain", std::to_string(plain));
  RecordProperty("codes", std::to_string(codes));
  RecordProperty("corrected", std::to_string(corrected));
  EXPECT_GT(codes, plain + 2);
  EXPECT_GT(corrected, plain + 2);
}

// The gains that were learnt of photos from one place are those that they have: a view direction
// cannot tell them apart.
TEST(Light, CorrectionsAreThePhotosGains) {
  auto c = test::sphere_capture(24, 32);
  const auto gain = [](size_t i) { return 0.5 + 0.15 * static_cast<double>(i % 4); };
  for (size_t i = 0; i < c.scene.views.size(); ++i) {
    const size_t place = i / 4 * 4;  // the held-out one of the four
    c.scene.views[i].pose = c.scene.views[place].pose;
    if (i == place) continue;
    c.photos.photos[i] = c.photos.photos[place];
    auto& pixels = c.photos.photos[i].pixels8;
    for (size_t at = 0; at < pixels.size(); ++at)
      if (at % 4 < 3)
        pixels[at] = static_cast<uint8_t>(std::lround(gain(i) * static_cast<double>(pixels[at])));
  }
  ThreadPool pool(2);
  TrainOptions unbiased = options_with(0, Switch::kOn, 800);
  unbiased.grid_recipe.light.colour_decay = 0;
  Trainer trainer(c.scene, c.photos, unbiased, pool);
  trainer.run({});
  const RadianceField model = trainer.snapshot();
  const CodeBooks& books = model.field().codes();
  ASSERT_EQ(books.photos.size(), c.scene.train.size());
  std::vector<double> learnt;  // of a grey that the sphere has
  for (int p = 0; p < books.rows(); ++p) {
    const size_t view = static_cast<size_t>(c.scene.train[static_cast<size_t>(p)]);
    EXPECT_EQ(books.photos[static_cast<size_t>(p)], c.scene.views[view].name);
    const Real grey[3] = {0.33_r, 0.33_r, 0.33_r};
    const auto seen =
        appearance_of(books, model.field().all_weights(), p).changed(grey, 1, {0, 0, 0});
    learnt.push_back(static_cast<double>(seen[0] + seen[1] + seen[2]));
  }
  // 0.65, 0.8 and 0.95 of what is there.
  for (size_t p = 0; p < learnt.size(); p += 3) {
    EXPECT_NEAR(learnt[p] / learnt[p + 1], 0.65 / 0.8, 0.05) << p;
    EXPECT_NEAR(learnt[p + 2] / learnt[p + 1], 0.95 / 0.8, 0.05) << p;
  }
}

TEST(Light, GoesOnBitForBitForAnyNumberOfThreads) {
  const auto c = in_many_lights(8);
  TrainOptions options = options_with(4, Switch::kOn, 30);
  options.grid_recipe.light.robust = {false, 0.2};
  test::expect_repeatable(c, options);
}

TEST(Light, FixedLightNeedsNothing) {
  const auto c = test::sphere_capture(12);
  ThreadPool pool(2);
  const LightProbe probe = probe_light(c.scene, c.photos, pool);
  EXPECT_FALSE(probe.exposure_spread.has_value());  // no sparse points
  EXPECT_FALSE(probe.smooth_share.has_value());     // its box ends the scene
  TrainOptions o;
  resolve_light(probe, o);
  EXPECT_EQ(o.grid_recipe.light.appearance, (AutoCount{false, 0}));
  EXPECT_EQ(o.grid_recipe.light.colour_correction, Switch::kOff);
  EXPECT_EQ(o.grid_recipe.light.vignetting, Switch::kOff);
  EXPECT_FALSE(o.pixel_recipe.point_depth.has_value());
}

TEST(Light, WhatDiffersIsLearntUnlessItIsSaidOtherwise) {
  TrainOptions shadow;
  resolve_light({0.03, 0.5, 0.38, 0.08}, shadow);
  EXPECT_GT(shadow.grid_recipe.light.appearance.count, 0);
  EXPECT_EQ(shadow.grid_recipe.light.colour_correction, Switch::kOff);
  EXPECT_FALSE(shadow.pixel_recipe.point_depth.has_value());
  TrainOptions phone;  // that chooses its exposure for each photo
  resolve_light({0.3, 0.35, 0.35}, phone);
  EXPECT_EQ(phone.grid_recipe.light.appearance.count, 0);
  EXPECT_EQ(phone.grid_recipe.light.colour_correction, Switch::kOn);
  EXPECT_FALSE(phone.pixel_recipe.point_depth.has_value());
  TrainOptions shines;  // and is brighter from where the lamp is seen in it
  resolve_light({0.3, 0.2, 0.2}, shines);
  EXPECT_EQ(shines.grid_recipe.light.colour_correction, Switch::kOff);
  TrainOptions days;
  resolve_light({0.8, {}}, days);
  EXPECT_GT(days.grid_recipe.light.appearance.count, 0);
  EXPECT_EQ(days.grid_recipe.light.colour_correction, Switch::kOn);
  EXPECT_EQ(days.grid_recipe.light.vignetting, Switch::kOn);
  EXPECT_GT(days.pixel_recipe.point_depth.value_or(0), 0);
  EXPECT_EQ(days.grid_recipe.light.robust, (AutoShare{false, 0}));
  TrainOptions people;  // of whom most of the even error is
  resolve_light({0.3, 0.64, 0.27, 0.24}, people);
  EXPECT_EQ(people.grid_recipe.light.robust, (AutoShare{false, 0.24}));
  EXPECT_EQ(people.grid_recipe.light.appearance.count, 0);
  EXPECT_EQ(people.grid_recipe.light.colour_correction, Switch::kOff);
  TrainOptions crowd;
  resolve_light({{}, 0.6, 0.2, 0.55}, crowd);
  EXPECT_EQ(crowd.grid_recipe.light.robust, (AutoShare{false, 0.5}));
  TrainOptions said = options_with(0, Switch::kOff, 1);
  said.grid_recipe.light.robust = {false, 0};
  said.pixel_recipe.point_depth = 0;
  resolve_light({0.8, 0.9, 0.9, 0.3}, said);
  EXPECT_EQ(said.grid_recipe.light.appearance.count, 0);
  EXPECT_EQ(said.grid_recipe.light.colour_correction, Switch::kOff);
  EXPECT_EQ(said.pixel_recipe.point_depth, 0);
  EXPECT_EQ(said.grid_recipe.light.robust, (AutoShare{false, 0}));
}

// The sphere in a round room with waves on its wall.
bool room_colour(const Vec3d& origin, const Vec3d& d, double rgb[3]) {
  if (test::sphere_colour(origin, d, rgb)) return true;
  constexpr double kRoom = 4;  // radius
  const double along = dot(origin, d);
  const double t = -along + std::sqrt(along * along - dot(origin, origin) + kRoom * kRoom);
  const Vec3d wall = origin + d * t;
  for (int k = 0; k < 3; ++k) rgb[k] = 0.5 + 0.3 * std::sin(1.5 * wall[k] + k);
  return true;
}

// A box of a fifth of the pixels, of another colour and elsewhere in each photo.
TEST(Light, WhatPassesByIsSeenInAShortTraining) {
  constexpr int kSize = 48, kBox = 22;
  auto c = test::sphere_capture(24, kSize);
  c.scene.unbounded = true;
  c.scene.alpha = false;
  c.scene.near = 2;  // nothing before the sphere
  for (size_t i = 0; i < c.photos.photos.size(); ++i)
    c.photos.photos[i] = test::photo_of(c.photos.cameras[i], c.scene.views[i].pose, 2, room_colour);
  ThreadPool pool(2);
  const LightProbe clean = probe_light(c.scene, c.photos, pool);
  for (size_t i = 0; i < c.photos.photos.size(); ++i) {
    const size_t left = i * 11 % (kSize - kBox), top = i * 17 % (kSize - kBox);
    for (size_t y = top; y < top + kBox; ++y)
      for (size_t x = left; x < left + kBox; ++x)
        for (size_t k = 0; k < 3; ++k)
          c.photos.photos[i].pixels8[4 * (y * kSize + x) + k] = (i >> k) % 2 ? 255 : 0;
  }
  const LightProbe passing = probe_light(c.scene, c.photos, pool);
  ASSERT_TRUE(clean.passing_share && passing.passing_share);
  RecordProperty("clean", std::to_string(*clean.passing_share));
  RecordProperty("passing", std::to_string(*passing.passing_share));
  TrainOptions alone, crowded;
  resolve_light(clean, alone);
  resolve_light(passing, crowded);
  EXPECT_EQ(alone.grid_recipe.light.robust, (AutoShare{false, 0}));
  EXPECT_GT(crowded.grid_recipe.light.robust.number, 0.15);
  EXPECT_LT(crowded.grid_recipe.light.robust.number, 0.4);
}

// Points that every photo sees, of one grey, in photos of two exposures: one stop apart.
TEST(Light, ExposuresAreSeenAtSparsePoints) {
  auto c = test::sphere_capture(20, 32);
  Scene& scene = c.scene;
  for (int i = 0; i < 60; ++i) {
    const double a = 0.3 * i;
    scene.points.push_back({{0.1 * std::cos(a), 0.1 * std::sin(a), 0.004 * (i - 30)}, 0.5, 15});
    for (const int v : scene.train) scene.observations.push_back({v, i});
  }
  for (size_t v = 0; v < scene.views.size(); ++v) {
    auto& pixels = c.photos.photos[v].pixels8;
    for (size_t at = 0; at < pixels.size(); ++at)
      if (at % 4 < 3) pixels[at] = v % 2 ? 200 : 100;
  }
  ThreadPool pool(2);
  const auto spread = probe_light(scene, c.photos, pool).exposure_spread;
  ASSERT_TRUE(spread.has_value());
  // Ten photos of the one and five of the other. (The fit is alternating: 1e-3.)
  const double stops = std::log2(srgb_to_linear(200 / 255.0) / srgb_to_linear(100 / 255.0));
  EXPECT_NEAR(*spread, stops * std::sqrt(10.0 * 5.0) / 15, 1e-3);
}

}  // namespace
}  // namespace nerf
