// Which way is up, and what cameras look at, from their poses.
#include <gtest/gtest.h>

#include <numbers>

#include "frame_poses.h"
#include "io/scene_frame.h"
#include "support/temp_folder.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

TEST(EstimateUp, LevelCamerasOnAnArcThatLookDown) {
  std::vector<std::string> warnings;
  for (double degrees : {90.0, 150.0, 330.0}) {
    const Vec3d up = estimate_up(views_of(rotated(arc(20, degrees), tilted())), {}, warnings).up;
    EXPECT_LT(angle(up, tilted() * Vec3d{0, 0, 1}), 1.5 * kDegree) << degrees;
    EXPECT_NEAR(length(up), 1, 1e-12);
  }
  EXPECT_TRUE(warnings.empty());
}

TEST(EstimateUp, HandheldRollAveragesOut) {
  std::vector<Pose> poses = arc(40, 350);
  for (size_t i = 0; i < poses.size(); ++i) {
    poses[i] = rolled(poses[i], 6 * kDegree * std::sin(2.7 * static_cast<double>(i)));
  }
  std::vector<std::string> warnings;
  EXPECT_LT(angle(estimate_up(views_of(poses), {}, warnings).up, {0, 0, 1}), 1.5 * kDegree);
}

TEST(EstimateUp, ParallelCamerasKeepTheirOwnUp) {
  std::vector<Pose> poses;
  for (int i = 0; i < 12; ++i) {
    Pose p = look_at({0, 0, 0}, {0, 10, 0});
    p.translation = {0.2 * (i % 4), 0, 0.2 * (i / 4)};
    poses.push_back(p);
  }
  std::vector<std::string> warnings;
  EXPECT_LT(angle(estimate_up(views_of(rotated(poses, tilted())), {}, warnings).up,
                  tilted() * Vec3d{0, 0, 1}),
            0.1 * kDegree);
}

TEST(EstimateUp, APlanarRingCorrectsRoll) {
  // All cameras rolled the same way on a ring look up to a wrong, common direction only by chance:
  // here the roll grows round the ring, which tilts the horizon estimate.
  std::vector<Pose> poses;
  for (int i = 0; i < 30; ++i) {
    poses.push_back(
        rolled(ring_pose(i, 30), 8 * kDegree * std::cos(2 * std::numbers::pi * i / 30)));
  }
  std::vector<std::string> warnings;
  EXPECT_LT(angle(estimate_up(views_of(poses), {}, warnings).up, {0, 0, 1}), 0.01 * kDegree);
}

TEST(EstimateUp, PhotosOnTheirSideAreWarnedOf) {
  std::vector<Pose> poses = arc(24, 345, 0.2, 0.4);
  for (Pose& p : poses) p = rolled(p, std::numbers::pi / 2);
  std::vector<std::string> warnings;
  const Vec3d up = estimate_up(views_of(poses), {}, warnings).up;
  EXPECT_LT(std::min(angle(up, {0, 0, 1}), angle(up, {0, 0, -1})), 2 * kDegree);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_TRUE(contains(warnings[0], "lie on a side"));
}

TEST(EstimateUp, LookingDownFromTheAir) {
  std::vector<Pose> turning, to_and_fro;
  for (int i = 0; i < 30; ++i) {
    const Vec3d eye{i % 6 * 1.0, i / 6 * 1.0, 5};
    const double turn = 2.4 * i;
    turning.push_back(
        look_at(eye, eye - Vec3d{0.05, 0.02, 1}, {std::cos(turn), std::sin(turn), 0}));
    to_and_fro.push_back(look_at(eye, eye - Vec3d{0.01, 0.02, 1}, {0, i / 6 % 2 ? 1.0 : -1.0, 0}));
  }
  std::vector<std::string> warnings;
  EXPECT_LT(angle(estimate_up(views_of(rotated(turning, tilted())), {}, warnings).up,
                  tilted() * Vec3d{0, 0, 1}),
            5 * kDegree);
  EXPECT_LT(angle(estimate_up(views_of(to_and_fro), {}, warnings).up, {0, 0, 1}), 5 * kDegree);
  EXPECT_TRUE(warnings.empty());
}

TEST(EstimateFocus, AxesThatMeet) {
  std::vector<Pose> poses = arc(15, 120);
  for (Pose& p : poses) p.translation = p.translation + Vec3d{5, -7, 2};
  const auto focus = estimate_focus(views_of(rotated(poses, tilted())));
  ASSERT_TRUE(focus);
  EXPECT_LT(length(*focus - tilted() * Vec3d{5, -7, 2}), 1e-6);
}

TEST(EstimateFocus, AFewStrayCamerasDoNotMoveIt) {
  std::vector<Pose> poses = arc(30, 300);
  poses[3] = look_at({4, 0, 1}, {4, 9, 1});
  poses[17] = look_at({5, 0, 1}, {5, 9, 1.5});
  const auto focus = estimate_focus(views_of(poses));
  ASSERT_TRUE(focus);
  EXPECT_LT(length(*focus), 0.15);
}

TEST(EstimateFocus, NoneForParallelOrOutwardCameras) {
  std::vector<Pose> parallel, outward;
  for (int i = 0; i < 12; ++i) {
    Pose p = look_at({0, 0, 0}, {0, 10, 0});
    p.translation = {0.3 * i, 0, 0.1 * (i % 3)};
    parallel.push_back(p);
    const double a = std::numbers::pi / 6 * i;
    outward.push_back(look_at({0.5 * std::cos(a), 0.5 * std::sin(a), 0},
                              {5 * std::cos(a), 5 * std::sin(a), 0.3}));
  }
  EXPECT_FALSE(estimate_focus(views_of(parallel)));
  EXPECT_FALSE(estimate_focus(views_of(outward)));
}

TEST(RotationToZ, TakesUpToZForAnyUp) {
  for (const Vec3d up :
       {Vec3d{0, 0, 1}, Vec3d{0, 0, -1}, Vec3d{0, -1, 0}, Vec3d{0.6, 0.64, -0.48}}) {
    const Mat3d r = rotation_to_z(up);
    EXPECT_LT(length(r * up - Vec3d{0, 0, 1}), 1e-12);
    EXPECT_NEAR(dot(cross(r.column(0), r.column(1)), r.column(2)), 1, 1e-12);
  }
  EXPECT_EQ(rotation_to_z({0, 0, 1}).m, Mat3d{}.m);
}

}  // namespace
}  // namespace nerf::internal
