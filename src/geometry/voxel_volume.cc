#include "nerf/geometry/voxel_volume.h"

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"

namespace nerf {

VoxelLattice VoxelLattice::around(const Box3& box, int resolution) {
  NERF_CHECK(!box.empty() && resolution > 0);
  const Vec3d size = box.size();
  VoxelLattice lattice;
  lattice.spacing = std::max({size.x, size.y, size.z}) / resolution;
  NERF_CHECK_GT(lattice.spacing, 0.0);
  for (int k = 0; k < 3; ++k) {
    const int cells = static_cast<int>(std::ceil(size[k] / lattice.spacing - 1e-6)) + 2;
    lattice.samples[static_cast<size_t>(k)] = cells + 1;
    lattice.origin[k] = box.center()[k] - 0.5 * cells * lattice.spacing;
  }
  return lattice;
}

VoxelVolume::VoxelVolume(const VoxelLattice& lattice) : lattice_(lattice) {
  for (size_t k = 0; k < 3; ++k) along_[k] = (lattice.samples[k] + kSide - 1) / kSide;
  slots_.assign(static_cast<size_t>(block_count()), -1);
}

void VoxelVolume::allocate(std::span<const uint8_t> wanted) {
  NERF_CHECK_EQ(wanted.size(), slots_.size());
  blocks_.clear();
  blocks_.resize(static_cast<size_t>(
      std::count_if(wanted.begin(), wanted.end(), [](uint8_t w) { return w != 0; })));
  int32_t next = 0;
  size_t i = 0;
  for (int z = 0; z < along_[2]; ++z)
    for (int y = 0; y < along_[1]; ++y)
      for (int x = 0; x < along_[0]; ++x, ++i) {
        slots_[i] = wanted[i] ? next : -1;
        if (wanted[i]) blocks_[static_cast<size_t>(next++)].at = {x, y, z};
      }
}

}  // namespace nerf
