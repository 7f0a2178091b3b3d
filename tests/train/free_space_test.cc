// Which cells the sparse points show as empty, beside a scene small enough to say it by hand.
#include "train/free_space.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace nerf {
namespace {

// Cameras on the x axis that look along +y at a wall of points at y = 0.8, in engine coordinates.
struct Capture {
  Scene scene;
  PhotoSet photos;

  explicit Capture(int cameras, double spacing = 0.05) {
    scene.unbounded = true;
    scene.near = 0.01;
    scene.far = 4;
    Camera camera;
    camera.width = camera.height = 100;
    camera.params = {100, 100, 50, 50};
    scene.cameras = {camera};
    for (int i = 0; i < cameras; ++i) {
      View view;
      view.pose.rotation.m = {{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}};
      view.pose.translation = {spacing * i + 0.011, -0.5, 0.013};
      scene.views.push_back(view);
      scene.train.push_back(i);
      photos.cameras.push_back(camera);
      photos.photos.emplace_back();
    }
  }
  void see(int view, const Vec3d& p, int views = 2) {
    scene.observations.push_back({view, static_cast<int32_t>(scene.points.size())});
    scene.points.push_back({p, 0.5, views});
  }
  // Points behind 0.52 whose lines of sight are a cell or two apart at y = 0.1 and beyond; too few
  // to tell a near distance.
  void see_bundle(int view) {
    for (int i = 0; i < 16; ++i)
      see(view, {0.011 + 0.08 * (i % 4 - 1.5), 0.7, 0.013 + 0.08 * (i / 4 - 1.5)});
  }
  // A wall that every camera sees, so that each has enough points to tell its near distance.
  void add_wall() {
    for (size_t v = 0; v < scene.views.size(); ++v)
      for (int i = 0; i < 25; ++i)
        see(static_cast<int>(v), {0.2 * (i % 5 - 2), 0.8, 0.2 * (i / 5 - 2)});
  }
};

OccupancyGrid carved(const Capture& c, int threads = 1) {
  OccupancyGrid grid(2, 64);
  ThreadPool pool(threads);
  switch_off_free_space(c.scene, c.photos, pool, grid);
  return grid;
}

bool off(const OccupancyGrid& grid, const Vec3& p) {
  const int c = grid.cascade_of(p);
  return grid.is_off(c, grid.cell_of(p, c));
}

TEST(FreeSpace, TwoLinesOfSightEmptyACellAndOneDoesNot) {
  Capture c(2, 0);  // both from one place
  c.see_bundle(0);
  EXPECT_FALSE(off(carved(c), {0.011_r, 0.1_r, 0.013_r}));
  c.see_bundle(1);
  const OccupancyGrid grid = carved(c);
  EXPECT_TRUE(off(grid, {0.011_r, 0.1_r, 0.013_r}));
  EXPECT_FALSE(off(grid, {0.211_r, 0.1_r, 0.013_r}));  // beside the lines
  // The last 15 % of the way are the surface's: from -0.5 to 0.7 that is behind 0.52. The rim of
  // what lines cross stays too.
  EXPECT_TRUE(off(grid, {0.011_r, 0.42_r, 0.013_r}));
  EXPECT_FALSE(off(grid, {0.011_r, 0.56_r, 0.013_r}));
}

TEST(FreeSpace, WhatIsEmptyAtSomeMomentsOnlyStays) {
  Capture c(3, 0);
  c.see_bundle(0);
  c.see_bundle(1);
  const Vec3 p{0.011_r, 0.1_r, 0.013_r};
  EXPECT_TRUE(off(carved(c), p));
  c.scene.views[1].time = 0.1;
  EXPECT_TRUE(off(carved(c), p));  // a line of sight at either of two moments
  c.scene.views[2].time = 1;       // and of none at the third
  EXPECT_FALSE(off(carved(c), p));
  c.see_bundle(2);
  EXPECT_TRUE(off(carved(c), p));
}

TEST(FreeSpace, AllMomentsOfOneCameraOnItsWayAreOne) {
  Capture c(12, 0.001);
  for (size_t v = 0; v < c.scene.views.size(); ++v)
    c.scene.views[v].time = static_cast<double>(v) / 11;
  c.see_bundle(0);
  c.see_bundle(1);
  const Vec3 p{0.011_r, 0.1_r, 0.013_r};
  EXPECT_TRUE(off(carved(c), p));
  for (size_t v = 1; v < c.scene.views.size(); v += 2)
    c.scene.views[v].pose.translation.x += 0.003;  // two cameras that take turns
  EXPECT_FALSE(off(carved(c), p));
}

TEST(FreeSpace, CellsWithAPointAndTheirNeighboursStay) {
  Capture c(2, 0);
  for (const int v : {0, 1}) c.see_bundle(v);
  c.scene.points.push_back({{0.011, 0.1, 0.013}, 0.5, 2});
  const OccupancyGrid grid = carved(c);
  const Real w = grid.cell_width(0);
  for (const int i : {-1, 0, 1})
    EXPECT_FALSE(off(grid, {0.011_r, 0.1_r + static_cast<Real>(i) * w, 0.013_r})) << i;
  EXPECT_TRUE(off(grid, {0.011_r, 0.1_r + 3 * w, 0.013_r}));
  c.scene.points.back().views = 0;  // a point cloud's: nobody says who sees it
  EXPECT_FALSE(off(carved(c), {0.011_r, 0.1_r, 0.013_r}));
  c.scene.points.back().views = 1;  // what one photo alone tells protects nothing
  EXPECT_TRUE(off(carved(c), {0.011_r, 0.1_r, 0.013_r}));
}

TEST(FreeSpace, OnlyTrainingPhotosBearWitness) {
  Capture c(3, 0);
  for (const int v : {0, 1}) c.see_bundle(v);
  c.scene.train = {0, 2};
  EXPECT_FALSE(off(carved(c), {0.011_r, 0.1_r, 0.013_r}));
}

TEST(FreeSpace, NearIsSixTenthsOfTheNearestHundredth) {
  Capture c(3);
  for (int i = 0; i < 200; ++i)  // distances 0.5, 0.505, ...; 1 % of 199 is the third
    c.see(0, c.scene.views[0].pose.translation + Vec3d{0, 0.5 + 0.005 * i, 0});
  for (int i = 0; i < 19; ++i) c.see(1, {0, 0.5, 0});  // too few to tell
  c.scene.to_engine.scale = 2;                         // what is told in engine units
  const std::vector<double> near = near_of_views(c.scene);
  EXPECT_NEAR(near[0], 2 * 0.6 * 0.51, 1e-12);
  EXPECT_EQ(near[1], c.scene.near);
  EXPECT_EQ(near[2], c.scene.near);
  c.scene.unbounded = false;  // the box says it
  EXPECT_EQ(near_of_views(c.scene)[0], c.scene.near);
}

// A photo may not recognise what stands right before it, but others saw it.
TEST(FreeSpace, NearHeedsPointsThatOthersSaw) {
  Capture c(1);
  for (int i = 0; i < 200; ++i) c.see(0, c.scene.views[0].pose.translation + Vec3d{0, 1, 0}, 3);
  const Vec3d eye = c.scene.views[0].pose.translation;
  for (int i = 0; i < 5; ++i) c.scene.points.push_back({eye + Vec3d{0, 0.3 + 0.02 * i, 0}, 0.5, 3});
  EXPECT_NEAR(near_of_views(c.scene)[0], 0.6 * 0.38, 1e-12);  // four may be wrong
  for (ScenePoint& p : c.scene.points) p.position.y = eye.y - (p.position.y - eye.y);  // behind
  EXPECT_NEAR(near_of_views(c.scene)[0], 0.6, 1e-12);
}

TEST(FreeSpace, PhotosAtOtherScalesBeginWhereTheFullOneDoes) {
  Capture c(2);
  for (int i = 0; i < 50; ++i) c.see(0, c.scene.views[0].pose.translation + Vec3d{0, 0.5, 0});
  c.scene.views[0].image_path = "a";
  c.scene.views[1].image_path = "a";
  c.scene.views[1].scale = 2;
  EXPECT_EQ(near_of_views(c.scene)[1], near_of_views(c.scene)[0]);
  EXPECT_GT(near_of_views(c.scene)[1], c.scene.near);
}

TEST(FreeSpace, TwoCamerasEmptyWhatIsNearerThanWhatTheySee) {
  Capture two(2);
  two.add_wall();
  const OccupancyGrid grid = carved(two);
  ASSERT_NEAR(near_of_views(two.scene)[0], 0.6 * std::hypot(1.3, 0.011, 0.013), 0.01);
  // Beside and behind the cameras too, but not farther than nine tenths of the way to the wall.
  EXPECT_TRUE(off(grid, {0.3_r, -0.7_r, 0.2_r}));
  EXPECT_TRUE(off(grid, {-0.7_r, -0.5_r, 0.3_r}));
  int64_t beyond = 0;
  for (int64_t i = 0; i < grid.cells(); ++i) {
    const Real w = grid.cell_width(1);
    const Vec3 p = grid.cell_corner(i, 1) + Vec3{0.5_r * w, 0.5_r * w, 0.5_r * w};
    if (!grid.is_off(1, i)) continue;
    ++beyond;
    const Vec3d eye = two.scene.views[0].pose.translation;
    // A line of sight reaches no farther than the wall, and the ball not as far.
    EXPECT_LE(length(p.cast<double>() - eye), 1.4);
  }
  EXPECT_GT(beyond, 0);

  Capture one(1);
  one.add_wall();
  EXPECT_FALSE(off(carved(one), {0.3_r, -0.7_r, 0.2_r}));
}

TEST(FreeSpace, IsTheSameForAnyNumberOfThreads) {
  Capture c(12);
  c.add_wall();
  const OccupancyGrid one = carved(c, 1), four = carved(c, 4);
  int64_t count = 0;
  for (int cascade = 0; cascade < 2; ++cascade)
    for (int64_t i = 0; i < one.cells(); ++i) {
      ASSERT_EQ(one.is_off(cascade, i), four.is_off(cascade, i));
      count += one.is_off(cascade, i);
    }
  EXPECT_GT(count, 1000);
}

TEST(FreeSpace, SaysNothingOfBoundedScenesAndWithoutPoints) {
  Capture c(2);
  c.add_wall();
  c.scene.unbounded = false;
  EXPECT_FALSE(off(carved(c), {0.3_r, -0.7_r, 0.2_r}));
  EXPECT_FALSE(off(carved(Capture(2)), {0.3_r, -0.7_r, 0.2_r}));
}

}  // namespace
}  // namespace nerf
