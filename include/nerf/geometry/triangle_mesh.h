// Triangles that share vertices.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "nerf/base/real.h"
#include "nerf/math/vec.h"

namespace nerf {

struct TriangleMesh {
  using Triangle = std::array<uint32_t, 3>;

  std::vector<Vec3> positions;
  std::vector<Vec3> normals;        // unit, one for each position; empty: none
  std::vector<Vec3> colours;        // sRGB in [0, 1], one for each position; empty: none
  std::vector<Triangle> triangles;  // counterclockwise as seen from outside

  const Vec3& corner(size_t triangle, size_t k) const { return positions[triangles[triangle][k]]; }
};

// Normals of the vertices: the sum of those of the triangles around, by area. A vertex without a
// triangle that has an area gets (0, 0, 1).
void find_normals(TriangleMesh& mesh);

// Drops vertices that no triangle has; those that stay keep their order.
void drop_unused_vertices(TriangleMesh& mesh);

// Drops components, sets of triangles that share vertices, whose bounding box has a diagonal of
// less than `least_diagonal`, and those with less than `least_share` of the triangles of the
// largest. Returns how many.
int64_t drop_small_components(TriangleMesh& mesh, double least_diagonal, double least_share);

// Collapses edges where the surface is moved least (Garland and Heckbert 1997, by meshoptimizer)
// until there are no more than `triangles`, or none is left that keeps the mesh in one piece.
// Vertices are among those of before, with their normals and colours.
void decimate(TriangleMesh& mesh, size_t triangles);

}  // namespace nerf
