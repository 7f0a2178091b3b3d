// Rigid motions of constant velocity, and cameras that move while their lines are read.
#include "nerf/math/twist.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "nerf/math/camera.h"
#include "nerf/math/ray.h"
#include "nerf/math/reference/rigid_motion.h"
#include "nerf/math/refined_camera.h"
#include "support/cameras.h"
#include "worst_error.h"

namespace nerf {
namespace {

using test::some_pose;

Twist some_twist(double angle) {
  return {normalized(Vec3d{0.3, -0.8, 0.5}) * angle, {0.7, -0.2, 1.1}};
}

constexpr double kAngles[] = {0, 1e-9, 1e-3, 0.0999, 0.1001, 0.7, 1, 2.2, 3.1};

// The model of warps that turn and move has the same exponential.
TEST(Twist, MotionsAreThoseOfTheSpecification) {
  const Vec3d x{0.4, 1.3, -0.9};
  WorstError worst("twist");
  for (const double angle : kAngles) {
    const Twist t = some_twist(angle);
    const std::vector<double> want =
        reference::rigid_motion<double>({t.rotation.x, t.rotation.y, t.rotation.z, t.translation.x,
                                         t.translation.y, t.translation.z},
                                        {x.x, x.y, x.z});
    const Vec3d got = motion_by(t) * x;
    // Some forty operations on numbers of at most 3.
    for (int k = 0; k < 3; ++k)
      worst.compare(got[k], want[static_cast<size_t>(k)], 40 * 3 * 0x1p-53, "angle", angle);
  }
  worst.report();
}

TEST(Twist, LogarithmsAreTheOtherWayRound) {
  for (const double angle : kAngles) {
    const Twist want = some_twist(angle), got = twist_of(motion_by(want));
    // An angle near pi is the arc tangent of a small cosine.
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(got.rotation[k], want.rotation[k], 1e-14) << angle;
      EXPECT_NEAR(got.translation[k], want.translation[k], 1e-13) << angle;
    }
  }
}

TEST(Twist, TimesAddUp) {
  const Twist t = some_twist(0.8);
  const Pose there = moved(motion_by(t * 0.3), motion_by(t * 0.7)), once = motion_by(t);
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(there.translation[k], once.translation[k], 1e-15);
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(there.rotation.m[static_cast<size_t>(k)][static_cast<size_t>(c)],
                  once.rotation.m[static_cast<size_t>(k)][static_cast<size_t>(c)], 1e-15);
  }
}

Camera moving_camera() {
  Camera camera = test::pinhole(40, 30, 33);
  camera.motion.twist = some_twist(0.2);
  return camera;
}

void expect_same(const Ray& a, const Ray& b, double tolerance = 1e-14) {
  for (int k = 0; k < 3; ++k) {
    EXPECT_NEAR(a.origin[k], b.origin[k], tolerance);
    EXPECT_NEAR(a.direction[k], b.direction[k], tolerance);
  }
}

TEST(LineMotion, EveryRowHasAPoseOfItsOwn) {
  const Camera camera = moving_camera();
  Camera still = camera;
  still.motion = {};
  const Twist t = camera.motion.twist;
  for (const double y : {0.0, 0.5, 15.0, 22.5, 30.0}) {
    const Vec2d pixel{7.5, y};
    const double share = y / 30 - 0.5;
    EXPECT_NEAR(line_share(camera, pixel), share, 1e-15);
    const Pose row = moved(some_pose(), motion_by(t * share));
    expect_same(*camera_ray(camera, some_pose(), pixel), *camera_ray(still, row, pixel));
  }
  // The middle row has the pose that is given.
  expect_same(*camera_ray(camera, some_pose(), {3, 15}), *camera_ray(still, some_pose(), {3, 15}));
  EXPECT_EQ(ray_pose(still, some_pose(), {3, 2}).translation, some_pose().translation);
}

TEST(LineMotion, StaysWithTheLinesOfOtherPictures) {
  const Camera camera = moving_camera();
  const Pose pose = some_pose();
  const Ray ray = *camera_ray(camera, pose, {11, 21});
  expect_same(*camera_ray(camera.scaled_to(20, 60), pose, {5.5, 42}), ray);
  expect_same(*camera_ray(camera.rows(18, 6), pose, {11, 3}), ray);
  expect_same(*camera_ray(camera.scaled_to(80, 60).rows(40, 10), pose, {22, 2}), ray);
  Pose in_unit = pose;
  in_unit.translation = in_unit.translation * 4;
  Ray larger = *camera_ray(camera.in_unit(4), in_unit, {11, 21});
  larger.origin = larger.origin / 4;
  expect_same(larger, ray);
}

TEST(LineMotion, ColumnsMayBeReadFromTheRight) {
  Camera camera = moving_camera();
  camera.motion.along = {-1, 0};
  camera.motion.middle = -0.5;
  EXPECT_NEAR(line_share(camera, {40, 12}), -0.5, 1e-15);  // first
  EXPECT_NEAR(line_share(camera, {0, 12}), 0.5, 1e-15);
}

}  // namespace
}  // namespace nerf
