// Surfaces of volumes: closed whatever the values, and where closed forms say they are.
#include "nerf/geometry/marching_cubes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "geometry/mesh_measures.h"
#include "nerf/math/random.h"

namespace nerf {
namespace {

// All blocks, every sample known: value(position).
template <class Value>
VoxelVolume filled(const VoxelLattice& lattice, const Value& value) {
  VoxelVolume volume(lattice);
  volume.allocate(std::vector<uint8_t>(static_cast<size_t>(volume.block_count()), 1));
  for (auto& block : volume.blocks())
    for (int s = 0; s < VoxelVolume::kSamples; ++s) {
      const int i = block.at[0] * 8 + s % 8, j = block.at[1] * 8 + s / 8 % 8,
                k = block.at[2] * 8 + s / 64;
      if (i >= lattice.samples[0] || j >= lattice.samples[1] || k >= lattice.samples[2]) continue;
      block.value[static_cast<size_t>(s)] =
          static_cast<float>(value(lattice.position(i, j, k), i, j, k));
      block.weight[static_cast<size_t>(s)] = 1;
    }
  return volume;
}

VoxelLattice unit_lattice(int resolution) {
  return VoxelLattice::around({{-1, -1, -1}, {1, 1, 1}}, resolution);
}

TEST(MarchingCubes, ClosesWhateverTheSigns) {
  ThreadPool pool(2);
  for (uint64_t seed = 0; seed < 4; ++seed) {
    const VoxelLattice lattice = unit_lattice(18);
    const auto border = [&](int a, size_t k) { return a == 0 || a == lattice.samples[k] - 1; };
    const VoxelVolume volume = filled(lattice, [&](const Vec3d&, int i, int j, int k) {
      if (border(i, 0) || border(j, 1) || border(k, 2)) return 1.0;
      Random random(seed, 0, static_cast<uint64_t>((k * 100 + j) * 100 + i));
      return static_cast<double>(random.uniform()) - 0.3 - 0.1 * static_cast<double>(seed);
    });
    const TriangleMesh mesh = marching_cubes(volume, pool);
    EXPECT_GT(mesh.triangles.size(), 5000u);
    // Each directed edge once, and its opposite once: closed, with one outside.
    std::map<std::pair<uint32_t, uint32_t>, int> edges;
    for (const auto& t : mesh.triangles)
      for (size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
    int wrong = 0;
    for (const auto& [edge, count] : edges) {
      const auto back = edges.find({edge.second, edge.first});
      wrong += count != 1 || back == edges.end() || back->second != 1;
    }
    EXPECT_EQ(wrong, 0);
  }
}

TEST(MarchingCubes, FindsASphere) {
  ThreadPool pool(2);
  constexpr double kRadius = 0.7;
  const VoxelLattice lattice = unit_lattice(60);
  const TriangleMesh mesh = marching_cubes(
      filled(lattice, [&](const Vec3d& p, int, int, int) { return length(p) - kRadius; }), pool);
  for (const Vec3& p : mesh.positions)
    ASSERT_NEAR(length(p.cast<double>()), kRadius, lattice.spacing * lattice.spacing);
  EXPECT_NEAR(test::area(mesh), 4 * std::numbers::pi * kRadius * kRadius, 0.02);
  // By the divergence theorem: positive where triangles are counterclockwise from outside.
  EXPECT_NEAR(test::volume(mesh), 4.0 / 3 * std::numbers::pi * std::pow(kRadius, 3), 0.01);
}

TEST(MarchingCubes, HasTheSameBitsForAnyThreads) {
  const VoxelVolume volume = filled(unit_lattice(40), [&](const Vec3d& p, int, int, int) {
    return std::sin(7 * p.x) + std::sin(8 * p.y) + std::sin(9 * p.z);
  });
  ThreadPool one(1), two(2);
  const TriangleMesh a = marching_cubes(volume, one), b = marching_cubes(volume, two);
  EXPECT_GT(a.triangles.size(), 1000u);
  EXPECT_EQ(a.positions, b.positions);
  EXPECT_EQ(a.triangles, b.triangles);
}

TEST(MarchingCubes, LeavesOutWhatIsNotKnown) {
  ThreadPool pool(1);
  VoxelVolume volume =
      filled(unit_lattice(30), [&](const Vec3d& p, int, int, int) { return p.x - 0.01; });
  const size_t whole = marching_cubes(volume, pool).triangles.size();
  for (auto& block : volume.blocks())
    for (int s = 0; s < VoxelVolume::kSamples; ++s)
      if (block.at[1] * 8 + s / 8 % 8 > 16) block.weight[static_cast<size_t>(s)] = 0;
  const TriangleMesh half = marching_cubes(volume, pool);
  EXPECT_EQ(half.triangles.size(), whole / 2);
  for (const Vec3& p : half.positions) EXPECT_LT(p.y, 0.01);
}

}  // namespace
}  // namespace nerf
