// The surface where a volume's values are 0, as triangles (Lorensen and Cline 1987).
#pragma once

#include <cstdint>
#include <vector>

#include "nerf/base/threads.h"
#include "nerf/geometry/triangle_mesh.h"
#include "nerf/geometry/voxel_volume.h"

namespace nerf {

// Values below 0 are inside. A cell with a corner that is not known has no surface: the mesh is
// closed except for borders of what is known, and no edge belongs to more than two triangles, since
// two cells agree about the face between them. The same bits for any number of threads.
TriangleMesh marching_cubes(const VoxelVolume& volume, ThreadPool& pool);

// The triangles of a cell by which of its corners are inside (bit x + 2 y + 4 z of the corner):
// three edges each. An edge is 4 * axis + the lesser other coordinate + 2 * the greater one.
const std::vector<uint8_t>& marching_cubes_case(int inside);

}  // namespace nerf
