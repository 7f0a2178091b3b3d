#include "io/camera_orbit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace nerf::internal {
namespace {

Pose towards(const Vec3d& position, const Vec3d& target) {
  return {look_rotation(target - position, {0, 0, 1}), position};
}

Vec3d on_circle(double azimuth, double radius, double height) {
  return {radius * std::cos(azimuth), radius * std::sin(azimuth), height};
}

OrbitInput ring(int count, double arc, double radius = 2, double height = 1) {
  OrbitInput input;
  for (int i = 0; i < count; ++i)
    input.cameras.push_back(towards(on_circle(arc * i / count, radius, height), {}));
  return input;
}

// Density 50 inside a ball.
auto ball(const Vec3d& center, double radius) {
  return [=](std::span<const Vec3d> points) {
    std::vector<double> density;
    for (const Vec3d& p : points) density.push_back(length(p - center) < radius ? 50 : 0);
    return density;
  };
}

TEST(CameraOrbit, GoesAsFarAndAsHighAsTheCamerasThere) {
  OrbitInput input;
  for (int i = 0; i < 72; ++i) {
    const double a = 2 * std::numbers::pi * i / 72;
    input.cameras.push_back(towards(on_circle(a, 3 + std::cos(a), 1 + 0.5 * std::sin(a)), {}));
  }
  std::vector<std::string> notes;
  const PoseCurve orbit = make_orbit(input, notes);
  EXPECT_TRUE(notes.empty());
  for (int i = 0; i < 36; ++i) {
    const Vec3d p = orbit.at(i / 36.0).translation;
    const double a = std::atan2(p.y, p.x);
    // A mean over 20 degrees takes exp(-sigma^2 / 2) of the first harmonic: 6 % less.
    EXPECT_NEAR(std::hypot(p.x, p.y), 3 + std::cos(a), 0.15);
    EXPECT_NEAR(p.z, 1 + 0.5 * std::sin(a), 0.1);
  }
}

TEST(CameraOrbit, StraysDoNotCount) {
  OrbitInput input = ring(24, 2 * std::numbers::pi);
  input.cameras.push_back(towards({40, 0, 5}, {}));
  input.cameras.push_back(towards({0.1, 0, 0.1}, {}));
  std::vector<std::string> notes;
  const PoseCurve orbit = make_orbit(input, notes);
  for (int i = 0; i < 24; ++i)
    EXPECT_NEAR(length(orbit.at(i / 24.0).translation), std::sqrt(5), 1e-9);
}

TEST(CameraOrbit, AGapOfAQuarterIsNotCrossed) {
  std::vector<std::string> notes;
  make_orbit(ring(40, 1.6 * std::numbers::pi), notes);  // 72 degrees without a photo
  EXPECT_TRUE(notes.empty());
  const PoseCurve swing = make_orbit(ring(40, 1.4 * std::numbers::pi), notes);  // 108 degrees
  EXPECT_EQ(notes.size(), 1u);
  for (int i = 0; i < 100; ++i) {
    const Vec3d p = swing.at(i / 100.0).translation;
    double a = std::atan2(p.y, p.x);
    if (a < -1e-9) a += 2 * std::numbers::pi;
    EXPECT_LT(a, 1.4 * std::numbers::pi);
  }
}

TEST(CameraOrbit, ASwingGoesUpAndDownAsFarAsTheCamerasWereHeld) {
  OrbitInput input;
  for (int i = 0; i < 30; ++i)
    input.cameras.push_back(towards(on_circle(0.03 * (i / 3), 4, 0.5 * (i % 3 - 1)), {}));
  std::vector<std::string> notes;
  const PoseCurve swing = make_orbit(input, notes);
  double least = 9, most = -9;
  for (int i = 0; i < 100; ++i) {
    const double z = swing.at(i / 100.0).translation.z;
    least = std::min(least, z);
    most = std::max(most, z);
  }
  EXPECT_NEAR(most, 0.5 * std::sqrt(2.0 / 3), 0.02);  // the heights' standard deviation
  EXPECT_NEAR(least, -most, 0.02);
}

TEST(CameraOrbit, NeverGoesThroughMatter) {
  OrbitInput input = ring(36, 2 * std::numbers::pi);
  const Vec3d pillar = on_circle(1, 2.1, 1.1);
  std::vector<std::string> notes;
  const PoseCurve blind = make_orbit(input, notes);
  input.density = ball(pillar, 0.35);
  const PoseCurve orbit = make_orbit(input, notes);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("matter"), std::string::npos);
  double nearest = 9, nearest_blind = 9, farthest_move = 0;
  Vec3d before = orbit.at(0).translation;
  for (int i = 1; i <= 400; ++i) {
    const Pose pose = orbit.at(i / 400.0);
    nearest = std::min(nearest, length(pose.translation - pillar));
    nearest_blind = std::min(nearest_blind, length(blind.at(i / 400.0).translation - pillar));
    farthest_move = std::max(farthest_move, length(pose.translation - before));
    before = pose.translation;
    EXPECT_NEAR(dot(pose.rotation.column(2), normalized(-pose.translation)), 1, 1e-9);
    EXPECT_NEAR(pose.rotation.column(0).z, 0, 1e-12);
  }
  EXPECT_LT(nearest_blind, 0.2);
  EXPECT_GT(nearest, 0.35);
  EXPECT_LT(farthest_move, 3 * 2 * 2 * std::numbers::pi / 400) << "it gives way smoothly";
  // Far from it nothing changes.
  EXPECT_LT(length(orbit.at(0.6).translation - blind.at(0.6).translation), 0.02);
}

TEST(CameraOrbit, AWallBeforeTheLensIsGoneRound) {
  OrbitInput input = ring(36, 2 * std::numbers::pi);
  // A plate between the camera and the focus, from 0.2 to 0.6 before the cameras at azimuth 2.
  const Vec3d out = normalized(on_circle(2, 2, 1));
  input.density = [=](std::span<const Vec3d> points) {
    std::vector<double> density;
    for (const Vec3d& p : points) {
      const double along = dot(p, out);
      const bool inside = along > 1.7 && along < 2.0 && length(p - out * along) < 0.4;
      density.push_back(inside ? 50 : 0);
    }
    return density;
  };
  std::vector<std::string> notes;
  const PoseCurve orbit = make_orbit(input, notes);
  ASSERT_EQ(notes.size(), 1u);
  for (int i = 0; i < 200; ++i) {
    const Pose pose = orbit.at(i / 200.0);
    double stopped = 0;
    for (double t = 0; t < 0.7; t += 0.01) {
      const Vec3d p = pose.translation + pose.rotation.column(2) * t;
      stopped += input.density(std::vector<Vec3d>{p})[0] * 0.01;
    }
    EXPECT_LT(stopped, 1) << i;
  }
}

TEST(CameraOrbit, LooksOutwardWhereTheCamerasDo) {
  OrbitInput input = ring(12, 2 * std::numbers::pi);
  input.outward = true;
  std::vector<std::string> notes;
  const PoseCurve orbit = make_orbit(input, notes);
  for (int i = 0; i < 12; ++i) {
    const Pose pose = orbit.at(i / 12.0);
    EXPECT_NEAR(dot(pose.rotation.column(2), normalized(pose.translation)), 1, 1e-9);
  }
}

TEST(CameraOrbit, OneCameraOrAllAtTheFocusStillGiveACurve) {
  for (const Vec3d& at : {Vec3d{2, 0, 0}, Vec3d{0, 0, 0}, Vec3d{0, 0, 3}}) {
    OrbitInput input;
    input.cameras.push_back({Mat3d{}, at});
    std::vector<std::string> notes;
    const PoseCurve orbit = make_orbit(input, notes);
    for (int i = 0; i < 8; ++i) EXPECT_LT(orthonormality_error(orbit.at(i / 8.0).rotation), 1e-12);
  }
}

}  // namespace
}  // namespace nerf::internal
