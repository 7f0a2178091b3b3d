// Pictures of a medium of known density against closed forms.
#include "nerf/model/renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "nerf/model/grid_field.h"
#include "nerf/model/radiance_field.h"

namespace nerf {
namespace {

// Density exp(0) = 1 per engine unit everywhere in [-1, 1]^3, or where x > 0 alone; colour
// sigmoid(0).
// `level` is what the cache says of each cell.
RadianceField homogeneous_field(const Similarity& to_engine, bool half_empty = false,
                                uint8_t level = 30) {
  GridOptions options;
  options.levels = 1;
  options.log2_entries = 10;
  options.base_resolution = 4;
  options.hidden = 16;
  options.occupancy_side = 32;
  auto grid = std::make_shared<GridField>(options, /*unbounded=*/false, 1);
  std::vector<uint8_t> levels(grid->occupancy.levels().size(), level);
  for (size_t i = 0; half_empty && i < levels.size(); ++i)
    if (grid->occupancy.cell_corner(static_cast<int64_t>(i), 0).x < 0) levels[i] = 0;
  grid->occupancy.set_levels(levels);
  ModelInfo info;
  info.to_engine = to_engine;
  info.near = 1e-3;
  return RadianceField(std::move(info), std::move(grid));
}

Similarity tilted() {
  const double a = 0.5, b = 0.7;
  Mat3d turn, tilt;
  turn.m = {{{std::cos(a), -std::sin(a), 0}, {std::sin(a), std::cos(a), 0}, {0, 0, 1}}};
  tilt.m = {{{1, 0, 0}, {0, std::cos(b), -std::sin(b)}, {0, std::sin(b), std::cos(b)}}};
  Similarity s;
  s.rotation = turn * tilt;
  s.center = {3, -1, 2};
  s.scale = 0.25;
  return s;
}

// Length of a ray inside a box by slabs, in double.
double length_inside(const Vec3d& origin, const Vec3d& direction, const Box3& box) {
  double t0 = 0, t1 = 1e30;
  for (int i = 0; i < 3; ++i) {
    const double a = (box.min[i] - origin[i]) / direction[i];
    const double b = (box.max[i] - origin[i]) / direction[i];
    t0 = std::max(t0, std::min(a, b));
    t1 = std::min(t1, std::max(a, b));
  }
  return std::max(t1 - t0, 0.0);
}

// Opacity 1 - exp(-density * length) of the part of each ray inside the box, whose axes are the
// input's although the engine's are turned against them: nothing is drawn outside it.
TEST(Render, BoxOfTheOptionsKeepsTheInputsAxes) {
  const Similarity to_engine = tilted();
  const RadianceField field = homogeneous_field(to_engine);
  Camera camera;
  camera.model = CameraModel::kPinhole;
  camera.width = 40;
  camera.height = 30;
  camera.params = {40, 40, 20, 15};
  Pose pose;  // from 9 units before the centre, along z
  pose.translation = to_engine.center + Vec3d{0.3, -0.2, -9};
  RenderOptions options;
  // Small enough to lie inside the engine's cube at any angle: half its sides are 4 units.
  options.bbox = Box3{to_engine.center + Vec3d{-2, -1.5, -2}, to_engine.center + Vec3d{1, 1, 1.5}};
  ThreadPool pool(2);
  const Frame frame = render(field, camera, pose, options, pool);
  int inside = 0, outside = 0;
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const Vec3d direction = normalized(*unproject(camera, {x + 0.5, y + 0.5}));
      const double length = length_inside(pose.translation, direction, *options.bbox);
      const double want = 1 - std::exp(-length * to_engine.scale);
      const double got = frame.alpha[static_cast<size_t>(y * camera.width + x)];
      // Float positions of about 3 engine units, up to 48 samples.
      EXPECT_NEAR(got, want, 2e-5) << "pixel " << x << ' ' << y;
      (length > 0 ? inside : outside)++;
    }
  EXPECT_GT(inside, 100);
  EXPECT_GT(outside, 100);
}

// What is left without colour is missing from a pixel, never more of it than the option says.
TEST(Render, LightLeftWithoutColourIsBounded) {
  const RadianceField field = homogeneous_field(Similarity());
  Camera camera;
  camera.model = CameraModel::kPinhole;
  camera.width = camera.height = 40;
  camera.params = {30, 30, 20, 20};
  Pose pose;
  pose.translation = {0.1, -0.2, -3};
  ThreadPool pool(2);
  RenderOptions whole, part;
  whole.background = part.background = {0, 0, 0};
  whole.unshaded = 0;
  part.unshaded = 0.125f;
  const Frame a = render(field, camera, pose, whole, pool);
  const Frame b = render(field, camera, pose, part, pool);
  EXPECT_EQ(a.alpha, b.alpha);
  EXPECT_EQ(a.depth_z, b.depth_z);
  float most = 0;
  for (size_t i = 0; i < a.rgb.size(); ++i) {
    EXPECT_NEAR(a.rgb[i], 0.5f * a.alpha[i / 3], 1e-6f);  // the colour is a half everywhere
    const float missing = a.rgb[i] - b.rgb[i];
    EXPECT_GE(missing, -1e-6f);
    EXPECT_LE(missing, 0.5f * part.unshaded + 1e-6f);
    most = std::max(most, missing);
  }
  EXPECT_GT(most, 0.02f);  // something was left out
}

// Each switch saves work of the kind that it is for, and the counts do not depend on threads.
TEST(Render, CountsTheWorkThatEachSwitchSaves) {
  // The cache says that a cell stops 0.6 of the light: the stop is reached within the box.
  const RadianceField field = homogeneous_field(Similarity(), /*half_empty=*/false, 200);
  Camera camera;
  camera.model = CameraModel::kPinhole;
  camera.width = camera.height = 40;
  camera.params = {30, 30, 20, 20};
  Pose pose;
  pose.translation = {0.1, -0.2, -3};
  ThreadPool one(1), two(2);
  const auto work = [&](const RenderOptions& o) {
    const RenderStatistics a = render(field, camera, pose, o, one).statistics;
    const RenderStatistics b = render(field, camera, pose, o, two).statistics;
    EXPECT_EQ(a.rays, b.rays);
    EXPECT_EQ(a.segments, b.segments);
    EXPECT_EQ(a.density_evaluations, b.density_evaluations);
    EXPECT_EQ(a.colour_evaluations, b.colour_evaluations);
    EXPECT_EQ(a.rays, camera.width * camera.height);
    return a;
  };
  RenderOptions off;
  off.unclipped = true;
  off.unshaded = 0;
  const RenderStatistics all = work(off);
  EXPECT_EQ(all.density_evaluations, 4 * all.segments);
  EXPECT_EQ(all.colour_evaluations, all.density_evaluations);

  RenderOptions unshaded = off;
  unshaded.unshaded = 0.125f;
  EXPECT_EQ(work(unshaded).density_evaluations, all.density_evaluations);
  EXPECT_LT(work(unshaded).colour_evaluations, all.colour_evaluations);

  RenderOptions cache = off;
  cache.unclipped = false;
  cache.min_transmittance = 0;
  const RenderStatistics cached = work(cache);
  EXPECT_EQ(cached.segments, all.segments);
  EXPECT_LT(cached.density_evaluations, all.density_evaluations);
  EXPECT_EQ(cached.colour_evaluations, cached.density_evaluations);

  RenderOptions stop = cache;
  stop.min_transmittance = 1e-6f;
  const int64_t stopped = work(stop).segments;
  EXPECT_LT(stopped, cached.segments);
  stop.min_transmittance = 1e-4f;
  EXPECT_LT(work(stop).segments, stopped);

  RenderOptions few = cache;
  few.sample_factor = 0.5f;
  EXPECT_LT(work(few).density_evaluations, cached.density_evaluations);
}

// Density 1 per engine unit is `scale` per input unit, whatever the direction; sigmoid(0) is a
// half.
TEST(Query, GivesDensityPerInputUnitAndNoneOutside) {
  const Similarity to_engine = tilted();
  ASSERT_EQ(to_engine.scale, 0.25);
  const RadianceField field = homogeneous_field(to_engine);
  // More points than fit into one chunk, alternately inside [-1, 1]^3 and outside.
  std::vector<Vec3d> points, directions;
  for (int i = 0; i < 2 * kChunkSamples + 3; ++i) {
    const double a = 0.1 * i, at = i % 2 == 0 ? 0.99 : 1.01;
    points.push_back(to_engine.apply_inverse(Vec3d{at * std::cos(a), i % 3 == 0 ? at : -at, at}));
    directions.push_back(normalized(Vec3d{std::sin(a), std::cos(a), 0.3}));
  }
  std::vector<float> density(points.size()), rgb(3 * points.size());
  ThreadPool pool(2);
  field.query(points, directions, density, rgb, pool);
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(density[i], i % 2 == 0 ? 0.25f : 0.0f) << i;
    for (size_t k = 0; k < 3; ++k) EXPECT_EQ(rgb[3 * i + k], 0.5f) << i;
  }
}

TEST(Query, IsEmptyInCellsThatAreKnownToBe) {
  const RadianceField field = homogeneous_field(Similarity(), /*half_empty=*/true);
  std::vector<Vec3d> points;
  for (int i = 0; i < 40; ++i) points.push_back({(i + 0.5) / 20 - 1, 0.3, 0.01 * i});
  const std::vector<Vec3d> directions(points.size(), Vec3d{0, 0, 1});
  std::vector<float> density(points.size()), rgb(3 * points.size());
  ThreadPool pool(1);
  field.query(points, directions, density, rgb, pool);
  for (size_t i = 0; i < points.size(); ++i) EXPECT_EQ(density[i], points[i].x > 0 ? 1 : 0) << i;
}

// A picture of rays n x n to a pixel is the larger one's means; and by itself one is taken where
// pixels are as wide as the photos' were, or narrower.
TEST(Render, SupersamplingAveragesALargerPicture) {
  const Similarity to_engine = tilted();
  RadianceField field = homogeneous_field(to_engine);
  Camera camera;
  camera.model = CameraModel::kPinhole;
  camera.width = 20;
  camera.height = 14;
  camera.params = {20, 22, 10, 7};
  Pose pose;
  pose.translation = to_engine.center + Vec3d{0.3, -0.2, -9};
  ThreadPool pool(2);
  RenderOptions one, three;
  one.supersample = 1;
  three.supersample = 3;
  three.background = one.background = {0.2f, 0.9f, 0.4f};
  const Frame large = render(field, camera.scaled_to(60, 42), pose, one, pool);
  const Frame mean = render(field, camera, pose, three, pool);
  ASSERT_EQ(mean.width, 20);
  ASSERT_EQ(mean.height, 14);
  int edges = 0;
  for (int y = 0; y < 14; ++y)
    for (int x = 0; x < 20; ++x) {
      double alpha = 0, red = 0;
      std::vector<float> depths;
      for (int i = 0; i < 9; ++i) {
        const size_t at = static_cast<size_t>((3 * y + i / 3) * 60 + 3 * x + i % 3);
        alpha += static_cast<double>(large.alpha[at]) / 9;
        red += static_cast<double>(large.rgb[3 * at]) / 9;
        if (large.depth_z[at] > 0) depths.push_back(large.depth_z[at]);
      }
      const size_t at = static_cast<size_t>(y * 20 + x);
      EXPECT_NEAR(static_cast<double>(mean.alpha[at]), alpha, 1e-6);
      EXPECT_NEAR(static_cast<double>(mean.rgb[3 * at]), red, 1e-6);
      std::sort(depths.begin(), depths.end());
      EXPECT_EQ(mean.depth_z[at], depths.size() > 4 ? depths[depths.size() / 2] : 0)
          << x << ' ' << y;
      edges += alpha > 0 && !depths.empty() && depths.size() < 9;
    }
  EXPECT_GT(edges, 0);
  EXPECT_NE(render(field, camera, pose, one, pool).rgb, mean.rgb);
}

TEST(Render, SupersamplingFollowsThePhotos) {
  ModelInfo info;
  Camera camera;
  camera.model = CameraModel::kPinhole;
  camera.width = 400;
  camera.height = 300;
  camera.params = {500, 500, 200, 150};
  Pose pose;
  pose.translation = {0, 0, -3};
  EXPECT_EQ(automatic_supersampling(info, camera, pose), 1) << "nothing to compare with";
  info.views.push_back({"a", camera, pose, /*held_out=*/false, 0});
  info.views.push_back({"b", camera.scaled_to(40, 30), pose, /*held_out=*/true, 0});
  EXPECT_EQ(automatic_supersampling(info, camera, pose), 1);
  EXPECT_EQ(automatic_supersampling(info, camera.scaled_to(1600, 1200), pose), 1);
  EXPECT_EQ(automatic_supersampling(info, camera.scaled_to(200, 150), pose), 2);
  EXPECT_EQ(automatic_supersampling(info, camera.scaled_to(100, 75), pose), 4);
  EXPECT_EQ(automatic_supersampling(info, camera.scaled_to(20, 15), pose), kMostSupersampling);
  // Farther away a pixel of the same angle is wider.
  Pose far = pose;
  far.translation = {0, 0, -11};
  EXPECT_EQ(automatic_supersampling(info, camera, far), 3);
  info.to_engine.scale = 0.25;  // the same in input units is less in the engine's
  EXPECT_EQ(automatic_supersampling(info, camera, far), 2);
}

}  // namespace
}  // namespace nerf
