#include "nerf/math/camera_paths.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace nerf {
namespace {

Mat3d turn(const Vec3d& axis, double angle) {
  const Vec3d a = normalized(axis);
  const double s = std::sin(angle / 2);
  return to_rotation({std::cos(angle / 2), a.x * s, a.y * s, a.z * s});
}

void expect_near(const Vec3d& a, const Vec3d& b, double tolerance, const char* what = "") {
  EXPECT_LE(length(a - b), tolerance) << what << ": " << a.x << " " << a.y << " " << a.z
                                      << " against " << b.x << " " << b.y << " " << b.z;
}

TEST(CameraPaths, QuaternionsAreRotations) {
  // A turn about z by a right angle takes x to y.
  expect_near(turn({0, 0, 1}, std::numbers::pi / 2) * Vec3d{1, 0, 0}, {0, 1, 0}, 1e-15);
  expect_near(turn({1, 0, 0}, std::numbers::pi / 2) * Vec3d{0, 1, 0}, {0, 0, 1}, 1e-15);
  // There and back, half turns included (each of the four branches).
  for (const Vec3d axis : {Vec3d{1, 0, 0}, Vec3d{0, 1, 0}, Vec3d{0, 0, 1}, Vec3d{1, 2, 3},
                           Vec3d{-3, 1, 0.1}, Vec3d{0.1, -1, 3}})
    for (const double angle :
         {0.0, 1e-9, 0.3, 2.0, std::numbers::pi - 1e-9, std::numbers::pi, 4.0}) {
      const Mat3d r = turn(axis, angle);
      EXPECT_LT(orthonormality_error(r), 1e-14);
      EXPECT_LT(rotation_angle(r, to_rotation(to_quaternion(r))), 1e-7);
    }
  EXPECT_NEAR(rotation_angle(turn({1, 1, 0}, 0.25), turn({1, 1, 0}, 1.5)), 1.25, 1e-12);
}

TEST(CameraPaths, SlerpTurnsEvenlyTheShorterWay) {
  const Quaternion a = to_quaternion(turn({0, 0, 1}, 0.2));
  Quaternion b = to_quaternion(turn({0, 0, 1}, 1.2));
  for (int sign : {1, -1}) {
    b = {sign * b.w, sign * b.x, sign * b.y, sign * b.z};
    for (const double u : {0.0, 0.25, 1.0})
      EXPECT_LT(rotation_angle(to_rotation(slerp(a, b, u)), turn({0, 0, 1}, 0.2 + u)), 1e-7);
  }
  // Equal and opposite quaternions stay finite.
  EXPECT_LT(rotation_angle(to_rotation(slerp(a, {-a.w, -a.x, -a.y, -a.z}, 0.5)), to_rotation(a)),
            1e-7);
}

TEST(CameraPaths, OrthonormalityErrorSeesScaleMirrorsAndNan) {
  Mat3d r = turn({1, 2, 3}, 0.7);
  EXPECT_LT(orthonormality_error(r), 1e-14);
  Mat3d mirrored = r;
  mirrored.set_column(0, -r.column(0));
  EXPECT_TRUE(std::isinf(orthonormality_error(mirrored)));
  Mat3d scaled = r;
  scaled.set_column(0, r.column(0) * 1.1);
  EXPECT_NEAR(
      orthonormality_error(scaled),
      0.21 * std::pow(std::max({std::abs(r.m[0][0]), std::abs(r.m[1][0]), std::abs(r.m[2][0])}), 2),
      1e-12);
  r.m[1][2] = std::nan("");
  EXPECT_TRUE(std::isinf(orthonormality_error(r)));
  EXPECT_LT(orthonormality_error(orthonormalized(scaled)), 1e-14);
  expect_near(orthonormalized(scaled).column(2), scaled.column(2), 1e-14);
}

TEST(CameraPaths, LookRotationIsLevelAndUpright) {
  const Mat3d ahead = look_rotation({0, 2, 0}, {0, 0, 1});
  expect_near(ahead.column(0), {1, 0, 0}, 1e-15, "right");
  expect_near(ahead.column(1), {0, 0, -1}, 1e-15, "down");
  expect_near(ahead.column(2), {0, 1, 0}, 1e-15, "forward");
  for (const Vec3d forward :
       {Vec3d{1, 2, 3}, Vec3d{-1, 0.5, -9}, Vec3d{0, 0, 1}, Vec3d{0, 0, -2}}) {
    const Mat3d r = look_rotation(forward, {0, 0, 1});
    EXPECT_LT(orthonormality_error(r), 1e-14);
    EXPECT_NEAR(r.column(0).z, 0, 1e-15);
    EXPECT_LE(r.column(1).z, 1e-15);
    expect_near(r.column(2), normalized(forward), 1e-15);
  }
}

TEST(CameraPaths, AxesMeetAtTheirPoint) {
  const Vec3d target{1e6, -2e6, 3};  // far from the world's origin
  std::vector<Pose> cameras;
  for (int i = 0; i < 5; ++i) {
    const Vec3d position = target + Vec3d{std::cos(i * 1.0), std::sin(i * 1.0), 0.3 * i};
    cameras.push_back({look_rotation(target - position, {0, 0, 1}), position});
  }
  const auto point = nearest_point_to_axes(cameras);
  ASSERT_TRUE(point);
  expect_near(*point, target, 1e-6);
}

TEST(CameraPaths, ParallelAxesHaveNoPoint) {
  std::vector<Pose> cameras;
  for (int i = 0; i < 6; ++i)
    cameras.push_back({turn({0, 1, 0}, 0.01 * (i % 2)), {static_cast<double>(i), 0, 0}});
  EXPECT_FALSE(nearest_point_to_axes(cameras));
  EXPECT_FALSE(nearest_point_to_axes(std::span(cameras).first(1)));
  EXPECT_FALSE(nearest_point_to_axes({}));
  cameras[0].translation.x = std::nan("");
  cameras[1].rotation = turn({0, 1, 0}, 1);
  EXPECT_FALSE(nearest_point_to_axes(cameras));
}

TEST(CameraPaths, Quantile) {
  EXPECT_EQ(quantile({3, 1, 2}, 0), 1);
  EXPECT_EQ(quantile({3, 1, 2}, 1), 3);
  EXPECT_EQ(quantile({4, 1, 2, 3}, 0.5), 2.5);
  EXPECT_EQ(quantile({7}, 0.9), 7);
}

TEST(CameraPaths, CoveredArcTakesTheWidestGapOut) {
  const double gap = 150 * std::numbers::pi / 180;
  const Arc arc = covered_arc({-0.5, 6.5, 0.1}, gap);  // 6.5 is 0.217 after a whole turn
  EXPECT_FALSE(arc.full);
  EXPECT_NEAR(std::cos(arc.middle), std::cos((-0.5 + 6.5 - 2 * std::numbers::pi) / 2), 1e-12);
  EXPECT_NEAR(std::sin(arc.middle), std::sin((-0.5 + 6.5 - 2 * std::numbers::pi) / 2), 1e-12);
  EXPECT_NEAR(arc.half_width, (6.5 - 2 * std::numbers::pi + 0.5) / 2, 1e-12);
  EXPECT_TRUE(covered_arc({0, 2, 4}, gap).full);
  EXPECT_NEAR(covered_arc({1}, gap).half_width, 0, 1e-12);
  EXPECT_NEAR(covered_arc({1}, gap).middle, 1, 1e-12);
  EXPECT_TRUE(covered_arc({}, gap).full);
}

TEST(CameraPaths, ConstantSpeedSpacesEvenly) {
  // A circle run through unevenly, and an uneven line.
  const PoseCurve circle{[](double u) {
                           const double angle = 2 * std::numbers::pi * u * u;
                           return Pose{{}, {std::cos(angle), std::sin(angle), 0}};
                         },
                         0};
  const auto closed = constant_speed_parameters(circle, 12, true);
  ASSERT_EQ(closed.size(), 12u);
  EXPECT_EQ(closed.front(), 0);
  for (size_t i = 0; i < closed.size(); ++i) {
    const double next = i + 1 < closed.size() ? closed[i + 1] : 1.0;
    EXPECT_NEAR(length(circle.at(next).translation - circle.at(closed[i]).translation),
                2 * std::sin(std::numbers::pi / 12), 1e-4)
        << i;
  }
  const auto open = constant_speed_parameters(circle, 5, false);
  EXPECT_EQ(open.front(), 0);
  EXPECT_NEAR(open.back(), 1, 1e-12);
  EXPECT_NEAR(open[2], std::sqrt(0.5), 1e-4);
  // Turning counts too; standing still gives no division by zero.
  const PoseCurve turning{[](double u) { return Pose{turn({0, 0, 1}, u * u), {}}; }, 2.0};
  EXPECT_NEAR(constant_speed_parameters(turning, 3, false)[1], std::sqrt(0.5), 1e-3);
  const PoseCurve still{[](double) { return Pose{}; }, 1.0};
  EXPECT_EQ(constant_speed_parameters(still, 1, false).size(), 1u);
  EXPECT_EQ(constant_speed_parameters(still, 3, false).size(), 3u);
  EXPECT_TRUE(constant_speed_parameters(still, 0, false).empty());
}

std::vector<Pose> keys() {
  std::vector<Pose> poses;
  for (int i = 0; i < 6; ++i)
    poses.push_back({turn({0.2, 1, 0.1 * i}, 0.5 * i * i * 0.3),
                     {std::cos(i * 0.9) * 2, i * 0.5, std::sin(i * 1.7)}});
  return poses;
}

TEST(PoseSpline, PassesThroughItsKeysAndStaysRigid) {
  const auto poses = keys();
  const PoseSpline spline(poses, 0.5);
  ASSERT_EQ(spline.distinct_keys(), 6);
  double previous = -1;
  int found = 0;
  for (int i = 0; i <= 60000; ++i) {
    const double u = i / 60000.0;
    const Pose p = spline.at(u);
    ASSERT_LT(orthonormality_error(p.rotation), 1e-12);
    const auto [key, next, fraction] = spline.place_of(u);
    ASSERT_EQ(next, key + 1);
    EXPECT_GE(key + fraction, previous - 1e-12);
    previous = key + fraction;
    if (found < 6 && length(p.translation - poses[found].translation) < 1e-3 &&
        rotation_angle(p.rotation, poses[found].rotation) < 1e-3)
      ++found;
  }
  EXPECT_EQ(found, 6);
  EXPECT_NEAR(previous, 5, 1e-9);
  expect_near(spline.at(0).translation, poses.front().translation, 1e-12);
  expect_near(spline.at(1).translation, poses.back().translation, 1e-12);
  EXPECT_LT(rotation_angle(spline.at(1).rotation, poses.back().rotation), 1e-7);
  expect_near(spline.at(7).translation, poses.back().translation, 1e-12);
}

TEST(PoseSpline, VelocityDoesNotJumpAtKeys) {
  const auto poses = keys();
  const PoseSpline spline(poses, 0.5);
  const double h = 1e-5;  // a jump would be some tenths and more, a smooth change some 1e-3
  Vec3d before = (spline.at(h).translation - spline.at(0).translation) / h;
  double before_turn = rotation_angle(spline.at(0).rotation, spline.at(h).rotation) / h;
  double worst = 0, worst_turn = 0;
  for (double u = h; u + h < 1; u += h) {
    const Vec3d v = (spline.at(u + h).translation - spline.at(u).translation) / h;
    const double t = rotation_angle(spline.at(u).rotation, spline.at(u + h).rotation) / h;
    worst = std::max(worst, length(v - before));
    worst_turn = std::max(worst_turn, std::abs(t - before_turn));
    before = v;
    before_turn = t;
  }
  EXPECT_LT(worst, 0.01);
  EXPECT_LT(worst_turn, 0.01);
}

TEST(PoseSpline, DegenerateKeys) {
  const Pose a{turn({0, 0, 1}, 0.3), {1, 2, 3}};
  const Pose b{turn({0, 0, 1}, 0.3 + std::numbers::pi),
               {1, 2, 3}};  // same place, opposite direction
  const std::vector<Pose> same{a, a, a};
  const PoseSpline still(same, 1);
  EXPECT_EQ(still.distinct_keys(), 1);
  expect_near(still.at(0.5).translation, a.translation, 0);
  const std::vector<Pose> repeated{a, a, b, b, a};
  const PoseSpline spline(repeated, 1);
  EXPECT_EQ(spline.distinct_keys(), 3);
  EXPECT_EQ(spline.place_of(0.75).key, 2);
  EXPECT_EQ(spline.place_of(0.75).next, 4);
  for (int i = 0; i <= 1000; ++i) {
    const Pose p = spline.at(i / 1000.0);
    ASSERT_LT(orthonormality_error(p.rotation), 1e-9) << i;
    expect_near(p.translation, a.translation, 1e-12);
  }
}

TEST(PoseSpline, CollinearKeysStayOnTheirLine) {
  std::vector<Pose> poses;
  for (const double x : {0.0, 1.0, 1.1, 5.0, 5.01, 9.0}) poses.push_back({Mat3d{}, {x, 0, 0}});
  const PoseSpline spline(poses, 1);
  double previous = -1e-9;
  for (int i = 0; i <= 1000; ++i) {
    const Vec3d p = spline.at(i / 1000.0).translation;
    EXPECT_EQ(p.y, 0);
    EXPECT_GE(p.x, previous - 1e-9) << "a centripetal curve makes no loop";
    previous = p.x;
  }
}

}  // namespace
}  // namespace nerf
