// Points on the surface that pictures of depth agree about.
#pragma once

#include <cstdint>
#include <span>

#include "nerf/base/threads.h"
#include "nerf/geometry/depth_fusion.h"
#include "nerf/geometry/triangle_mesh.h"

namespace nerf {

struct PointOptions {
  int64_t points = 1000000;  // about so many
  Box3 box;                  // only what is in it
  int least_views = 2;       // that must have seen the surface where a point is
  int least_neighbours = 4;  // of the 26 places around that must have a point too
};

// One point for each small cube of space that the pictures' surface passes: the mean of what they
// see there, with the mean normal, towards the pictures (unit). Positions and normals of a mesh
// without triangles, in the views' frame. The same bits for any number of threads.
TriangleMesh points_from_depths(std::span<const DepthView> views, const PointOptions& options,
                                ThreadPool& pool);

}  // namespace nerf
