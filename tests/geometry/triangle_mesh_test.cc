#include "nerf/geometry/triangle_mesh.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "geometry/mesh_measures.h"
#include "nerf/geometry/marching_cubes.h"

namespace nerf {
namespace {

// Of so many steps of latitude; vertices on the unit sphere.
TriangleMesh sphere(int steps, const Vec3& centre = {}, Real radius = 1) {
  TriangleMesh mesh;
  const int around = 2 * steps;
  for (int i = 0; i <= steps; ++i)
    for (int j = 0; j < around; ++j) {
      const Real a = static_cast<Real>(std::numbers::pi * i / steps);
      const Real b = static_cast<Real>(2 * std::numbers::pi * j / around);
      mesh.positions.push_back(
          centre +
          Vec3{std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)} * radius);
    }
  const auto at = [&](int i, int j) { return static_cast<uint32_t>(i * around + j % around); };
  for (int i = 0; i < steps; ++i)
    for (int j = 0; j < around; ++j) {
      if (i > 0) mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
      if (i < steps - 1) mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
    }
  return mesh;
}

void append(const TriangleMesh& from, TriangleMesh& to) {
  const auto first = static_cast<uint32_t>(to.positions.size());
  to.positions.insert(to.positions.end(), from.positions.begin(), from.positions.end());
  for (auto t : from.triangles) {
    for (uint32_t& v : t) v += first;
    to.triangles.push_back(t);
  }
}

TEST(TriangleMesh, NormalsOfASpherePointOutwards) {
  TriangleMesh mesh = sphere(24);
  drop_unused_vertices(mesh);
  find_normals(mesh);
  ASSERT_EQ(mesh.normals.size(), mesh.positions.size());
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    EXPECT_NEAR(length(mesh.normals[v]), 1, 1e-6);
    EXPECT_GT(dot(mesh.normals[v], normalized(mesh.positions[v])), 0.98_r);
  }
}

TEST(TriangleMesh, VerticesWithoutTrianglesGo) {
  TriangleMesh mesh;
  mesh.positions = {{9, 9, 9}, {0, 0, 0}, {8, 8, 8}, {1, 0, 0}, {0, 1, 0}};
  mesh.colours = {{0, 0, 0}, {0.1_r, 0, 0}, {0, 0, 0}, {0.2_r, 0, 0}, {0.3_r, 0, 0}};
  mesh.triangles = {{1, 3, 4}};
  drop_unused_vertices(mesh);
  EXPECT_EQ(mesh.positions, (std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  EXPECT_EQ(mesh.colours[2], (Vec3{0.3_r, 0, 0}));
  EXPECT_EQ(mesh.triangles[0], (TriangleMesh::Triangle{0, 1, 2}));
}

TEST(TriangleMesh, SmallComponentsGo) {
  TriangleMesh mesh;
  append(sphere(20), mesh);
  append(sphere(4, {5, 0, 0}, 0.5_r), mesh);    // few triangles
  append(sphere(20, {0, 5, 0}, 0.01_r), mesh);  // many, but small
  append(sphere(16, {0, 0, 5}, 0.8_r), mesh);
  TriangleMesh large;
  append(sphere(20), large);
  append(sphere(16, {0, 0, 5}, 0.8_r), large);
  drop_unused_vertices(large);
  EXPECT_EQ(drop_small_components(mesh, 0.1, 0.1), 2);
  EXPECT_EQ(mesh.positions, large.positions);
  EXPECT_EQ(mesh.triangles, large.triangles);
  EXPECT_EQ(drop_small_components(mesh, 0.1, 0.1), 0);
}

TEST(TriangleMesh, DecimatedItStaysClosedAndRound) {
  TriangleMesh mesh = sphere(60);
  drop_unused_vertices(mesh);
  find_normals(mesh);
  decimate(mesh, 2000);
  EXPECT_LE(mesh.triangles.size(), 2000u);
  EXPECT_GT(mesh.triangles.size(), 1500u);
  EXPECT_EQ(mesh.normals.size(), mesh.positions.size());
  // The middle of an equilateral triangle of this area is 0.0024 below the sphere.
  constexpr double kMost = 2 * 0.0024;
  EXPECT_NEAR(test::volume(mesh), 4.0 / 3 * std::numbers::pi, 4 * std::numbers::pi * kMost);
  EXPECT_LT(test::mean_distance(mesh, [](const Vec3d& p) { return std::fabs(length(p) - 1); }),
            kMost);
}

}  // namespace
}  // namespace nerf
