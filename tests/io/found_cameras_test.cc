#include "io/found_cameras.h"

#include <gtest/gtest.h>

#include <cmath>

#include "nerf/math/camera_paths.h"
#include "nerf/math/random.h"
#include "nerf/math/refined_camera.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

constexpr int kViews = 12;

const Similarity kMoved{2.5, rotation_by({0.4, -0.9, 0.3}), {1, -2, 0.5}};

std::vector<Pose> ring(int n = kViews) {
  std::vector<Pose> poses;
  for (int i = 0; i < n; ++i) poses.push_back(ring_pose(i, n));
  return poses;
}

std::vector<Pose> moved(std::vector<Pose> poses) {
  for (Pose& pose : poses) pose = kMoved.apply(pose);
  return poses;
}

void expect_near(const Similarity& a, const Similarity& b, double bound) {
  EXPECT_NEAR(a.scale / b.scale, 1, bound);
  EXPECT_LT(rotation_angle(a.rotation, b.rotation), bound + 1e-7);
  EXPECT_LT(length(a.apply(Vec3d{0, 0, 0}) - b.apply(Vec3d{0, 0, 0})), bound * 10);
}

TEST(FoundCameras, TheSimilarityOfTwoRings) {
  const auto found = similarity_between(ring(), moved(ring()));
  ASSERT_TRUE(found.has_value());
  expect_near(*found, kMoved, 1e-12);
}

// Cameras in a row leave the turn about it to their axes.
TEST(FoundCameras, TheSimilarityOfTwoRows) {
  std::vector<Pose> row;
  for (int i = 0; i < 5; ++i) row.push_back(look_at({0.3 * i, -4, 1}, {0.3 * i, 0, 0}));
  const auto found = similarity_between(row, moved(row));
  ASSERT_TRUE(found.has_value());
  expect_near(*found, kMoved, 1e-12);
}

// A quarter of the cameras stand anywhere and look anywhere: with least squares they would shift
// the whole by a quarter of their 10 units.
TEST(FoundCameras, TheSimilarityWithoutThoseThatAreWrong) {
  Random random(3, 0, 0);
  std::vector<Pose> to = moved(ring());
  for (size_t i = 0; i < to.size(); i += 4) {
    const auto vector = [&] { return Vec3d{random.normal(), random.normal(), random.normal()}; };
    to[i].rotation = rotation_by(vector());
    to[i].translation = to[i].translation + normalized(vector()) * 10;
  }
  const auto found = similarity_between(ring(), to);
  ASSERT_TRUE(found.has_value());
  expect_near(*found, kMoved, 1e-3);
}

TEST(FoundCameras, NoSimilarityOfCamerasInOnePlace) {
  const std::vector<Pose> two = ring(2);
  EXPECT_FALSE(similarity_between(two, two).has_value());
  std::vector<Pose> turning;
  for (int i = 0; i < 5; ++i)
    turning.push_back(look_at({0.1, 0.2, 0.3}, {std::cos(i), std::sin(i), 0.3}));
  EXPECT_FALSE(similarity_between(turning, moved(turning)).has_value());
}

SceneInput capture(const std::vector<Pose>& poses, double focal) {
  SceneInput input;
  input.cameras.push_back({CameraModel::kSimplePinhole, 640, 480, {focal, 320, 240}});
  for (const Pose& pose : poses) {
    input.views.emplace_back();
    input.views.back().pose = pose;
  }
  return input;
}

TEST(FoundCameras, TakeTheGivenOnesPlaces) {
  // Given poses are half a degree off, the found ones are right but in axes of their own; the first
  // photo was not found, and found views come in another order.
  Random random(4, 0, 0);
  std::vector<Pose> given = moved(ring());
  for (Pose& pose : given) {
    const Vec3d axis{random.normal(), random.normal(), random.normal()};
    pose.rotation = rotation_by(normalized(axis) * 0.0087) * pose.rotation;
  }
  SceneInput input = capture(given, 500);
  std::vector<Pose> right = ring();
  std::reverse(right.begin(), right.end());
  right.pop_back();
  std::vector<size_t> view_of;
  for (size_t i = kViews; i-- > 1;) view_of.push_back(i);
  SceneInput found = capture(right, 510);
  found.points = {{{0.1, 0.2, 0.3}, 0.5, 2}};
  found.observations = {{0, 0}, {3, 0}};
  ASSERT_TRUE(take_found_cameras(found, view_of, input));
  EXPECT_EQ(input.views[0].camera, 0);
  EXPECT_EQ(input.views[0].pose.rotation.m, given[0].rotation.m);
  for (size_t v = 1; v < kViews; ++v) {
    EXPECT_EQ(input.cameras[static_cast<size_t>(input.views[v].camera)].fx(), 510);
    const Pose truth = kMoved.apply(ring_pose(static_cast<int>(v), kViews));
    // The mean of 11 turns of half a degree, each way: 0.0087 / sqrt(11), and as much again.
    EXPECT_LT(rotation_angle(input.views[v].pose.rotation, truth.rotation), 0.0053);
  }
  // Those that were found fit each other exactly.
  const Mat3d between = input.views[1].pose.rotation.transposed() * input.views[2].pose.rotation;
  const Mat3d truth = ring_pose(1, kViews).rotation.transposed() * ring_pose(2, kViews).rotation;
  EXPECT_LT(rotation_angle(between, truth), 1e-7);
  ASSERT_EQ(input.points.size(), 1u);
  EXPECT_LT(length(input.points[0].position - kMoved.apply(Vec3d{0.1, 0.2, 0.3})), 0.1);
  ASSERT_EQ(input.observations.size(), 2u);
  EXPECT_EQ(input.observations[0].image, 11);
  EXPECT_EQ(input.observations[1].image, 8);
  EXPECT_TRUE(any_contains(input.notes, "cameras of 11 of 12 photos were found anew"));
  // Points that the given cameras saw are replaced, those that were measured stay.
  ASSERT_TRUE(take_found_cameras(found, view_of, input));
  EXPECT_EQ(input.points.size(), 1u);
  input.points.assign(5, {});
  input.observations.clear();
  ASSERT_TRUE(take_found_cameras(found, view_of, input));
  EXPECT_EQ(input.points.size(), 5u);
  EXPECT_TRUE(input.observations.empty());
}

TEST(FoundCameras, FewDoNotReplaceMany) {
  SceneInput input = capture(moved(ring()), 500);
  const SceneInput found = capture(ring(5), 510);
  EXPECT_FALSE(take_found_cameras(found, {0, 1, 2, 3, 4}, input));
  EXPECT_EQ(input.cameras.size(), 1u);
  EXPECT_TRUE(any_contains(input.notes, "cameras of only 5 of 12 photos"));
  // Nor do those of photos of another size.
  SceneInput smaller = capture(ring(), 510);
  smaller.cameras[0].width = 320;
  std::vector<size_t> all(kViews);
  for (size_t i = 0; i < kViews; ++i) all[i] = i;
  EXPECT_FALSE(take_found_cameras(smaller, all, input));
  EXPECT_TRUE(any_contains(input.notes, "12 of them of photos that are turned"));
}

TEST(FoundCameras, PanoramasAndMissingFoldersAreErrors) {
  SceneInput input = capture(ring(), 500);
  EXPECT_NE(error_of([&] { find_cameras_anew(input, {}, {}, nullptr); }).find("folder to work in"),
            std::string::npos);
  input.cameras[0] = panorama(640, 320);
  SceneOptions options;
  options.work_folder = "unused";
  EXPECT_NE(error_of([&] {
              find_cameras_anew(input, options, {}, nullptr);
            }).find("cameras of panoramas are not found anew"),
            std::string::npos);
}

}  // namespace
}  // namespace nerf::internal
