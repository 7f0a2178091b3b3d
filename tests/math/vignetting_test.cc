#include "nerf/math/vignetting.h"

#include <gtest/gtest.h>

namespace nerf {
namespace {

Camera some_camera() {
  Camera camera;
  camera.width = 400;
  camera.height = 300;
  camera.params = {300, 300, 200, 150};
  return camera;
}

TEST(Vignetting, IsMeasuredFromThePrincipalPointToACorner) {
  Camera camera = some_camera();
  EXPECT_EQ(corner_square(camera, {200, 150}), 0);
  for (const Vec2d corner : {Vec2d{0, 0}, Vec2d{400, 0}, Vec2d{0, 300}, Vec2d{400, 300}})
    EXPECT_DOUBLE_EQ(corner_square(camera, corner), 1);
  EXPECT_DOUBLE_EQ(corner_square(camera, {325, 150}), 0.25);
  camera.params[2] = 210;
  EXPECT_EQ(corner_square(camera, {210, 150}), 0);
  // The same place at half the size.
  EXPECT_DOUBLE_EQ(corner_square(camera.scaled_to(200, 150), {50, 40}),
                   corner_square(camera, {100, 80}));
  EXPECT_EQ(corner_square(panorama(400, 200), {0, 0}), 0);
  EXPECT_EQ(corner_square(Camera{}, {0, 0}), 0);
}

TEST(Vignetting, IsAnEvenPolynomialOfLinearLight) {
  const Falloff abc{-0.3, 0.1, -0.05};
  EXPECT_DOUBLE_EQ(falloff_gain(abc, 0.0), 1);
  EXPECT_DOUBLE_EQ(falloff_gain(abc, 0.5), 1 - 0.15 + 0.025 - 0.00625);
  EXPECT_NEAR(corner_stops(abc), -std::log2(0.75), 1e-12);
  EXPECT_DOUBLE_EQ(corner_stops({-1, 0, 0}), 10);  // black, and beyond
  EXPECT_DOUBLE_EQ(corner_stops({-2, 0, 0}), 10);
  EXPECT_DOUBLE_EQ(corner_stops({1, 0, 0}), -1);
}

// Half of the light of sRGB's 0.735357 (0.5 linear) is that of 0.537099 (0.25).
TEST(Vignetting, DimsWhatStandsBeforeTheBackground) {
  double opaque[3] = {0.735357, 0, 1};
  dim(opaque, 1.0, {}, 0.5);
  EXPECT_NEAR(opaque[0], 0.537099, 1e-6);
  EXPECT_EQ(opaque[1], 0);
  EXPECT_NEAR(opaque[2], 0.735357, 1e-6);
  // A quarter of the pixel, over white and black.
  for (const double behind : {0.0, 1.0}) {
    double part[3];
    for (double& c : part) c = 0.25 * 0.735357 + 0.75 * behind;
    const Real b = static_cast<Real>(behind);
    dim(part, 0.25, {b, b, b}, 0.5);
    EXPECT_NEAR(part[0], 0.25 * 0.537099 + 0.75 * behind, 1e-6);
  }
  double same[3] = {0.3, 0.02, 1.2};
  dim(same, 1.0, {}, 1.0);
  EXPECT_NEAR(same[0], 0.3, 1e-12);
  EXPECT_NEAR(same[1], 0.02, 1e-12);
  EXPECT_NEAR(same[2], 1.2, 1e-12);
}

}  // namespace
}  // namespace nerf
