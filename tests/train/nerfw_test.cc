// NeRF-W: photos whose colours differ, things that one photo alone shows, and where samples lie.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "nerf/train/evaluation.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/sample_range.h"

namespace nerf {
namespace {

using test::sphere_capture;

TrainOptions nerfw_options(const std::string& method, int64_t steps) {
  TrainOptions o = test::tiny_method_options(method, steps);
  if (method == "nerfw") {
    o.network.image_code = 8;
    o.network.transient_code = 4;
  }
  return o;
}

Evaluation fitted_evaluation(const std::string& method, const test::SyntheticCapture& c,
                             int64_t steps) {
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, nerfw_options(method, steps), pool);
  trainer.run({});
  EvaluationOptions options;
  options.fit_light = FitLight::kOn;
  return evaluate(trainer.snapshot(), c.scene, c.photos, options, pool);
}

// Every photo has an exposure of each channel of its own, the held-out ones too.
TEST(Nerfw, LearnsPhotosWhoseColoursDiffer) {
  auto c = sphere_capture(24, 32);
  for (size_t v = 0; v < c.photos.photos.size(); ++v) {
    Random random(4, 0, v);
    double gain[3];
    for (double& g : gain) g = 0.4 + 0.6 * static_cast<double>(random.uniform());
    std::vector<uint8_t>& rgba = c.photos.photos[v].pixels8;
    for (size_t i = 0; i < rgba.size(); ++i)
      if (i % 4 != 3) rgba[i] = static_cast<uint8_t>(rgba[i] * gain[i % 4]);
  }
  const Evaluation nerf = fitted_evaluation("nerf", c, 800);
  const Evaluation nerfw = fitted_evaluation("nerfw", c, 800);
  RecordProperty("nerf", std::to_string(nerf.psnr));
  RecordProperty("nerfw", std::to_string(nerfw.psnr));
  EXPECT_GT(nerfw.psnr, nerf.psnr + 2);
}

// A bright square before the sphere, somewhere else in each training photo.
TEST(Nerfw, LeavesOutWhatOnePhotoAloneShows) {
  auto c = sphere_capture(24, 32);
  for (const int v : c.scene.train) {
    Photo& photo = c.photos.photos[static_cast<size_t>(v)];
    Random random(5, 0, static_cast<uint64_t>(v));
    const int left = 6 + static_cast<int>(random.below(12)),
              top = 6 + static_cast<int>(random.below(12));
    for (int y = top; y < top + 8; ++y)
      for (int x = left; x < left + 8; ++x) {
        uint8_t* const p = photo.pixels8.data() + 4 * (y * photo.width + x);
        p[0] = 255;
        p[1] = 0;
        p[2] = static_cast<uint8_t>(255 * (v % 2));
        p[3] = 255;
      }
  }
  const Evaluation nerf = fitted_evaluation("nerf", c, 800);
  const Evaluation nerfw = fitted_evaluation("nerfw", c, 800);
  RecordProperty("nerf", std::to_string(nerf.psnr));
  RecordProperty("nerfw", std::to_string(nerfw.psnr));
  EXPECT_GT(nerfw.psnr, nerf.psnr);
}

TEST(Nerfw, OpensNoStep) {
  const auto c = sphere_capture(6, 24);
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, nerfw_options("nerfw", 4), pool);
  EXPECT_TRUE(test::contains(test::error_of([&] { trainer.begin_step(); }), "no loss but its own"));
  trainer.step();  // nothing is left open
}

// A model file holds all codes.
TEST(Nerfw, IsReadFromItsFile) {
  const auto c = sphere_capture(6, 24);
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, nerfw_options("nerfw", 4), pool);
  for (int i = 0; i < 4; ++i) trainer.step();
  const test::TempFolder folder;
  const RadianceField field = trainer.snapshot();
  field.save(folder / "m");
  const RadianceField again = RadianceField::load(folder / "m");
  EXPECT_EQ(again.field().codes().transient.in, 4);
  ASSERT_EQ(again.field().all_weights().size(), field.field().all_weights().size());
  for (size_t i = 0; i < field.field().all_weights().size(); ++i)
    ASSERT_EQ(static_cast<float>(again.field().all_weights()[i]),
              static_cast<float>(field.field().all_weights()[i]));
}

// A thousandth of the points at either end is left out; a photo that sees few has the scene's
// range.
TEST(Nerfw, SamplesEachPhotoWhereItsPointsLie) {
  auto c = sphere_capture(6, 24);
  c.scene.near = 0.5;
  c.scene.far = 9;
  const int first = c.scene.train.at(0), second = c.scene.train.at(1);
  const Pose& pose = c.scene.views[static_cast<size_t>(first)].pose;
  for (int i = 0; i < 2001; ++i) {
    const double away = i == 0 ? 0.01 : i == 2000 ? 100 : 2 + 0.001 * i;
    c.scene.points.push_back({pose.translation + pose.rotation.column(2) * away, 0.5, 3});
    c.scene.observations.push_back({first, i});
  }
  c.scene.observations.push_back({second, 0});
  TrainOptions o = nerfw_options("nerfw", 4);
  const auto ranges = ranges_of_views(c.scene, o);
  const double scale = c.scene.to_engine.scale;
  EXPECT_NEAR(ranges[static_cast<size_t>(first)].near, 2.002 * scale, 1e-6);
  EXPECT_NEAR(ranges[static_cast<size_t>(first)].far, 3.998 * scale, 1e-6);
  EXPECT_EQ(ranges[static_cast<size_t>(second)].near, range_of(c.scene, o).near);
  const SampleRange all = range_of_field(c.scene, o, ranges);
  EXPECT_LE(all.near, ranges[static_cast<size_t>(first)].near);
  EXPECT_GE(all.far, ranges[static_cast<size_t>(first)].far);
  o.recipe.far = 3;  // said of all
  EXPECT_EQ(ranges_of_views(c.scene, o)[static_cast<size_t>(first)].far, 3);
  o.recipe.photo_range = false;
  EXPECT_TRUE(ranges_of_views(c.scene, o).empty());
}

}  // namespace
}  // namespace nerf
