// Layers of pictures in which objects stand, where these let light through and apart from them.
#include <gtest/gtest.h>

#include <cmath>

#include "model/analytic_field.h"
#include "model/exact_options.h"
#include "model/homogeneous_field.h"
#include "model/some_objects.h"
#include "nerf/math/srgb.h"
#include "nerf/model/insertion.h"
#include "support/cameras.h"

namespace nerf {
namespace {

using test::along_x;
using test::exact_options;
using test::middle_of;
using test::narrow;
using test::without_shadows;

constexpr double kNearScreen = -0.5, kFarScreen = 0.2;  // at these x
constexpr double kNearAlpha = 0.25, kFarAlpha = 0.5;

SceneObject two_screens() {
  SceneObject two = test::screen(static_cast<Real>(kNearScreen), kNearAlpha);
  two.materials.push_back(test::unlit({0.8, 0.1, 0.3}, kFarAlpha));
  test::add_rectangle({static_cast<Real>(kFarScreen), -3, -3}, {0, 6, 0}, {0, 0, 6}, 1, two);
  return two;
}

// The medium of density 1 between x = -1 and 1, seen from x = -3: with two screens in it the light
// is stopped by medium, screen, medium, screen and medium.
class ScreensInAMedium : public testing::Test {
 protected:
  Frame picture(const Layers& layers, int supersample = 1) {
    RenderOptions options = exact_options();
    options.layers = layers;
    options.supersample = supersample;
    const Insertion screens(field_, two_screens(), without_shadows(), options, pool_);
    return render(field_, narrow(), along_x(), options, pool_, {}, nullptr, &screens);
  }
  const RadianceField field_ = test::homogeneous_field(Similarity());
  ThreadPool pool_{2};
  static constexpr size_t kMiddle = 40;
  // Light that gets to the first screen, to the second, and past the medium.
  const double first_ = std::exp(-(kNearScreen + 1));
  const double second_ = first_ * (1 - kNearAlpha) * std::exp(-(kFarScreen - kNearScreen));
  const double past_ = second_ * (1 - kFarAlpha) * std::exp(-(1 - kFarScreen));
};

TEST_F(ScreensInAMedium, TakeTheirSharesOfTheLight) {
  for (const int supersample : {1, 2}) {
    const Frame f = picture({.apart = true}, supersample);
    const size_t p = kMiddle;
    EXPECT_NEAR(f.layers.cover[p], kNearAlpha * first_ + kFarAlpha * second_, 2e-4);
    RenderOptions options = exact_options();
    options.layers = Layers{};
    options.supersample = supersample;
    const Frame alone = render(field_, narrow(), along_x(), options, pool_);
    for (size_t i = 0; i < f.alpha.size(); ++i) {
      for (size_t k = 0; k < 3; ++k) {
        ASSERT_EQ(f.layers.field[4 * i + k], alone.layers.rgb[3 * i + k]);
        ASSERT_EQ(f.layers.shadow[3 * i + k], 1);
      }
      ASSERT_EQ(f.layers.field[4 * i + 3], alone.alpha[i]);
    }
  }
}

TEST_F(ScreensInAMedium, AreDeepSamplesAmongTheMediums) {
  const Frame f = picture({.moments = true, .percentiles = true, .deep = true});
  const PictureLayers& layers = f.layers;
  double before_first = 0, between = 0, behind = 0, mean = 0, square = 0;
  int screens = 0;
  Real last = 0;
  for (const DeepSample& s : layers.deep[kMiddle]) {
    EXPECT_GE(s.front, last - 1e-6_r);
    last = s.back;
    const double at = 0.5 * (s.front + s.back);
    mean += s.weight * at;
    square += s.weight * at * at;
    if (std::abs(s.rgb[2] - 0.5_r * s.weight) > 0.01_r * s.weight) {  // not of the medium's grey
      EXPECT_EQ(s.front, s.back);
      EXPECT_NEAR(s.front, 3 + (screens == 0 ? kNearScreen : kFarScreen), 1e-5);
      EXPECT_NEAR(s.weight, screens == 0 ? kNearAlpha * first_ : kFarAlpha * second_, 2e-4);
      EXPECT_NEAR(s.rgb[2] / s.weight, screens == 0 ? 0.9 : 0.3, 1e-3);
      ++screens;
    } else {
      (screens == 0 ? before_first : screens == 1 ? between : behind) += s.weight;
      EXPECT_NEAR(s.rgb[1], 0.5 * s.weight, 1e-4);
    }
  }
  EXPECT_EQ(screens, 2);
  EXPECT_NEAR(before_first, 1 - first_, 2e-4);
  EXPECT_NEAR(between, first_ * (1 - kNearAlpha) - second_, 2e-4);
  EXPECT_NEAR(behind, second_ * (1 - kFarAlpha) - past_, 2e-4);
  // A stretch of deep samples is taken to be in its middle, at most a sixteenth of the light each.
  const double stopped = 1 - past_;
  EXPECT_NEAR(layers.mean[kMiddle], mean / stopped, 0.01);
  EXPECT_NEAR(layers.variance[kMiddle], square / stopped - std::pow(mean / stopped, 2), 0.01);
  // 95 % of the light is stopped nowhere; the medium stops 5 % at 2 - log(0.95).
  EXPECT_EQ(layers.far[kMiddle], 0);
  EXPECT_NEAR(layers.near[kMiddle], 2 - std::log(0.95), 0.02);
}

// Half of the light is stopped by the second screen, not by the first.
TEST(InsertedLayers, TheNormalIsWhereHalfOfTheLightStops) {
  const RadianceField field =
      test::surface_field(Similarity(), [](const Vec3d& p) { return 0.6 - p.x; });
  ThreadPool pool(2);
  RenderOptions options = exact_options();
  options.layers = Layers{.normal = true};
  SceneObject object = two_screens();
  object.materials[1].alpha = 0;  // 0.75 of the light reach the wall behind both
  // The wall is square to the way; the near screen leans.
  for (size_t i = 2; i < 4; ++i) object.mesh.positions[i].x += 1.5_r;
  const Insertion screens(field, object, without_shadows(), options, pool);
  const Frame f = render(field, narrow(), along_x(), options, pool, {}, nullptr, &screens);
  const size_t p = middle_of(f);
  EXPECT_NEAR(f.layers.distance[p], 3.6, 0.01);
  EXPECT_NEAR(f.layers.normal[3 * p], -1, 0.01);
}

// The point below the middle of a disc of radius r at height h loses r^2 / (r^2 + h^2) of an even
// sky's light.
TEST(InsertedLayers, TheShadowIsWhatTheFieldIsMultipliedBy) {
  constexpr double kFloor = -0.5, kRadius = 0.2, kHeight = 0.25;
  const RadianceField field =
      test::surface_field(Similarity(), [](const Vec3d& p) { return p.z - kFloor; });
  ThreadPool pool(2);
  RenderOptions options = exact_options();
  options.layers = Layers{.apart = true};
  InsertionOptions many;
  many.shadow_rays = 400;
  const Insertion disc(field, test::black_disc(kFloor + kHeight, kRadius), many, options, pool);
  const Frame f = render(field, test::pinhole(41, 41, 800), test::from_above({0, 0, kFloor}),
                         options, pool, {}, nullptr, &disc);
  const size_t p = middle_of(f);
  // As in Insertion.CastsTheShadowOfADisc.
  EXPECT_NEAR(f.layers.shadow[3 * p],
              1 - kRadius * kRadius / (kRadius * kRadius + kHeight * kHeight), 0.04);
  EXPECT_EQ(f.layers.cover[p], 0);
  const double left = srgb_to_linear(static_cast<double>(f.layers.rgb[3 * p])) /
                      srgb_to_linear(static_cast<double>(f.layers.field[4 * p]));
  EXPECT_NEAR(f.layers.shadow[3 * p], left, 1e-4);
}

TEST(InsertedLayers, WithoutAnObjectTheFieldIsThePicture) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(2);
  RenderOptions options = exact_options();
  options.layers = Layers{.apart = true};
  const Frame f = render(field, narrow(), along_x(), options, pool);
  for (size_t i = 0; i < f.alpha.size(); ++i) {
    ASSERT_EQ(f.layers.field[4 * i + 1], f.layers.rgb[3 * i + 1]);
    ASSERT_EQ(f.layers.cover[i], 0);
    ASSERT_EQ(f.layers.shadow[3 * i + 1], 1);
  }
}

}  // namespace
}  // namespace nerf
