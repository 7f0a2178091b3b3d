// Depth of shapes with a closed form, fused: where the surface is, and what stays open.
#include "nerf/geometry/depth_fusion.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/mesh_measures.h"
#include "geometry/shapes.h"
#include "nerf/base/error.h"
#include "nerf/geometry/marching_cubes.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::kBallRadius;
using test::looking_at;
using test::plane_at;
using test::sphere_views;
using test::view_of;

VoxelLattice lattice(int resolution) {
  return VoxelLattice::around({{-1, -1, -1}, {1, 1, 1}}, resolution);
}
constexpr uint64_t kMuch = uint64_t{1} << 40;

TEST(DepthFusion, FindsASphere) {
  ThreadPool pool(2);
  const VoxelLattice grid = lattice(80);
  const VoxelVolume volume =
      fuse_depths(sphere_views(), grid, {.truncation = 4 * grid.spacing}, kMuch, pool);
  EXPECT_LT(volume.blocks().size(), static_cast<size_t>(volume.block_count()) / 2);
  const TriangleMesh mesh = marching_cubes(volume, pool);
  EXPECT_NEAR(test::area(mesh), 4 * 3.14159 * kBallRadius * kBallRadius, 0.1);
  EXPECT_LT(
      test::mean_distance(mesh, [](const Vec3d& p) { return std::fabs(length(p) - kBallRadius); }),
      0.2 * grid.spacing);
}

TEST(DepthFusion, IsAMeanByWeights) {
  ThreadPool pool(1);
  const VoxelLattice grid = lattice(40);
  // Cosines and distances alike: the mean of the planes.
  const Pose pose = looking_at({3, 0, 0}, {});
  std::vector<DepthView> views;
  for (const double x : {0.0, 0.0, 0.06}) views.push_back(view_of(plane_at(x), pose));
  const TriangleMesh mesh =
      marching_cubes(fuse_depths(views, grid, {.truncation = 4 * grid.spacing}, kMuch, pool), pool);
  ASSERT_GT(mesh.triangles.size(), 100u);
  // Behind a plane its weight falls, so that the mean is not quite a third of the way.
  EXPECT_LT(test::mean_distance(mesh, [](const Vec3d& p) { return std::fabs(p.x - 0.018); }),
            0.004);
}

TEST(DepthFusion, KnowsNothingBehindSurfacesAndOfUnknownPixels) {
  ThreadPool pool(1);
  const VoxelLattice grid = lattice(40);
  DepthView view = view_of(plane_at(0), looking_at({3, 0, 0}, {}));
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width / 2; ++x)
      view.depth[static_cast<size_t>(y * view.width + x)] = DepthView::kUnknown;
  const double truncation = 4 * grid.spacing;
  VoxelVolume volume = fuse_depths(std::span(&view, 1), grid, {truncation}, kMuch, pool);
  int known = 0;
  for (const auto& block : volume.blocks())
    for (int s = 0; s < VoxelVolume::kSamples; ++s) {
      if (!(block.weight[static_cast<size_t>(s)] > 0)) continue;
      ++known;
      const Vec3d p = volume.corner(block) +
                      Vec3d{double(s % 8), double(s / 8 % 8), double(s / 64)} * grid.spacing;
      EXPECT_GT(p.x, -truncation - 1e-6);
      EXPECT_GT(p.y, -grid.spacing);  // the picture's right half
    }
  EXPECT_GT(known, 1000);
  // Of a volume that is known everywhere nothing else stays.
  for (auto& block : volume.blocks()) block.weight.fill(1);
  carve_unseen(std::span(&view, 1), truncation, volume, pool);
  int left = 0;
  for (const auto& block : volume.blocks())
    for (const float w : block.weight) left += w > 0;
  EXPECT_EQ(left, known);
}

TEST(DepthFusion, WhatOtherViewsSeeThroughGoes) {
  ThreadPool pool(1);
  const VoxelLattice grid = lattice(40);
  // One view is wrong about a plane; four others look through it.
  std::vector<DepthView> views{view_of(plane_at(0), looking_at({3, 0, 0}, {}))};
  for (int i = 0; i < 4; ++i)
    views.push_back(view_of([](const Vec3d&, const Vec3d&) { return double{DepthView::kNothing}; },
                            looking_at({3, 0.1 * i, 0}, {})));
  const auto triangles = [&](size_t n) {
    return marching_cubes(
               fuse_depths(std::span(views.data(), n), grid, {4 * grid.spacing}, kMuch, pool), pool)
        .triangles.size();
  };
  EXPECT_GT(triangles(1), 100u);
  EXPECT_EQ(triangles(5), 0u);
}

TEST(DepthFusion, HasTheSameBitsForAnyThreads) {
  const auto views = sphere_views();
  const VoxelLattice grid = lattice(40);
  ThreadPool one(1), two(2);
  const VoxelVolume a = fuse_depths(views, grid, {0.2}, kMuch, one);
  const VoxelVolume b = fuse_depths(views, grid, {0.2}, kMuch, two);
  ASSERT_EQ(a.blocks().size(), b.blocks().size());
  for (size_t i = 0; i < a.blocks().size(); ++i) {
    EXPECT_EQ(a.blocks()[i].value, b.blocks()[i].value);
    EXPECT_EQ(a.blocks()[i].weight, b.blocks()[i].weight);
  }
}

TEST(DepthFusion, SaysThatMemoryIsShort) {
  ThreadPool pool(1);
  EXPECT_TRUE(test::contains(
      test::error_of([&] { fuse_depths(sphere_views(), lattice(80), {0.2}, 1 << 20, pool); }),
      "--resolution"));
}

TEST(MeanViewDirections, PointToTheViewsThatSee) {
  ThreadPool pool(1);
  const auto views = sphere_views();
  const std::vector<Vec3> positions{{0.7_r, 0, 0}, {0, 0, 0.7_r}, {0, 0, 0}};
  const std::vector<Vec3> normals{{1, 0, 0}, {0, 0, 1}, {0, 1, 0}};
  const auto towards = mean_view_directions(views, positions, normals, 0.02, pool);
  EXPECT_GT(towards[0].x, 0.9);
  EXPECT_GT(towards[1].z, 0.9);
  EXPECT_EQ(towards[2], (Vec3d{0, 1, 0}));  // in the middle: none sees it
}

}  // namespace
}  // namespace nerf
