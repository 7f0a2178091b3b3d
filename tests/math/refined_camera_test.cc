#include "nerf/math/refined_camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "support/cameras.h"
#include "worst_error.h"

namespace nerf {
namespace {

using test::make_camera;
using test::some_pose;

// A lens of each model that can be corrected, with every coefficient in use.
std::vector<Camera> lenses() {
  using enum CameraModel;
  return {
      make_camera(kSimplePinhole, {501, 322, 238}),
      make_camera(kPinhole, {501, 498, 322, 238}),
      make_camera(kSimpleRadial, {501, 322, 238, -0.09}),
      make_camera(kRadial, {501, 322, 238, 0.11, -0.02}),
      make_camera(kOpenCV, {501, 498, 322, 238, -0.1, 0.04, 0.002, -0.003}),
      make_camera(kOpenCVFisheye, {301, 298, 322, 238, 0.02, -0.01, 0.004, -0.0005}),
      make_camera(kFullOpenCV,
                  {501, 498, 322, 238, 0.3, 0.05, 0.001, -0.001, 0.003, 0.4, 0.08, 0.002}),
      make_camera(kSimpleRadialFisheye, {301, 322, 238, -0.02}),
      make_camera(kRadialFisheye, {301, 322, 238, 0.02, -0.004}),
      make_camera(kThinPrismFisheye, {301, 298, 322, 238, 0.02, -0.01, 0.001, -0.001, 0.003,
                                      -0.0004, 0.0007, -0.0005}),
      make_camera(kRadTanThinPrismFisheye,
                  {301, 298, 322, 238, 0.02, -0.02, 0.007, -0.002, 0.0004, -0.00003, 0.001, -0.0008,
                   0.0006, -0.0002, -0.0004, 0.0003}),
  };
}

// The derivative of f at 0 by central differences of h and h / 2: extrapolated, with a bound from
// what the extrapolation moved and from the error of f's values.
struct Slope {
  double value, bound;
};
Slope slope(const std::function<double(double)>& f, double h, double error_of_f) {
  const auto central = [&](double step) { return (f(step) - f(-step)) / (2 * step); };
  const double wide = central(h), narrow = central(h / 2);
  const double value = narrow + (narrow - wide) / 3;
  // What is left after one extrapolation is h^2 times what was taken away, but for a constant.
  return {value, std::fabs(narrow - wide) * 16 * h + 8 * error_of_f / h};
}

double& parameter(LensCorrection& c, int i) {
  double* const all[] = {&c.focal, &c.centre.x, &c.centre.y, &c.k1, &c.k2};
  return *all[i];
}

TEST(RefinedCamera, NoCorrectionChangesNothing) {
  const Pose pose = some_pose(), same = corrected(pose, {});
  EXPECT_EQ(pose.rotation.m, same.rotation.m);
  EXPECT_EQ(pose.translation, same.translation);
  for (const Camera& camera : lenses()) {
    const Camera still = corrected(camera, LensCorrection());
    EXPECT_EQ(still.model, camera.model);
    EXPECT_EQ(still.params, camera.params);
  }
}

TEST(RefinedCamera, RotationsAreRodrigues) {
  for (const double angle : {0.0, 1e-9, 1e-3, 0.0999, 0.1001, 1.0, 3.1}) {
    const Vec3d axis = normalized(Vec3d{1, -2, 0.5});
    const Mat3d r = rotation_by(axis * angle);
    const Vec3d v{0.7, 0.1, -0.4};
    const Vec3d along = axis * dot(axis, v), across = v - along;
    const Vec3d want = along + across * std::cos(angle) + cross(axis, across) * std::sin(angle);
    for (int k = 0; k < 3; ++k) EXPECT_NEAR((r * v)[k], want[k], 4e-15) << angle;
  }
}

TEST(RefinedCamera, TurnsAboutItsOwnCentre) {
  const Pose pose = some_pose();
  const Pose turned = corrected(pose, {{0.1, 0.2, -0.3}, {0.5, 0, 0}});
  EXPECT_EQ(turned.translation, (pose.translation + Vec3d{0.5, 0, 0}));
  // A quarter turn about z takes what looked along x to y, in world axes.
  const Mat3d quarter = rotation_by({0, 0, std::numbers::pi / 2});
  EXPECT_NEAR((quarter * Vec3d{1, 0, 0}).y, 1, 1e-15);
}

TEST(RefinedCamera, GradientByRotation) {
  WorstError worst("rotation_gradient");
  const Vec3d direction = normalized(Vec3d{0.2, -0.3, 1}), gradient{0.7, -1.1, 0.4};
  const Pose pose = some_pose();
  for (const double size : {0.0, 1e-6, 0.01, 0.09, 0.5}) {
    const Vec3d w = Vec3d{0.6, -0.5, 0.7} * size;
    const Vec3d seen = corrected(pose, {w, {}}).rotation * direction;
    const Vec3d got = rotation_gradient(w, cross(seen, gradient));
    for (int k = 0; k < 3; ++k) {
      const Slope s = slope(
          [&](double h) {
            Vec3d at = w;
            at[k] += h;
            return dot(corrected(pose, {at, {}}).rotation * direction, gradient);
          },
          1e-3, 1e-15);
      worst.compare(got[k], s.value, s.bound, "size", size, "axis", k);
    }
  }
  worst.report();
}

TEST(RefinedCamera, GradientByLens) {
  WorstError worst("lens_gradient");
  const Vec3d gradient{0.7, -1.1, 0.4};
  for (const Camera& given : lenses())
    for (const bool moved : {false, true}) {
      LensCorrection correction;
      if (moved) correction = {0.02, {0.01, -0.015}, 0.01, -0.004};
      const Camera refined = corrected(given, correction);
      for (const Vec2d pixel : {Vec2d{322, 238}, Vec2d{60, 30}, Vec2d{500, 400}, Vec2d{330, 70}}) {
        const auto direction = unproject(refined, pixel);
        ASSERT_TRUE(direction);
        const auto got = lens_gradient(refined, correction, normalized(*direction), gradient);
        for (int i = 0; i < LensCorrection::kParameters; ++i) {
          const Slope s = slope(
              [&](double h) {
                LensCorrection at = correction;
                parameter(at, i) += h;
                return dot(normalized(*unproject(corrected(given, at), pixel)), gradient);
              },
              1e-3, 1e-14);
          worst.compare(got[static_cast<size_t>(i)], s.value, s.bound,
                        camera_model_name(given.model), moved ? "moved" : "given", "at", pixel.x,
                        pixel.y, "parameter", i);
        }
      }
    }
  worst.report();
}

TEST(RefinedCamera, PointsAreWhereTheCorrectionSays) {
  const Camera given = make_camera(CameraModel::kPinhole, {500, 490, 320, 240});
  const Camera refined = corrected(given, LensCorrection{std::log(1.02), {0.01, -0.02}, 0.1, 0});
  EXPECT_EQ(refined.model, CameraModel::kOpenCV);
  EXPECT_NEAR(refined.fx(), 510, 1e-12);
  EXPECT_NEAR(refined.fy(), 499.8, 1e-12);
  EXPECT_NEAR(refined.cx(), 325, 1e-12);
  EXPECT_NEAR(refined.cy(), 230.2, 1e-12);
  const auto pixel = project(refined, {0.3, 0, 1});
  ASSERT_TRUE(pixel);
  EXPECT_NEAR(pixel->x, 325 + 510 * 0.3 * (1 + 0.1 * 0.09), 1e-9);
}

TEST(RefinedCamera, SomeLensesStay) {
  const Camera fov = make_camera(CameraModel::kFov, {501, 498, 322, 238, 0.9});
  const Camera same = corrected(fov, LensCorrection{0.1, {0.1, 0.1}, 0.1, 0.1});
  EXPECT_EQ(same.params, fov.params);
  const auto none = lens_gradient(fov, LensCorrection{}, {0, 0, 1}, {1, 1, 1});
  for (const double g : none) EXPECT_EQ(g, 0);
}

}  // namespace
}  // namespace nerf
