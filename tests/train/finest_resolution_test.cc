// How fine a hash grid is that the options leave open.
#include "train/finest_resolution.h"

#include <gtest/gtest.h>

#include <cmath>

#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

// Cells across [-1, 1] that are a pixel wide at the origin, as a camera sees it from there.
double pixels_across(int size, double distance) {
  const double focal = 0.5 * size / std::tan(0.5 * test::kFieldOfView);
  return 2 * focal / distance;
}

int resolved_resolution(const GridOptions& options, const test::SyntheticCapture& c) {
  return resolved(options, c.scene, c.photos).finest_resolution;
}

TEST(FinestResolution, CellsAreAPixelWide) {
  for (const int size : {48, 96, 192})
    EXPECT_NEAR(resolved_resolution({}, test::sphere_capture(3, size)),
                pixels_across(size, test::kCameraDistance), 1.0)
        << size;
}

TEST(FinestResolution, FollowsTheMedianCamera) {
  auto c = test::sphere_capture(7, 96);
  ASSERT_EQ(c.scene.train, (std::vector<int>{1, 2, 3, 5, 6}));
  // One camera much closer and one inside of things are fewer than the others.
  c.scene.views[1].pose.translation = c.scene.views[1].pose.translation * 0.4;
  c.scene.views[2].pose.translation = Vec3d{0, 0, 0};
  EXPECT_NEAR(resolved_resolution({}, c), pixels_across(96, test::kCameraDistance), 1.0);
  for (View& view : c.scene.views) view.pose.translation = view.pose.translation * 0.5;
  EXPECT_NEAR(resolved_resolution({}, c), pixels_across(96, 0.5 * test::kCameraDistance), 1.0);
  // One that stands in the middle sees what is a quarter away.
  for (View& view : c.scene.views) view.pose.translation = Vec3d{0, 0, 0};
  EXPECT_NEAR(resolved_resolution({}, c), pixels_across(96, 0.25), 1.0);
}

TEST(FinestResolution, StaysWithinItsLimits) {
  const auto c = test::sphere_capture(3, 16);  // 14.6 cells
  GridOptions options;
  EXPECT_EQ(resolved_resolution(options, c), options.base_resolution);
  options.base_resolution = 10;
  EXPECT_EQ(resolved_resolution(options, c), 15);
  auto near = test::sphere_capture(3, 96);
  for (View& view : near.scene.views) view.pose.translation = view.pose.translation * 1e-3;
  for (Camera& camera : near.photos.cameras) camera.params[0] = camera.params[1] = 1e5;
  EXPECT_EQ(resolved_resolution(options, near), GridOptions::kFinestUnbounded);
}

TEST(FinestResolution, WhatIsGivenStays) {
  const auto c = test::sphere_capture(3, 96);
  GridOptions options;
  options.finest_resolution = 77;
  EXPECT_EQ(resolved_resolution(options, c), 77);
}

TEST(FinestResolution, OfAnUnboundedSceneIsFixed) {
  auto c = test::sphere_capture(3, 96);
  c.scene.unbounded = true;
  EXPECT_EQ(resolved_resolution({}, c), GridOptions::kFinestUnbounded);
}

TEST(FinestResolution, IsThatOfTheModel) {
  const auto c = test::sphere_capture(3, 96);
  TrainOptions options = test::tiny_options(1);
  options.grid.finest_resolution = 0;
  ThreadPool pool(1);
  const Trainer trainer(c.scene, c.photos, options, pool);
  EXPECT_EQ(trainer.snapshot().grid().options.finest_resolution,
            resolved_resolution(options.grid, c));
  EXPECT_EQ(trainer.options().grid.finest_resolution, 0) << "the run's options stay as given";
}

}  // namespace
}  // namespace nerf
