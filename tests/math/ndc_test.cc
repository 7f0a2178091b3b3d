#include "nerf/math/ndc.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "nerf/math/random.h"

namespace nerf {
namespace {

NdcFrame some_frame() {
  NdcFrame frame;
  const Vec3d z = normalized(Vec3d{0.2, -0.3, 1}), x = normalized(cross(Vec3d{0.1, 1, 0}, z));
  frame.reference.rotation.set_column(0, x);
  frame.reference.rotation.set_column(1, cross(z, x));
  frame.reference.rotation.set_column(2, z);
  frame.reference.translation = {0.3, -0.1, 0.2};
  frame.scale_x = 1.7;
  frame.scale_y = 2.3;
  frame.near = 0.8;
  return frame;
}

// Lines stay lines: every point of the world ray is where the ray in the cube has it.
TEST(Ndc, ARayIsTheImageOfItsPoints) {
  const NdcFrame frame = some_frame();
  for (uint64_t i = 0; i < 50; ++i) {
    Random random(3, 0, i);
    const auto u = [&] { return static_cast<double>(random.uniform()) - 0.5; };
    const Vec3d origin = frame.reference.translation + Vec3d{u(), u(), u()};
    const Vec3d d = normalized(frame.reference.rotation * Vec3d{u(), u(), 1});
    const auto ray = to_ndc(frame, origin, d);
    ASSERT_TRUE(ray);
    for (double t : {0.0, 0.3, 0.9, 0.999}) {
      const auto want = point_to_ndc(frame, origin + d * ndc_distance(*ray, t));
      ASSERT_TRUE(want);
      EXPECT_LT(length(ray->origin + ray->direction * t - *want), 1e-10) << t;
      EXPECT_NEAR(ndc_parameter(*ray, ndc_distance(*ray, t)), t, 1e-12);
    }
    EXPECT_NEAR(ray->origin.z, -1, 1e-12);                    // the near plane
    EXPECT_NEAR(ray->origin.z + ray->direction.z, 1, 1e-12);  // infinity
    EXPECT_TRUE(std::isinf(ndc_distance(*ray, 1)));
    EXPECT_EQ(ndc_parameter(*ray, ndc_distance(*ray, 1)), 1);
    EXPECT_LT(ndc_parameter(*ray, ray->start - 0.01), 0);
    EXPECT_EQ(ndc_parameter(*ray, -1e9), -std::numeric_limits<double>::infinity());
  }
}

// Against differences of the points' images.
TEST(Ndc, StretchIsTheLengthOfTheDerivative) {
  const NdcFrame frame = some_frame();
  for (uint64_t i = 0; i < 50; ++i) {
    Random random(4, 0, i);
    const auto u = [&] { return static_cast<double>(random.uniform()) - 0.5; };
    const Vec3d p =
        frame.reference.translation + frame.reference.rotation * Vec3d{u(), u(), 1.5 + u()};
    const Vec3d d = normalized(Vec3d{u(), u(), u()});
    constexpr double kStep = 1e-5;
    const auto ahead = point_to_ndc(frame, p + d * kStep),
               back = point_to_ndc(frame, p - d * kStep);
    ASSERT_TRUE(ahead && back);
    // The third derivative is below 100: 1e-10 / 6 of it, and 1e-16 / 1e-5 of rounding.
    EXPECT_NEAR(ndc_stretch(frame, p, d), length(*ahead - *back) / (2 * kStep), 1e-8);
  }
  const Vec3d behind = frame.reference.translation - frame.reference.rotation.column(2);
  EXPECT_EQ(ndc_stretch(frame, behind, {0, 0, 1}), 0);
}

// By hand, with the reference at the origin: the corner of the picture at any depth is a corner of
// the cube.
TEST(Ndc, ThePicturesCornerIsTheCubes) {
  NdcFrame frame;
  frame.scale_x = 2;  // focal length over half the width
  frame.scale_y = 3;
  for (double z : {1.0, 2.0, 50.0}) {
    const auto p = point_to_ndc(frame, Vec3d{z / 2, z / 3, z});
    ASSERT_TRUE(p);
    EXPECT_NEAR(p->x, 1, 1e-12);
    EXPECT_NEAR(p->y, 1, 1e-12);
    EXPECT_NEAR(p->z, 1 - 2 / z, 1e-12);
  }
}

TEST(Ndc, WhatDoesNotGoForwardHasNoRay) {
  const NdcFrame frame;
  EXPECT_FALSE(to_ndc(frame, {0, 0, 0}, {0, 0, -1}));
  EXPECT_FALSE(to_ndc(frame, {0, 0, 0}, {1, 0, 0}));
  EXPECT_FALSE(point_to_ndc(frame, {0, 0, -1}));
}

}  // namespace
}  // namespace nerf
