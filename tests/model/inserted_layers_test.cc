// Layers of pictures in which objects stand, where these let light through and apart from them.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "model/analytic_field.h"
#include "model/exact_options.h"
#include "model/homogeneous_field.h"
#include "nerf/math/srgb.h"
#include "nerf/model/insertion.h"
#include "support/cameras.h"

namespace nerf {
namespace {

using test::exact_options;

constexpr double kNearScreen = -0.5, kFarScreen = 0.2;  // at these x
constexpr double kNearAlpha = 0.25, kFarAlpha = 0.5;

// Two screens across x, unlit.
SceneObject two_screens() {
  SceneObject object;
  for (const bool far : {false, true}) {
    Material m;
    m.base = far ? Vec3d{0.8, 0.1, 0.3} : Vec3d{0.2, 0.4, 0.9};
    m.alpha = far ? kFarAlpha : kNearAlpha;
    m.alpha_mode = AlphaMode::kBlend;
    m.double_sided = m.unlit = true;
    object.materials.push_back(m);
    const Real x = static_cast<Real>(far ? kFarScreen : kNearScreen);
    const auto first = static_cast<uint32_t>(object.mesh.positions.size());
    for (const Vec3& p : {Vec3{x, -3, -3}, Vec3{x, 3, -3}, Vec3{x, 3, 3}, Vec3{x, -3, 3}})
      object.mesh.positions.push_back(p);
    object.mesh.triangles.push_back({first, first + 1, first + 2});
    object.mesh.triangles.push_back({first, first + 2, first + 3});
    object.material.insert(object.material.end(), 2, far ? 1 : 0);
  }
  return object;
}

// Black, at height z.
SceneObject disc_at(Real z, double radius) {
  SceneObject object;
  Material black;
  black.base = {0, 0, 0};
  black.double_sided = true;
  object.materials = {black};
  object.mesh.positions.push_back({0, 0, z});
  constexpr uint32_t kSides = 64;
  for (uint32_t i = 0; i < kSides; ++i) {
    const double a = 2 * std::numbers::pi * i / kSides;
    object.mesh.positions.push_back(
        {static_cast<Real>(radius * std::cos(a)), static_cast<Real>(radius * std::sin(a)), z});
    object.mesh.triangles.push_back({0, 1 + i, 1 + (i + 1) % kSides});
    object.material.push_back(0);
  }
  return object;
}

// From `from`, in the direction of `forward` (in the plane of x and z), z up.
Pose looking(const Vec3d& from, const Vec3d& forward) {
  Pose pose;
  pose.rotation.set_column(0, {0, -1, 0});
  pose.rotation.set_column(1, cross(forward, Vec3d{0, -1, 0}));
  pose.rotation.set_column(2, forward);
  pose.translation = from;
  return pose;
}

// The medium of density 1 between x = -1 and 1, seen from x = -3: with two screens in it the light
// is stopped by medium, screen, medium, screen and medium.
class ScreensInAMedium : public testing::Test {
 protected:
  Frame picture(const Layers& layers, int supersample = 1) {
    RenderOptions options = exact_options();
    options.layers = layers;
    options.supersample = supersample;
    InsertionOptions insertion;
    insertion.shadows = false;
    const Insertion screens(field_, two_screens(), insertion, options, pool_);
    return render(field_, test::pinhole(9, 9, 200), looking({-3, 0, 0}, {1, 0, 0}), options, pool_,
                  {}, nullptr, &screens);
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
    const Frame alone =
        render(field_, test::pinhole(9, 9, 200), looking({-3, 0, 0}, {1, 0, 0}), options, pool_);
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
      EXPECT_NEAR(s.rgb[2] / s.weight, linear_to_srgb(screens == 0 ? 0.9 : 0.3), 1e-3);
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
  InsertionOptions insertion;
  insertion.shadows = false;
  const Insertion screens(field, object, insertion, options, pool);
  const Frame f = render(field, test::pinhole(9, 9, 200), looking({-3, 0, 0}, {1, 0, 0}), options,
                         pool, {}, nullptr, &screens);
  EXPECT_NEAR(f.layers.distance[40], 3.6, 0.01);
  EXPECT_NEAR(f.layers.normal[3 * 40], -1, 0.01);
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
  const Insertion disc(field, disc_at(static_cast<Real>(kFloor + kHeight), kRadius), many, options,
                       pool);
  const Vec3d forward = normalized(Vec3d{1, 0, -0.4});
  const Frame f = render(field, test::pinhole(41, 41, 800),
                         looking(Vec3d{0, 0, kFloor} - forward * 2.0, forward), options, pool, {},
                         nullptr, &disc);
  const size_t p = f.alpha.size() / 2;
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
  const Frame f =
      render(field, test::pinhole(9, 9, 200), looking({-3, 0, 0}, {1, 0, 0}), options, pool);
  for (size_t i = 0; i < f.alpha.size(); ++i) {
    ASSERT_EQ(f.layers.field[4 * i + 1], f.layers.rgb[3 * i + 1]);
    ASSERT_EQ(f.layers.cover[i], 0);
    ASSERT_EQ(f.layers.shadow[3 * i + 1], 1);
  }
}

}  // namespace
}  // namespace nerf
