// Photos of a sphere through a lens that darkens them towards their corners, each of an exposure
// that its EXIF says.
#include <gtest/gtest.h>

#include <cmath>

#include "nerf/model/field.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/light_report.h"
#include "nerf/train/trainer.h"
#include "support/repeatable.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"
#include "train/lens_picture.h"

namespace nerf {
namespace {

constexpr Falloff kTruth{-0.25, -0.1, 0.02};  // 0.58 stops in the corners

// Stops of view v.
double exposure_of(size_t v) { return 0.25 * static_cast<double>(v % 4) - 0.375; }

// Cameras of one place look past the sphere's middle by different angles: how a point looks in
// their photos depends on the lens alone, not on the direction that it is seen from.
test::SyntheticCapture through_a_lens(bool exposed, int views = 32, int size = 32) {
  auto c = test::sphere_capture(views, size);
  for (int i = 0; i < views; ++i) {
    const size_t v = static_cast<size_t>(i);
    Pose pose = test::spiral_pose(i / 4, views / 4);
    const double turn = (i % 2 ? 0.15 : -0.15), nod = (i % 4 < 2 ? 0.15 : -0.15);
    const Vec3d forward = normalized(pose.rotation * Vec3d{turn, nod, 1});
    const Vec3d right = normalized(cross(forward, Vec3d{0, 0, 1}));
    pose.rotation.set_column(0, right);
    pose.rotation.set_column(1, cross(forward, right));
    pose.rotation.set_column(2, forward);
    c.scene.views[v].pose = pose;
    Photo& photo = c.photos.photos[v];
    photo = test::sphere_photo(c.photos.cameras[v], pose);
    if (exposed) c.scene.views[v].exposure = exposure_of(v);
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x) {
        const double at = corner_square(c.photos.cameras[v], {x + 0.5, y + 0.5});
        double rgb[3];
        const size_t first = 4 * static_cast<size_t>(y * photo.width + x);
        for (size_t k = 0; k < 3; ++k) rgb[k] = photo.pixels8[first + k] / 255.0;
        const double gain = falloff_gain(kTruth, at) * (exposed ? std::exp2(exposure_of(v)) : 1);
        dim(rgb, 1.0, {}, gain);
        for (size_t k = 0; k < 3; ++k)
          photo.pixels8[first + k] =
              static_cast<uint8_t>(std::lround(255 * std::clamp(rgb[k], 0.0, 1.0)));
      }
  }
  return c;
}

TrainOptions learning(int64_t steps, Switch vignetting = Switch::kOn) {
  TrainOptions o = test::tiny_options(steps);
  o.grid_recipe.light.appearance = {false, 0};
  o.grid_recipe.light.colour_correction = Switch::kOff;
  o.grid_recipe.light.vignetting = vignetting;
  o.grid_recipe.light.vignetting_rate = 0.5;
  o.grid_recipe.light.vignetting_decay = 0;  // of a prior that would leave some of it
  return o;
}

TEST(Vignetting, IsLearntAndLeftOutOfPictures) {
  const auto c = through_a_lens(false);
  ThreadPool pool(2);
  const RadianceField with = test::trained(c, learning(400), pool);
  const RadianceField without = test::trained(c, learning(400, Switch::kOff), pool);
  const LightReport report = light_report(with, c.scene, c.photos);
  ASSERT_EQ(report.lenses.size(), 1u);
  EXPECT_EQ(report.lenses[0].photos, 24);
  RecordProperty("corner_stops", std::to_string(report.lenses[0].corner_stops));
  // To half a tenth of a stop, which is what words say, as far out as the sphere is seen.
  const Falloff learnt =
      falloff_of(with.field().codes(), with.field().all_weights(), report.lenses[0].name);
  for (const double at : {0.0, 0.25, 0.5, 0.75})
    EXPECT_NEAR(std::log2(falloff_gain(learnt, at)), std::log2(falloff_gain(kTruth, at)), 0.05)
        << at;
  EXPECT_TRUE(light_report(without, c.scene, c.photos).lenses.empty());
  // Held-out photos are compared through their lens.
  const double seen = evaluate(with, c.scene, c.photos, {}, pool).psnr;
  const double plain = evaluate(without, c.scene, c.photos, {}, pool).psnr;
  RecordProperty("with", std::to_string(seen));
  RecordProperty("without", std::to_string(plain));
  EXPECT_GT(seen, plain + 1);
  // A picture is what is there.
  const size_t v = static_cast<size_t>(c.scene.test[1]);
  const Photo there = test::sphere_photo(c.photos.cameras[v], c.scene.views[v].pose);
  const auto error = [&](const RadianceField& model) {
    RenderOptions black;
    black.background = {};
    const Frame frame = render(model, c.photos.cameras[v], c.scene.views[v].pose, black, pool);
    double sum = 0;
    for (size_t i = 0; i < frame.alpha.size(); ++i)
      for (size_t k = 0; k < 3; ++k)
        sum += std::pow(static_cast<double>(frame.rgb[3 * i + k]) -
                            there.pixels8[4 * i + k] * there.pixels8[4 * i + 3] / 255.0 / 255.0,
                        2);
    return sum;
  };
  RecordProperty("error", std::to_string(error(with)));
  RecordProperty("error_without", std::to_string(error(without)));
  EXPECT_LT(error(with), 0.85 * error(without));
}

TEST(Vignetting, AndExposuresFromExifAreFoundTogether) {
  const auto c = through_a_lens(true);
  ThreadPool pool(2);
  TrainOptions options = learning(400);
  options.grid_recipe.light.colour_correction = Switch::kOn;
  options.grid_recipe.light.exif_exposure = {false, 1};
  const auto exposures = [&](const RadianceField& model, double corner) {
    const LightReport report = light_report(model, c.scene, c.photos);
    EXPECT_NEAR(report.lenses.at(0).corner_stops, corner, 0.06);
    std::vector<double> off;
    for (const auto& photo : report.photos) off.push_back(*photo.learnt - *photo.exif);
    return off;
  };
  // It begins with what EXIF says, of which floats leave this much.
  const RadianceField first = Trainer(c.scene, c.photos, options, pool).snapshot();
  for (const double off : exposures(first, 0)) EXPECT_NEAR(off, exposures(first, 0).front(), 1e-5);
  // And stays there, since the photos show the same.
  std::vector<double> off = exposures(trained(c, options, pool), corner_stops(kTruth));
  for (const double x : off) EXPECT_NEAR(x, off.front(), 0.1);
  // Photos that do not say begin without a change.
  auto silent = c;
  for (View& view : silent.scene.views) view.exposure.reset();
  const RadianceField none = Trainer(silent.scene, silent.photos, options, pool).snapshot();
  for (int p = 0; p < none.field().codes().rows(); ++p)
    EXPECT_EQ(exposure_of_change(
                  appearance_of(none.field().codes(), none.field().all_weights(), p).colours),
              0);
}

// Decay draws a correction to what EXIF says, and a falloff to none.
TEST(Vignetting, ThePriorIsExifsExposureAndNoFalloff) {
  auto c = through_a_lens(false, 8);
  for (size_t v = 0; v < c.scene.views.size(); ++v) c.scene.views[v].exposure = exposure_of(v);
  ThreadPool pool(2);
  TrainOptions options = learning(20);
  LightRecipe& light = options.grid_recipe.light;
  light.colour_correction = Switch::kOn;
  light.exif_exposure = {false, 0.7};
  light.colour_decay = light.vignetting_decay = 100;
  light.colour_rate = light.vignetting_rate = 1;
  options.rate = 0.01;
  const LightReport report = light_report(trained(c, options, pool), c.scene, c.photos);
  EXPECT_NEAR(report.lenses.at(0).corner_stops, 0, 0.05);
  const auto& first = report.photos.front();
  for (const auto& photo : report.photos)
    EXPECT_NEAR(*photo.learnt - *first.learnt, 0.7 * (*photo.exif - *first.exif), 0.08);
}

TEST(Vignetting, GoesOnBitForBitForAnyNumberOfThreads) {
  const auto c = through_a_lens(true, 8);
  TrainOptions options = learning(30);
  options.grid_recipe.light.colour_correction = Switch::kOn;
  options.grid_recipe.light.exif_exposure = {false, 0.8};
  test::expect_repeatable(c, options);
}

// EXIF alone changes nothing, neither does a lens that nobody has decided to learn.
TEST(Vignetting, IsNowhereUnlessItIsSwitchedOn) {
  auto c = through_a_lens(true, 8);
  ThreadPool pool(2);
  const auto weights = [&](const TrainOptions& options) {
    const RadianceField model = test::trained(c, options, pool);
    const auto all = model.field().all_weights();
    return std::vector<Real>(all.begin(), all.end());
  };
  TrainOptions open = learning(5, Switch::kAuto);
  open.grid_recipe.light.exif_exposure = {false, 1};
  const auto off = weights(learning(5, Switch::kOff));
  EXPECT_EQ(off, weights(open));
  for (View& view : c.scene.views) view.exposure.reset();
  EXPECT_EQ(off, weights(learning(5, Switch::kOff)));
  EXPECT_GT(weights(learning(5)).size(), off.size());
}

TEST(Vignetting, PhotosWithoutFalloffGetItBack) {
  const auto c = through_a_lens(false, 8);
  const Camera& camera = c.photos.cameras[0];
  const Photo clear = without_falloff(c.photos.photos[0], camera, kTruth);
  Frame frame;
  frame.width = camera.width;
  frame.height = camera.height;
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      Real rgba[4];
      clear.pixel(x, y, rgba);
      frame.rgb.insert(frame.rgb.end(), rgba, rgba + 3);
      frame.alpha.push_back(1);
    }
  add_falloff(camera, kTruth, {}, frame);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      Real rgba[4];
      c.photos.photos[0].pixel(x, y, rgba);
      for (size_t k = 0; k < 3; ++k)  // a half float's step
        EXPECT_NEAR(
            static_cast<double>(frame.rgb[3 * static_cast<size_t>(y * camera.width + x) + k]),
            static_cast<double>(rgba[k]), 1e-3);
    }
}

}  // namespace
}  // namespace nerf
