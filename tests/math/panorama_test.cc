// The equirectangular camera: closed forms, and nerfstudio's formulas as an independent twin.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "nerf/math/camera.h"
#include "nerf/math/random.h"

namespace nerf {
namespace {

void expect_same(const Vec3d& a, const Vec3d& b, double tolerance = 1e-12) {
  EXPECT_LT(length(a - b), tolerance)
      << a.x << ' ' << a.y << ' ' << a.z << " is not " << b.x << ' ' << b.y << ' ' << b.z;
}

// Axes right, up, backward to right, down, forward.
Vec3d from_opengl(const Vec3d& v) { return {v.x, -v.y, -v.z}; }

// cameras.py: theta and phi of a picture of w x h pixels with fl_x w / 2 and fl_y h (or, of VR180,
// half of the angle).
Vec3d nerfstudio_direction(const Vec2d& pixel, double w, double h, bool vr180) {
  const double u = (pixel.x - w / 2) / (w / 2), v = -(pixel.y - h / 2) / h;
  const double theta = -std::numbers::pi * (vr180 ? u / 2 : u), phi = std::numbers::pi * (0.5 - v);
  return from_opengl(
      {-std::sin(theta) * std::sin(phi), std::cos(phi), -std::cos(theta) * std::sin(phi)});
}

TEST(Panorama, LooksWhereItsPixelsSay) {
  const Camera c = panorama(800, 400);
  const auto at = [&](double x, double y) { return unproject(c, {x, y}).value(); };
  expect_same(at(400, 200), {0, 0, 1});
  expect_same(at(600, 200), {1, 0, 0});
  expect_same(at(200, 200), {-1, 0, 0});
  expect_same(at(0, 200), {0, 0, -1});
  expect_same(at(800, 200), {0, 0, -1});
  expect_same(at(123, 0), {0, -1, 0});
  expect_same(at(700, 400), {0, 1, 0});
  expect_same(at(400, 100), normalized(Vec3d{0, -1, 1}));
  const auto right = project(c, {3, 0, 0});
  ASSERT_TRUE(right);
  EXPECT_NEAR(right->x, 600, 1e-10);
  EXPECT_NEAR(right->y, 200, 1e-10);
  EXPECT_FALSE(unproject(c, {801, 200}));
  EXPECT_FALSE(unproject(c, {400, -1}));
  EXPECT_TRUE(is_panorama(c));
  EXPECT_EQ(depth_per_distance(c, {0, 0, -1}), 1);
  EXPECT_EQ(depth_per_distance(Camera{CameraModel::kPinhole, 4, 4, {4, 4, 2, 2}}, {0.6, 0, 0.8}),
            0.8);
}

TEST(Panorama, AgreesWithNerfstudio) {
  for (const bool vr180 : {false, true}) {
    const Camera c = panorama(300, 200, vr180 ? std::numbers::pi : 2 * std::numbers::pi);
    for (uint64_t i = 0; i < 200; ++i) {
      Random random(5, 0, i);
      const Vec2d pixel{300 * static_cast<double>(random.uniform()),
                        200 * static_cast<double>(random.uniform())};
      const Vec3d d = unproject(c, pixel).value();
      expect_same(d, nerfstudio_direction(pixel, 300, 200, vr180));
      const auto back = project(c, d * 7);
      ASSERT_TRUE(back);
      EXPECT_NEAR(back->x, pixel.x, 1e-9);
      EXPECT_NEAR(back->y, pixel.y, 1e-9);
    }
  }
}

TEST(Panorama, PixelsCoverTheSphere) {
  const Camera c = panorama(128, 64);
  double area = 0;
  for (int y = 0; y < 64; ++y) area += 128 * relative_solid_angle(c, y + 0.5) / (c.fx() * c.fy());
  EXPECT_NEAR(area, 4 * std::numbers::pi,
              4 * std::numbers::pi * std::numbers::pi * std::numbers::pi / (24 * 64 * 64) *
                  1.1);  // the midpoint rule's
  EXPECT_EQ(relative_solid_angle(c, 32), 1);
  EXPECT_EQ(relative_solid_angle(Camera{CameraModel::kPinhole, 4, 4, {4, 4, 2, 2}}, 0), 1);
}

// A pixel is 1 / fy high and cos(elevation) / fx wide, at the seam and beside the poles as well.
TEST(Panorama, ConesAreThoseOfTheirPixels) {
  const Camera c = panorama(2048, 1024);
  for (const Vec2d pixel : {Vec2d{1024, 512}, {2047.5, 300.5}, {0.5, 1023.5}, {700.5, 0.5}}) {
    const double width = std::sin(std::numbers::pi * pixel.y / 1024) / c.fx();
    EXPECT_NEAR(pixel_cone_radius(c, pixel), (width + 1 / c.fy()) / std::sqrt(12.0), 1e-8)
        << pixel.x << ' ' << pixel.y;
  }
}

TEST(Panorama, RowsAndOtherSizesAreTheSamePicture) {
  const Camera c = panorama(800, 400);
  expect_same(unproject(c.rows(100, 50), {33, 20}).value(), unproject(c, {33, 120}).value());
  expect_same(unproject(c.scaled_to(80, 100), {33, 20}).value(), unproject(c, {330, 80}).value());
}

// _compute_rays_for_omnidirectional_stereo: a circle of the distance between the eyes.
TEST(Panorama, EyesOfStereoStandAtRightAnglesToTheirRays) {
  constexpr double kHalf = 0.032;
  Pose pose;
  pose.rotation.set_column(0, {0, 0, -1});
  pose.rotation.set_column(2, {1, 0, 0});
  pose.translation = {5, -3, 2};
  for (const double eye : {-kHalf, kHalf}) {
    Camera c = panorama(64, 32);
    c.params[4] = eye;
    for (double x = 0.5; x < 64; ++x) {
      const Vec2d pixel{x, 9.5};
      const double theta = -std::numbers::pi * (x - 32) / 32, right = eye > 0 ? 1 : -1;
      const Vec3d circle = Vec3d{1, 0, 0} * (right * kHalf * std::cos(theta)) +
                           Vec3d{0, 0, -1} * (right * kHalf * std::sin(theta));
      const Pose ray = ray_pose(c, pose, pixel);
      expect_same(ray.translation, pose * from_opengl(circle));
      EXPECT_EQ(ray.rotation.m, pose.rotation.m);
      const Vec3d offset = ray.translation - pose.translation;
      EXPECT_NEAR(length(offset), kHalf, 1e-12);
      EXPECT_NEAR(dot(offset, pose.rotation * *unproject(c, pixel)), 0, 1e-12);
    }
    expect_same(ray_pose(c.in_unit(4), pose, {32, 16}).translation, pose * Vec3d{4 * eye, 0, 0});
  }
  const Camera mono = panorama(64, 32);
  EXPECT_EQ(ray_pose(mono, pose, {3, 4}).translation, pose.translation);
}

}  // namespace
}  // namespace nerf
