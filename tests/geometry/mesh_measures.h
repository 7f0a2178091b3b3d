// For tests: what closed forms say of meshes.
#pragma once

#include "nerf/geometry/triangle_mesh.h"

namespace nerf::test {

inline Vec3d corner(const TriangleMesh& mesh, size_t t, size_t k) {
  return mesh.corner(t, k).cast<double>();
}

inline double area(const TriangleMesh& mesh) {
  double sum = 0;
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    sum += length(
        cross(corner(mesh, t, 1) - corner(mesh, t, 0), corner(mesh, t, 2) - corner(mesh, t, 0)));
  return sum / 2;
}

inline double volume(const TriangleMesh& mesh) {
  double sum = 0;
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    sum += dot(corner(mesh, t, 0), cross(corner(mesh, t, 1), corner(mesh, t, 2)));
  return sum / 6;
}

// Mean over the surface, by area, of distance(middle of each triangle).
template <class Distance>
double mean_distance(const TriangleMesh& mesh, const Distance& distance) {
  double sum = 0, areas = 0;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vec3d a = corner(mesh, t, 0), b = corner(mesh, t, 1), c = corner(mesh, t, 2);
    const double area = length(cross(b - a, c - a));
    sum += area * distance((a + b + c) / 3);
    areas += area;
  }
  return sum / areas;
}

}  // namespace nerf::test
