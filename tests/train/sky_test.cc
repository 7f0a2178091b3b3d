// A sphere before a sky whose colours are known.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "nerf/model/renderer.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/light_probe.h"
#include "nerf/train/methods.h"
#include "nerf/train/trainer.h"
#include "support/repeatable.h"
#include "support/tiny_options.h"
#include "train/skyline.h"

namespace nerf {
namespace {

Vec3d sky_towards(const Vec3d& d) { return {0.5 + 0.3 * d.z, 0.5 + 0.2 * d.x, 0.6 - 0.3 * d.y}; }

test::SyntheticCapture capture_before_sky(int views = 24) {
  test::SyntheticCapture c = test::sphere_capture(views);
  c.scene.alpha = false;
  c.scene.unbounded = true;
  c.scene.near = 2;
  // From below, since no sky is learnt below the horizon.
  for (int v = 0; v < views; ++v)
    c.scene.views[static_cast<size_t>(v)].pose = test::spiral_pose(v, 2 * views);
  test::add_sphere_points(c.scene);
  for (size_t v = 0; v < c.scene.views.size(); ++v)
    c.photos.photos[v] = test::photo_of(c.scene.cameras[0], c.scene.views[v].pose, 3,
                                        [&](const Vec3d& origin, const Vec3d& d, double rgb[3]) {
                                          if (!test::sphere_colour(origin, d, rgb))
                                            for (int k = 0; k < 3; ++k) rgb[k] = sky_towards(d)[k];
                                          return true;
                                        });
  return c;
}

TrainOptions options_with(Switch sky, int64_t steps) {
  TrainOptions o = test::tiny_options(steps);
  o.grid_recipe.light.sky = sky;
  // The sphere stands out from this sky less than things do from a real one.
  o.grid_recipe.light.sky_clearing = 0.01;
  return o;
}

// Of held-out pictures without the sky: mean opacity beside the sphere and on it.
struct Opacity {
  double beside = 0, sphere = 0;
};
Opacity opacity_of(const RadianceField& field, const test::SyntheticCapture& c, ThreadPool& pool) {
  RenderOptions options;
  options.sky = false;
  Opacity mean;
  double beside = 0, sphere = 0;
  for (const int v : c.scene.test) {
    const View& view = c.scene.views[static_cast<size_t>(v)];
    const Photo shape = test::sphere_photo(c.scene.cameras[0], view.pose);
    const Frame frame = render(field, c.scene.cameras[0], view.pose, options, pool);
    for (size_t p = 0; p < frame.alpha.size(); ++p) {
      const uint8_t covered = shape.pixels8[4 * p + 3];
      if (covered == 0) mean.beside += frame.alpha[p], ++beside;
      if (covered == 255) mean.sphere += frame.alpha[p], ++sphere;
    }
  }
  return {mean.beside / beside, mean.sphere / sphere};
}

TEST(Sky, IsLearntAndLeavesNoMatterBeforeIt) {
  const auto c = capture_before_sky();
  ThreadPool pool(2);
  const RadianceField with = test::trained(c, options_with(Switch::kOn, 400), pool);
  const Opacity opacity = opacity_of(with, c, pool);
  EXPECT_LT(opacity.beside, 0.05);
  EXPECT_GT(opacity.sphere, 0.95);
  EXPECT_GT(evaluate(with, c.scene, c.photos, {}, pool).psnr, 26) << "of held-out photos";
  const RadianceField without = test::trained(c, options_with(Switch::kOff, 400), pool);
  EXPECT_GT(opacity_of(without, c, pool).beside, 0.5);
}

// Points right above each camera, as far away as the sphere, leave no photo anything above them:
// what is beside the sphere may be matter, but not much farther away.
TEST(Sky, LeavesNoMatterFarBehindAllPoints) {
  auto c = capture_before_sky();
  constexpr int kPoints = 300;
  const double away = test::kCameraDistance;
  for (const int v : c.scene.train)
    for (int i = 0; i < kPoints; ++i) {
      const double turn = 2 * std::numbers::pi * i / kPoints;
      const Vec3d up = normalized(Vec3d{0.02 * std::cos(turn), 0.02 * std::sin(turn), 1});
      c.scene.observations.push_back({v, static_cast<int32_t>(c.scene.points.size())});
      c.scene.points.push_back(
          {c.scene.views[static_cast<size_t>(v)].pose.translation + up * away, 0.5, 2});
    }
  ThreadPool pool(2);
  const auto share_behind = [&](double clearing) {
    TrainOptions options = options_with(Switch::kOn, 300);
    options.grid_recipe.light.sky_clearing = clearing;
    const RadianceField field = test::trained(c, options, pool);
    RenderOptions matter;
    matter.sky = false;
    double behind = 0, all = 0;
    for (const int v : c.scene.test) {
      const Frame frame = render(field, c.scene.cameras[0],
                                 c.scene.views[static_cast<size_t>(v)].pose, matter, pool);
      for (const Real depth : frame.depth_z) behind += depth > 1.4 * away, ++all;
    }
    return behind / all;
  };
  const double without = share_behind(0);
  EXPECT_GT(without, 0.05);
  EXPECT_LT(share_behind(0.01), 0.3 * without);
}

TEST(Sky, LeavesTheOpacityOfMatterInReports) {
  auto c = capture_before_sky(8);
  c.scene.near = 100;  // nothing is that far
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, options_with(Switch::kOn, 8), pool);
  trainer.step();
  EXPECT_EQ(trainer.step().opacity, 0);
}

TEST(Sky, IsSeenInPlaceOfTheBackground) {
  const auto c = capture_before_sky();
  ThreadPool pool(2);
  const RadianceField field = test::trained(c, options_with(Switch::kOn, 400), pool);
  const Camera& camera = c.scene.cameras[0];
  const Pose& pose = c.scene.views[0].pose;
  RenderOptions shown, red, without;
  red.background = {1, 0, 0};
  without.background = {1, 0, 0};
  without.sky = false;
  const Frame a = render(field, camera, pose, shown, pool);
  const Frame b = render(field, camera, pose, without, pool);
  EXPECT_EQ(a.rgb, render(field, camera, pose, red, pool).rgb);
  for (size_t p = 0; p < a.alpha.size(); ++p) ASSERT_EQ(a.alpha[p], 1);
  // A corner shows the sky alone, to within what 400 steps leave.
  const Vec3d d = normalized(pose.rotation * *unproject(camera, {0.5, 0.5}));
  for (int k = 0; k < 3; ++k)
    EXPECT_NEAR(a.rgb[static_cast<size_t>(k)], sky_towards(d)[k], 0.1) << k;
  EXPECT_GT(b.rgb[0], 0.9);
  EXPECT_LT(b.rgb[1], 0.1);
  // What a box cuts out has none.
  RenderOptions boxed = without;
  boxed.sky = true;
  boxed.bbox = Box3{{-1, -1, -1}, {1, 1, 1}};
  EXPECT_LT(render(field, camera, pose, boxed, pool).alpha[0], 0.1);
}

TEST(Sky, IsInModelFiles) {
  const auto c = capture_before_sky(8);
  ThreadPool pool(2);
  const RadianceField field = test::trained(c, options_with(Switch::kOn, 20), pool);
  const test::TempFolder folder;
  field.save(folder / "model");
  const RadianceField loaded = RadianceField::load(folder / "model");
  ASSERT_TRUE(loaded.grid().has_sky());
  const auto picture = [&](const RadianceField& f) {
    return render(f, c.scene.cameras[0], c.scene.views[0].pose, {}, pool).rgb;
  };
  EXPECT_EQ(picture(loaded), picture(field));
}

TEST(Sky, ThreadsAndInterruptionsChangeNothing) {
  TrainOptions options = options_with(Switch::kOn, 24);
  options.grid_recipe.light.appearance = {false, 4};
  test::expect_repeatable(capture_before_sky(8), options);
}

// Two photos from each place, the second half as bright: a direction cannot tell them apart.
TEST(Sky, DependsOnThePhotosAppearance) {
  auto c = capture_before_sky();
  c.scene.train.clear();
  for (size_t v = 0; v + 1 < c.scene.views.size(); v += 2) {
    c.scene.views[v + 1].pose = c.scene.views[v].pose;
    c.photos.photos[v + 1] = c.photos.photos[v];
    for (uint8_t& x : c.photos.photos[v + 1].pixels8) x /= 2;
    for (size_t i = 3; i < c.photos.photos[v + 1].pixels8.size(); i += 4)
      c.photos.photos[v + 1].pixels8[i] = 255;
    for (const size_t i : {v, v + 1}) c.scene.train.push_back(static_cast<int>(i));
  }
  c.scene.test.clear();
  c.scene.observations.clear();
  TrainOptions options = options_with(Switch::kOn, 300);
  options.grid_recipe.light.appearance = {false, 4};
  ThreadPool pool(2);
  const RadianceField field = test::trained(c, options, pool);
  const GridField& grid = field.grid();
  const auto corner = [&](int photo) {
    RenderOptions o;
    o.appearance.code = appearance_of(grid.books, grid.all_weights(), photo).code;
    return render(field, c.scene.cameras[0], c.scene.views[0].pose, o, pool).rgb[1];
  };
  EXPECT_NEAR(corner(1), 0.5_r * corner(0), 0.05_r);
}

TEST(Sky, IsLearntWhereDaysDifferAndPhotosShowIt) {
  const auto chosen = [](double stops, double above_points) {
    LightProbe probe;
    probe.exposure_spread = stops;
    probe.above_points = above_points;
    TrainOptions options;
    resolve_light(probe, options);
    return options.grid_recipe.light.sky;
  };
  EXPECT_EQ(chosen(1, 0.5), Switch::kOn);
  EXPECT_EQ(chosen(1, 0.1), Switch::kOff);
  EXPECT_EQ(chosen(0.1, 0.5), Switch::kOff);
}

// A camera that looks at points around it.
class SkylineTest : public ::testing::Test {
 protected:
  static constexpr int kSize = 64;
  static constexpr double kHorizon = -0.15, kMargin = 0.02;  // sines, see skyline.cc

  void SetUp() override {
    View view;
    view.name = "a";
    c_.scene.views = {view};
    c_.scene.train = {0};
    c_.scene.cameras = {test::sphere_camera(kSize)};
    c_.photos.cameras = c_.scene.cameras;
    Photo photo;
    photo.width = photo.height = kSize;
    photo.pixels8.assign(size_t{3} * kSize * kSize, 120);
    c_.photos.photos = {photo};
  }
  static Vec3d direction(double azimuth, double height) {
    const double across = std::sqrt(1 - height * height);
    return {std::cos(azimuth) * across, std::sin(azimuth) * across, height};
  }
  void add_point(double azimuth, double height, double distance = 7, int views = 2) {
    c_.scene.observations.push_back({0, static_cast<int32_t>(c_.scene.points.size())});
    c_.scene.points.push_back({direction(azimuth, height) * distance, 0.5, views});
  }
  std::optional<SampleRange> matter(double azimuth, double height, size_t photo = 0) const {
    return Skylines(c_.scene).matter(photo, direction(azimuth, height));
  }
  static constexpr double kNoEnd = std::numeric_limits<double>::infinity();
  test::SyntheticCapture c_;
};

TEST_F(SkylineTest, IsTheHorizonWhereNoPointIsHigher) {
  for (int i = 0; i < 20; ++i) add_point(1, -0.5);
  ASSERT_TRUE(matter(1, -0.3));
  EXPECT_EQ(matter(1, -0.3)->far, kNoEnd);
  EXPECT_FALSE(matter(1, kHorizon + kMargin + 0.01));
}

TEST_F(SkylineTest, IsNotKnownOfAFewPoints) {
  for (int i = 0; i < 19; ++i) add_point(1, 0.3);
  EXPECT_EQ(share_above_points(c_.scene, c_.photos), std::nullopt);
  for (const double height : {-0.5, 0.5}) {
    ASSERT_TRUE(matter(1, height));
    EXPECT_EQ(matter(1, height)->near, 0);
    EXPECT_EQ(matter(1, height)->far, kNoEnd);
  }
}

TEST_F(SkylineTest, IsTheSecondHighestPointWithinAFewDegrees) {
  for (int i = 0; i < 20; ++i) add_point(3, -0.5);
  add_point(1, 0.5);
  add_point(1.01, 0.4);
  add_point(1, 0.2);
  EXPECT_TRUE(matter(1, 0.4 + kMargin - 0.01));
  EXPECT_FALSE(matter(1, 0.4 + kMargin + 0.01)) << "one point may be wrong";
  EXPECT_TRUE(matter(1.02, 0.3));
  EXPECT_FALSE(matter(1.1, 0.1));
  for (int i = 0; i < 2; ++i) add_point(-1, 0.5, 7, 1);
  EXPECT_FALSE(matter(-1, 0.1)) << "no two photos agree";
}

TEST_F(SkylineTest, HasMatterWhereThePhotosPointsAre) {
  for (int i = 0; i <= 100; ++i) add_point(1, 0.3, i < 2 ? 0.1 : i > 98 ? 90 : 5 + 0.01 * i);
  ASSERT_TRUE(matter(1, 0.2));
  EXPECT_NEAR(matter(1, 0.2)->near, 0.9 * 5.02, 1e-9) << "but for two, which may be wrong";
  EXPECT_NEAR(matter(1, 0.2)->far, 1.25 * 5.98, 1e-9);
  EXPECT_EQ(matter(1, -0.3)->far, kNoEnd) << "below the horizon";
  c_.scene.to_engine.scale = 0.5;
  EXPECT_NEAR(matter(1, 0.2)->far, 0.5 * 1.25 * 5.98, 1e-9) << "engine units";
}

TEST_F(SkylineTest, IsThatOfThePhotoAtEveryScale) {
  for (int i = 0; i < 20; ++i) add_point(1, 0.5);
  c_.scene.views[0].image_path = "a.png";
  c_.scene.views.push_back(c_.scene.views[0]);
  c_.scene.views[1].name = "scale2/a";
  c_.scene.train.push_back(1);
  EXPECT_TRUE(matter(1, 0.3, 1));
}

// The camera looks along the level, +y, from where photos see no sky below the skyline.
TEST_F(SkylineTest, LeavesAShareOfPhotos) {
  c_.scene.views[0].pose.rotation.m = {{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}};
  EXPECT_EQ(share_above_points(c_.scene, c_.photos), std::nullopt) << "nothing is known";
  for (int i = 0; i < 30; ++i) add_point(std::numbers::pi / 2, -0.5);
  // Of the picture's middle row up to the horizon; a little more of its sides.
  const double f = c_.scene.cameras[0].params[0];
  const double below = f * std::tan(std::asin(-kHorizon - kMargin)) / kSize;
  EXPECT_NEAR(*share_above_points(c_.scene, c_.photos), 0.5 + below, 0.04);
  c_.photos.photos[0].mask.assign(size_t{kSize} * kSize, 255);
  std::fill_n(c_.photos.photos[0].mask.begin(), kSize * kSize / 4, uint8_t{0});
  EXPECT_NEAR(*share_above_points(c_.scene, c_.photos), 0.25 + below, 0.04);
}

TEST(Sky, IsNotLearntBehindTransparentPhotosOrInAMedium) {
  Scene scene;
  TrainOptions options = options_with(Switch::kOn, 1);
  EXPECT_TRUE(learns_sky(options, scene));
  EXPECT_TRUE(unused_options(options, {"sky", "sky_clearing"}, scene).empty());
  options.grid_recipe.light.sky = Switch::kAuto;
  EXPECT_TRUE(unused_options(options, {"sky_clearing"}, scene).empty()) << "not known yet";
  options.grid_recipe.light.sky = Switch::kOn;
  scene.alpha = true;
  EXPECT_FALSE(learns_sky(options, scene));
  EXPECT_EQ(unused_options(options, {"sky", "sky_clearing"}, scene).size(), 2u);
  scene.alpha = false;
  options.grid_recipe.medium.medium = LearntMedium::kFog;
  EXPECT_FALSE(learns_sky(options, scene));
}

}  // namespace
}  // namespace nerf
