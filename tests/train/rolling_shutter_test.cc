// A film whose rows are read one after another: how its cameras move, what a training makes of it,
// and that the time of reading is found.
#include "train/rolling_shutter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "nerf/math/refined_camera.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/metrics.h"
#include "nerf/train/trainer.h"
#include "support/synthetic_film.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/scene_fingerprint.h"

namespace nerf {
namespace {

using test::film_capture;

CameraRecipe with_readout(double share) {
  CameraRecipe recipe;
  recipe.rolling_shutter = {false, share};
  return recipe;
}

// Frames of a camera of constant twist, at those times.
Scene steady_film(const Twist& per_unit, const std::vector<double>& times) {
  Scene scene;
  scene.cameras = {test::sphere_camera(20)};
  const Pose first{rotation_by({0.4, -0.9, 0.3}), {0.3, -1.2, 0.5}};
  for (size_t i = 0; i < times.size(); ++i) {
    View view;
    view.name = std::to_string(i);
    view.clock = times[i];
    view.pose = moved(first, motion_by(per_unit * times[i]));
    scene.views.push_back(view);
  }
  return scene;
}

void expect_twist(const Twist& got, const Twist& want, const std::string& where = "") {
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(got.rotation[k], want.rotation[k], 1e-12) << where;
    EXPECT_NEAR(got.translation[k], want.translation[k], 1e-12) << where;
  }
}

const Twist kTwist{{0.02, -0.05, 0.03}, {0.3, 0.1, -0.2}};

TEST(RollingShutter, SteadyCamerasHaveTheirTwist) {
  // At both ends, between neighbours that are not equally far, and beside a gap.
  const Scene scene = steady_film(kTwist, {0, 1, 2, 4, 5, 6, 10, 11, 12});
  const RollingShutter shutter(scene, with_readout(0.5));
  for (size_t v = 0; v < scene.views.size(); ++v)
    expect_twist(shutter.twist(v), kTwist, std::to_string(v));
  expect_twist(shutter.motion(3).twist, kTwist * 0.5);
  EXPECT_EQ(shutter.motion(3).along, (Vec2d{0, 1}));
}

TEST(RollingShutter, AFrameThatIsAloneStandsStill) {
  const Scene scene = steady_film(kTwist, {0, 1, 2, 9, 20, 21});
  const RollingShutter shutter(scene, with_readout(0.5));
  EXPECT_EQ(shutter.twist(3), Twist());
  expect_twist(shutter.twist(4), kTwist);
}

// Of a film's frames some are taken: its own interval counts, not theirs.
TEST(RollingShutter, AFrameOfTheFilmIsTheTime) {
  Scene scene = steady_film(kTwist, {0, 8, 16, 25});
  scene.frame_interval = 0.25;
  expect_twist(RollingShutter(scene, with_readout(1)).twist(1), kTwist * 0.25);
}

TEST(RollingShutter, OtherCamerasAreOtherFilms) {
  Scene scene = steady_film(kTwist, {0, 1, 2, 3, 4, 5});
  for (size_t v = 0; v < 6; ++v) {
    View& view = scene.views[v];
    view.name = (v < 3 ? "left/" : "right/") + view.name;
    if (v < 3) continue;
    view.clock = static_cast<double>(v - 3);
    view.pose.translation = view.pose.translation + Vec3d{100, 0, 0};
  }
  const RollingShutter shutter(scene, with_readout(1));
  for (size_t v = 0; v < 6; ++v) expect_twist(shutter.twist(v), kTwist, std::to_string(v));
  EXPECT_EQ(shutter.readouts().size(), 2u);
  EXPECT_EQ(shutter.camera_of(2), 0u);
  EXPECT_EQ(shutter.camera_of(3), 1u);
}

TEST(RollingShutter, LinesAreTheSensorsLongSide) {
  Scene scene = steady_film(kTwist, {0, 1, 2});
  scene.cameras[0].height = 40;
  CameraRecipe recipe = with_readout(1);
  EXPECT_EQ(RollingShutter(scene, recipe).motion(0).along, (Vec2d{-1, 0}));
  EXPECT_EQ(RollingShutter(scene, recipe).motion(0).middle, -0.5);
  recipe.first_line = FirstLine::kTop;
  EXPECT_EQ(RollingShutter(scene, recipe).motion(0).along, (Vec2d{0, 1}));
  recipe.first_line = FirstLine::kBottom;
  EXPECT_EQ(RollingShutter(scene, recipe).motion(0).along, (Vec2d{0, -1}));
}

std::string error_of(const Scene& scene) {
  try {
    RollingShutter(scene, with_readout(1));
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(RollingShutter, WhatIsNoFilmIsAnError) {
  Scene scene = steady_film(kTwist, {0, 1, 2});
  EXPECT_EQ(error_of(scene), "");
  scene.views[1].clock.reset();
  EXPECT_NE(error_of(scene).find("needs to know when the photos were taken"), std::string::npos);
  EXPECT_NE(error_of(scene).find("--times"), std::string::npos);
  EXPECT_NE(error_of(steady_film(kTwist, {1, 1})).find("no two of the photos"), std::string::npos);
  EXPECT_NE(error_of(steady_film({{0, 1, 0}, {}}, {0, 1, 2})).find("turned by 57 degrees"),
            std::string::npos);
}

TEST(RollingShutter, OptionsAreChecked) {
  TrainOptions options;
  const std::vector<OptionField> fields = option_fields(options);
  const OptionField& field = *std::ranges::find(fields, "rolling_shutter", &OptionField::name);
  for (const char* bad : {"nan", "inf", "-0.1", "1.6", "on", "", "0.5x"})
    EXPECT_THROW(set_option_text(field, bad, "a test"), Error) << bad;
  for (const char* good : {"auto", "0.7", "1.5", "off"}) {
    set_option_text(field, good, "a test");
    EXPECT_EQ(option_text(field), good);
  }
}

constexpr double kReadout = 0.8;

TrainOptions film_options(int64_t steps, Readout readout) {
  TrainOptions o = test::tiny_options(steps);
  o.grid_recipe.cameras.rolling_shutter = readout;
  o.grid_recipe.cameras.first_step = 64;
  o.grid_recipe.cameras.first_levels = 2;
  return o;
}

double held_out_psnr(const RadianceField& field, const test::SyntheticCapture& c,
                     ThreadPool& pool) {
  return evaluate(field, c.scene, c.photos, {}, pool).psnr;
}

// Whoever takes the rows for those of one pose shows at best what that pose sees, which is off by a
// PSNR that needs no training to know. With the rows' own poses a short training gets half a
// decibel above it, and more above one without.
TEST(RollingShutter, AFilmIsLearntByItsRows) {
  const auto c = film_capture(32, 40, kReadout);
  ThreadPool pool(2);
  double bound = 0;
  for (const int v : c.scene.test) {
    const Photo& photo = c.photos.photos[static_cast<size_t>(v)];
    const Photo one_pose = test::film_photo(c.scene.cameras[0], v, 0);
    bound += *psnr(photo_over(photo, {1, 1, 1}), photo_over(one_pose, {1, 1, 1})) /
             static_cast<double>(c.scene.test.size());
  }
  const auto train = [&](Readout readout) {
    Trainer trainer(c.scene, c.photos, film_options(400, readout), pool);
    trainer.run({});
    return held_out_psnr(trainer.snapshot(), c, pool);
  };
  const double off = train({}), on = train({false, kReadout});
  EXPECT_LT(off, bound);
  EXPECT_GT(on, bound + 0.5) << off;
}

// The slope of a parabola through three frames is less than a swing's by up to 2 percent, so that
// what is found is as much more.
constexpr double kFound = 0.06;

TEST(RollingShutter, TheTimeOfReadingIsFound) {
  const auto c = film_capture(32, 40, kReadout);
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, film_options(400, {true, 0}), pool);
  EXPECT_EQ(trainer.readouts(), std::vector<double>{0});
  trainer.run({});
  EXPECT_NEAR(trainer.readouts()[0], kReadout, kFound);
}

TEST(RollingShutter, OfLinesReadAtOnceNothingIsFound) {
  const auto c = film_capture(32, 40, 0);
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, film_options(400, {true, 0}), pool);
  trainer.run({});
  EXPECT_NEAR(trainer.readouts()[0], 0, kFound);
}

// While the cameras that are off come back as well, which make up for a part of what it does: four
// fifths are found.
TEST(RollingShutter, TheTimeOfReadingIsFoundWithTheCameras) {
  auto c = film_capture(32, 40, kReadout);
  for (size_t v = 0; v < c.scene.views.size(); ++v) {
    const double x = static_cast<double>(v);
    const Vec3d turn{std::sin(3 * x), std::sin(5 * x + 1), std::sin(7 * x + 2)};
    c.scene.views[v].pose = corrected(c.scene.views[v].pose, {turn * 0.004, {}});
  }
  TrainOptions o = film_options(400, {true, 0});
  o.grid_recipe.cameras.refine = RefineCameras::kOn;
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, o, pool);
  trainer.run({});
  EXPECT_NEAR(trainer.readouts()[0], 0.8 * kReadout, kFound);
}

TEST(RollingShutter, ModelFilesKeepWhatEvaluationAsks) {
  const auto c = film_capture(8, 24, kReadout);
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, film_options(40, {false, kReadout}), pool);
  for (int i = 0; i < 20; ++i) trainer.step();
  const test::TempFolder folder;
  const RadianceField field = trainer.snapshot();
  field.save(folder / "m");
  EXPECT_EQ(held_out_psnr(RadianceField::load(folder / "m"), c, pool),
            held_out_psnr(field, c, pool));
  for (const ModelView& view : field.info().views) {
    EXPECT_TRUE(view.motion.any());
    EXPECT_FALSE(view.camera.motion.any());  // new views read all lines at once
  }
}

TrainOptions learning_all(int64_t steps) {
  TrainOptions o = film_options(steps, {true, 0});
  o.grid_recipe.cameras.refine = RefineCameras::kOn;
  o.grid_recipe.cameras.first_step = 4;
  return o;
}

TEST(RollingShutter, IsTheSameForAnyNumberOfThreads) {
  const auto c = film_capture(8, 24, kReadout);
  const auto bits = [&](int threads) {
    ThreadPool pool(threads);
    Trainer trainer(c.scene, c.photos, learning_all(60), pool);
    for (int step = 0; step < 20; ++step) trainer.step();
    EXPECT_NE(trainer.readouts()[0], 0);
    return test::bits_of(trainer);
  };
  EXPECT_EQ(bits(1), bits(2));
}

TEST(RollingShutter, GoesOnBitForBit) {
  auto c = film_capture(8, 24, kReadout);
  const test::TempFolder folder;
  ThreadPool pool(2);
  Trainer whole(c.scene, c.photos, learning_all(60), pool);
  Trainer second(c.scene, c.photos, learning_all(60), pool);
  for (int step = 0; step < 12; ++step) whole.step();
  whole.save_checkpoint(folder / "c");
  second.load_checkpoint(folder / "c");
  EXPECT_EQ(second.readouts(), whole.readouts());
  for (int step = 0; step < 12; ++step) {
    whole.step();
    second.step();
  }
  EXPECT_EQ(test::bits_of(whole), test::bits_of(second));
  whole.restart(0, 1);
  EXPECT_EQ(whole.readouts(), std::vector<double>{0});
  c.scene.views[2].clock = 2.5;  // another film
  EXPECT_THROW(second.load_checkpoint(folder / "c"), Error);
}

}  // namespace
}  // namespace nerf
