// Points of a PLY file (Turk 1994): ascii, binary_little_endian, binary_big_endian.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "nerf/math/vec.h"

namespace nerf::internal {

struct PlyPoints {
  std::vector<Vec3d> positions;  // x, y, z of the vertices, the file's coordinates
  size_t vertices = 0;           // in the file; more than positions where those were thinned out
  bool splats = false;           // vertices are Gaussians (3D Gaussian splatting's own file)
};

// Reads at most about `most` vertices, spread evenly over the file; those that are not finite are
// left out. Other elements and properties are skipped. Throws Error that names the line of the
// header or the vertex: not a PLY file, a header that makes no sense, truncated.
PlyPoints read_ply_points(const std::filesystem::path& path, size_t most = 500000);

}  // namespace nerf::internal
