// Curves through keys, by their closed forms.
#include "io/gltf_animation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace nerf::internal {
namespace {

using Shape = KeyCurve::Shape;

std::vector<double> at(const KeyCurve& curve, double seconds) {
  std::vector<double> x(curve.width());
  curve.at(seconds, x);
  return x;
}

TEST(KeyCurve, HoldsItsEnds) {
  for (const Shape shape : {Shape::kLinear, Shape::kStep}) {
    const KeyCurve curve({1, 2, 4}, {5, 7, 11}, shape, false);
    EXPECT_EQ(at(curve, -3)[0], 5);
    EXPECT_EQ(at(curve, 1)[0], 5);
    EXPECT_EQ(at(curve, 4)[0], 11);
    EXPECT_EQ(at(curve, 99)[0], 11);
    EXPECT_EQ(at(curve, 2)[0], 7);
    EXPECT_EQ(at(curve, 3.5)[0], shape == Shape::kStep ? 7 : 10);
  }
  EXPECT_EQ(at(KeyCurve({1}, {5, 6, 7}, Shape::kLinear, false), 8), (std::vector<double>{5, 6, 7}));
}

// A cubic is its own Hermite spline, whatever the keys' distance.
TEST(KeyCurve, ACubicIsReproduced) {
  const auto f = [](double t) { return 2 - t + 0.5 * t * t - 0.25 * t * t * t; };
  const auto slope = [](double t) { return -1 + t - 0.75 * t * t; };
  std::vector<double> values;
  const std::vector<double> times{0.5, 1, 3};
  for (const double t : times)
    for (const double x : {slope(t), f(t), slope(t)}) values.push_back(x);
  const KeyCurve curve(times, values, Shape::kCubic, false);
  for (double t = 0.5; t <= 3; t += 0.125) EXPECT_NEAR(at(curve, t)[0], f(t), 1e-12) << t;
}

TEST(KeyCurve, TurnsAlongTheShorterArcAtConstantSpeed) {
  const double half = 0.6;  // of 1.2 radians about z, the second written as its negative
  const KeyCurve curve({0, 2}, {0, 0, 0, 1, 0, 0, -std::sin(half), -std::cos(half)}, Shape::kLinear,
                       true);
  for (double t = 0; t <= 2; t += 0.25) {
    const auto q = at(curve, t);
    const double angle = 2 * std::atan2(q[2] / q[3], 1.0);
    EXPECT_NEAR(angle, 0.6 * t, 1e-12) << t;
    EXPECT_NEAR(q[2] * q[2] + q[3] * q[3], 1, 1e-12);
  }
}

TEST(KeyCurve, CubicTurnsAreUnit) {
  const double s = std::sqrt(0.5);
  const KeyCurve curve({0, 1}, {0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0,  //
                                0, 0, 1, 0, 0, 0, s, s, 0, 0, 0, 0},
                       Shape::kCubic, true);
  // At 1/2: (a + b) / 2 + (m0 - m1) / 8, then to unit length; slopes are equal here.
  const auto q = at(curve, 0.5);
  const double z = 0.5 * s, w = 0.5 * (1 + s), norm = std::hypot(z, w);
  EXPECT_NEAR(q[2], z / norm, 1e-12);
  EXPECT_NEAR(q[3], w / norm, 1e-12);
}

// Hermite's basis at 1/4, for a second that lasts 2: slopes count twice.
TEST(KeyCurve, SlopesOfCubicTurnsCount) {
  const double s = std::sqrt(0.5), m0 = 0.3, m1 = -0.2;
  const KeyCurve curve({0, 2}, {0, 0,  0, 0, 0, 0, 0, 1, 0, m0, 0, 0,  //
                                0, m1, 0, 0, 0, 0, s, s, 0, 0,  0, 0},
                       Shape::kCubic, true);
  const double u = 0.25, uu = u * u, uuu = uu * u;
  const double a = 2 * uuu - 3 * uu + 1, b = 3 * uu - 2 * uuu;
  const double y = 2 * ((uuu - 2 * uu + u) * m0 + (uuu - uu) * m1), z = b * s, w = a + b * s;
  const double norm = std::sqrt(y * y + z * z + w * w);
  const auto q = at(curve, 0.5);
  EXPECT_NEAR(q[1], y / norm, 1e-12);
  EXPECT_NEAR(q[2], z / norm, 1e-12);
  EXPECT_NEAR(q[3], w / norm, 1e-12);
}

}  // namespace
}  // namespace nerf::internal
