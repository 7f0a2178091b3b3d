// What photos of sparse points show of exposures and lenses.
#include "nerf/train/shown_light.h"

#include <gtest/gtest.h>

#include <cmath>

#include "nerf/math/srgb.h"
#include "nerf/math/vignetting.h"
#include "nerf/train/light_probe.h"
#include "nerf/train/light_report.h"
#include "support/synthetic_scene.h"
#include "train/lenses.h"

namespace nerf {
namespace {

// Of photo v, stops.
double exposure_of_view(size_t v) { return 0.4 * static_cast<double>(v % 5) - 0.9 * (v % 3 == 1); }
constexpr double kCorner = 0.6;  // stops

// Photos of one grey, each of its exposure, and darker towards the corners; all of them see points
// that lie anywhere in their pictures.
test::SyntheticCapture grey_photos() {
  auto c = test::sphere_capture(20, 48);
  Scene& scene = c.scene;
  for (int i = 0; i < 300; ++i) {
    const double a = 2.4 * i, z = (i % 17 - 8) / 9.0, r = 0.9 * std::sqrt((i % 29 + 1) / 30.0);
    scene.points.push_back({{r * std::cos(a), r * std::sin(a), z}, 0.5, 15});
    for (const int v : scene.train) scene.observations.push_back({v, i});
  }
  for (size_t v = 0; v < scene.views.size(); ++v) {
    Photo& photo = c.photos.photos[v];
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x) {
        const double at = corner_square(c.photos.cameras[v], {x + 0.5, y + 0.5});
        const double light = srgb_to_linear(0.45) * std::exp2(exposure_of_view(v) - kCorner * at);
        for (size_t k = 0; k < 3; ++k)
          photo.pixels8[4 * static_cast<size_t>(y * photo.width + x) + k] =
              static_cast<uint8_t>(std::lround(255 * linear_to_srgb(light)));
      }
  }
  return c;
}

// Of 8 bits: half a step of the darkest, in stops, in the photo and in what it is compared with.
double rounding() {
  const double darkest = linear_to_srgb(srgb_to_linear(0.45) * std::exp2(-0.9 - kCorner));
  return 2 * 0.5 / 255 * 2.4 / ((darkest + 0.055) * std::log(2));
}

TEST(ShownLight, ExposuresAndFalloffAreThoseOfThePhotos) {
  const auto c = grey_photos();
  const ShownLight light = shown_light(c.scene, c.photos);
  std::vector<double> shown, truth;
  for (const int v : c.scene.train) {
    const auto& e = light.exposure[static_cast<size_t>(v)];
    ASSERT_TRUE(e.has_value()) << v;
    shown.push_back(*e);
    truth.push_back(exposure_of_view(static_cast<size_t>(v)));
  }
  for (size_t i = 1; i < shown.size(); ++i)
    EXPECT_NEAR(shown[i] - shown[0], truth[i] - truth[0], rounding()) << i;
  for (const int v : c.scene.test) EXPECT_FALSE(light.exposure[static_cast<size_t>(v)]);
  ASSERT_EQ(light.lenses.size(), 1u);
  EXPECT_EQ(light.lenses[0].photos, 15);
  EXPECT_NEAR(light.lenses[0].corner_stops.value_or(99), kCorner, rounding());
  EXPECT_LT(light.lenses[0].error, rounding());
  EXPECT_FALSE(light.exif_factor.has_value());  // it says nothing
}

TEST(ShownLight, ExifIsTrustedWhereItExplainsThePhotos) {
  auto c = grey_photos();
  for (size_t v = 0; v < c.scene.views.size(); ++v)
    c.scene.views[v].exposure = exposure_of_view(v) / 0.8 + 0.3;
  c.scene.views[1].exposure.reset();  // one does not say
  const ShownLight agrees = shown_light(c.scene, c.photos);
  EXPECT_NEAR(agrees.trusted_factor().value_or(99), 0.8, 0.02);
  EXPECT_GT(agrees.exif_explained, 0.99);
  // Exposures that took out what the light had brought, or that have nothing to do with it.
  for (size_t v = 0; v < c.scene.views.size(); ++v)
    c.scene.views[v].exposure = -exposure_of_view(v);
  EXPECT_FALSE(shown_light(c.scene, c.photos).trusted_factor().has_value());
  for (size_t v = 0; v < c.scene.views.size(); ++v)
    c.scene.views[v].exposure = std::sin(10.0 * static_cast<double>(v));
  EXPECT_FALSE(shown_light(c.scene, c.photos).trusted_factor().has_value());
  // All alike: nothing to learn from.
  for (View& view : c.scene.views) view.exposure = 0;
  EXPECT_FALSE(shown_light(c.scene, c.photos).exif_factor.has_value());
}

// Each of which sees as many points as any other.
TEST(ShownLight, AFewPhotosTellNothingOfTheirLens) {
  auto c = grey_photos();
  for (const Observation& seen : std::vector(c.scene.observations))
    for (int copy = 0; copy < 4; ++copy) c.scene.observations.push_back(seen);
  for (const size_t others : {8u, 12u}) {
    for (View& view : c.scene.views) view.lens = "one";
    for (size_t i = others; i < c.scene.train.size(); ++i)
      c.scene.views[static_cast<size_t>(c.scene.train[i])].lens = "other";
    const ShownLight light = shown_light(c.scene, c.photos);
    ASSERT_EQ(light.lenses.size(), 2u);
    for (const ShownLight::Lens& lens : light.lenses)
      EXPECT_EQ(lens.corner_stops.has_value(), lens.photos >= 8) << lens.name << lens.photos;
  }
}

TEST(ShownLight, NothingIsShownWithoutPoints) {
  const auto c = test::sphere_capture(12);
  const ShownLight light = shown_light(c.scene, c.photos);
  for (const auto& e : light.exposure) EXPECT_FALSE(e.has_value());
  ASSERT_EQ(light.lenses.size(), 1u);
  EXPECT_FALSE(light.lenses[0].corner_stops.has_value());
}

TEST(Light, ExifsExposuresAreTakenWhereTheyAreTrusted) {
  LightProbe probe;
  probe.exposure_spread = 0.4;
  probe.shown.exif_factor = 0.913;
  probe.shown.exif_explained = 0.8;
  TrainOptions trusts;
  resolve_light(probe, trusts);
  EXPECT_EQ(trusts.grid_recipe.light.exif_exposure, (AutoFactor{false, 0.91}));
  probe.shown.exif_explained = 0.3;
  TrainOptions doubts;
  resolve_light(probe, doubts);
  EXPECT_EQ(doubts.grid_recipe.light.exif_exposure, (AutoFactor{false, 0}));
  TrainOptions said;
  said.grid_recipe.light.exif_exposure = {false, 1.2};
  resolve_light(probe, said);
  EXPECT_EQ(said.grid_recipe.light.exif_exposure, (AutoFactor{false, 1.2}));
}

TEST(Lenses, AreToldApartByExifOrByTheirCameras) {
  auto c = test::sphere_capture(8, 40);
  Scene& scene = c.scene;
  const auto camera = [&](int width, int height, double focal) {
    Camera added = scene.cameras[0];
    added.width = width;
    added.height = height;
    added.params[0] = added.params[1] = focal;
    scene.cameras.push_back(added);
    return static_cast<int>(scene.cameras.size()) - 1;
  };
  const double f = scene.cameras[0].fx();
  scene.views[1].camera = camera(40, 40, 1.05 * f);  // the same, a little off
  scene.views[2].camera = camera(40, 40, 1.5 * f);
  scene.views[3].camera = camera(40, 30, f);
  scene.views[4].camera = camera(30, 40, f);  // held upright
  scene.views[5].lens = "One, 4 mm";
  scene.views[6].lens = "One, 4 mm";
  scene.views[6].camera = camera(30, 40, 3 * f);
  scene.cameras.push_back(panorama(80, 40));
  scene.views[7].camera = static_cast<int>(scene.cameras.size()) - 1;
  const Lenses lenses = lenses_of(scene);
  const std::vector<int>& of = lenses.of_view;
  EXPECT_EQ(lenses.names.size(), 4u);
  EXPECT_EQ(of[0], of[1]);
  EXPECT_NE(of[0], of[2]);
  EXPECT_EQ(of[3], of[4]);
  EXPECT_NE(of[3], of[0]);
  EXPECT_EQ(of[5], of[6]);
  EXPECT_EQ(lenses.names[static_cast<size_t>(of[5])], "One, 4 mm");
  EXPECT_LT(of[7], 0);
}

TEST(LightReport, SaysCornersInWords) {
  EXPECT_EQ(corner_text(0.42), "corners 0.4 stops darker than the middle");
  EXPECT_EQ(corner_text(-0.3), "corners 0.3 stops brighter than the middle");
  EXPECT_EQ(corner_text(0.01), "corners as bright as the middle");
  EXPECT_EQ(corner_text(0.051), "corners 0.1 stops darker than the middle");
}

}  // namespace
}  // namespace nerf
