#include "math/relative_pose.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "nerf/math/camera_paths.h"
#include "nerf/math/random.h"

namespace nerf::internal {
namespace {

// Rodrigues' formula.
Mat3d turn(const Vec3d& axis, double angle) {
  const Vec3d k = normalized(axis);
  const double s = std::sin(angle), c = 1 - std::cos(angle);
  Mat3d r;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      r.m[static_cast<size_t>(i)][static_cast<size_t>(j)] = (i == j ? 1 - c : 0) + c * k[i] * k[j];
  r.m[0][1] -= s * k.z, r.m[0][2] += s * k.y, r.m[1][2] -= s * k.x;
  r.m[1][0] += s * k.z, r.m[2][0] -= s * k.y, r.m[2][1] += s * k.x;
  return r;
}

// Things in a box before the first camera, of which the share `wrong` is seen elsewhere.
struct Things {
  std::vector<Vec3d> first, second;
  Pose pose;

  Things(const Pose& second_from_first, int count, double noise, double wrong = 0)
      : pose(second_from_first) {
    Random random(7, 0, 0);
    const auto even = [&] { return 2 * static_cast<double>(random.uniform()) - 1; };
    for (int i = 0; i < count; ++i) {
      const Vec3d x{2 * even(), 2 * even(), 5 + 2 * even()};
      first.push_back(normalized(x));
      const Vec3d seen = normalized(pose * x) + Vec3d{even(), even(), even()} * noise;
      second.push_back(normalized(i < wrong * count ? Vec3d{even(), even(), 1} : seen));
    }
  }
  SeenByTwo seen() const { return {first, second}; }
};

TEST(RelativePose, RotationIsFoundAgainExactly) {
  for (const double degrees : {0.0, 3.0, 40.0, 90.0}) {
    const Mat3d rotation = turn({0.3, 1, -0.2}, degrees * 0.0174533);
    // Around the middle of the things, so that the second camera sees them too.
    const Vec3d middle{0, 0, 5};
    const Things things({rotation, middle - rotation * middle + Vec3d{0.4, 0.1, -0.2}}, 40, 0);
    const auto found = relative_rotation(things.seen());
    ASSERT_TRUE(found) << degrees;
    // The least eigenvector of moments is exact to the root of the rounding.
    EXPECT_LT(rotation_angle(*found, rotation), 1e-6) << degrees;
    EXPECT_EQ(explained_share(things.pose, things.seen(), 1e-6), 1) << degrees;
  }
}

TEST(RelativePose, OutliersAndNoiseTurnItLittle) {
  const Mat3d rotation = turn({0, 1, 0.1}, 0.3);
  const Vec3d middle{0, 0, 5};
  const Things things({rotation, middle - rotation * middle}, 200, 0.001, 0.1);
  const auto found = relative_rotation(things.seen());
  ASSERT_TRUE(found);
  EXPECT_LT(rotation_angle(*found, rotation), 0.03);
  // Of 20 wrong ones some lie near their epipolar planes by chance.
  const double share = explained_share(things.pose, things.seen(), 0.005);
  EXPECT_GE(share, 0.9);
  EXPECT_LE(share, 0.95);
}

TEST(RelativePose, AnotherPoseExplainsLittle) {
  const Mat3d rotation = turn({0, 1, 0}, 0.3);
  const Vec3d middle{0, 0, 5};
  const Things things({rotation, middle - rotation * middle}, 200, 0);
  // From the other side of the things.
  const Mat3d other = turn({0, 1, 0}, 3.1);
  EXPECT_LT(explained_share({other, middle - other * middle}, things.seen(), 0.005), 0.1);
  // What is behind a camera is not explained, though its line goes through the thing.
  EXPECT_EQ(explained_share({rotation, -(things.pose.translation)}, things.seen(), 0.005), 0);
}

TEST(RelativePose, TwoCamerasInOnePlaceAreComparedByTheirTurn) {
  const Mat3d rotation = turn({1, 0, 0}, 0.2);
  const Things things({rotation, {}}, 30, 0);
  EXPECT_EQ(explained_share(things.pose, things.seen(), 1e-6), 1);
  EXPECT_EQ(explained_share({turn({1, 0, 0}, 0.3), {}}, things.seen(), 0.01), 0);
}

TEST(RelativePose, WhatLeavesTheRotationOpenHasNone) {
  const Things few({turn({0, 1, 0}, 0.3), {1, 0, 0}}, 7, 0);
  EXPECT_FALSE(relative_rotation(few.seen()));
  const std::vector<Vec3d> same(20, Vec3d{0, 0, 1});
  EXPECT_FALSE(relative_rotation({same, same}));
  EXPECT_EQ(explained_share({}, {}, 0.01), 0);
}

}  // namespace
}  // namespace nerf::internal
