// Many pictures of depth become one volume of signed distances (Curless and Levoy 1996).
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/geometry/voxel_volume.h"
#include "nerf/math/vec.h"

namespace nerf {

// By a pinhole without distortion, whose axis meets the picture in its middle. The frame and the
// unit are the volume's.
struct DepthView {
  static constexpr float kUnknown = 0;
  static constexpr float kNothing = std::numeric_limits<float>::infinity();  // free all along

  Pose to_world;     // camera axes as everywhere: x right, y down, z forward
  double focal = 1;  // pixels
  int width = 0, height = 0;
  std::vector<float> depth;  // along the axis, row by row from the top

  // In camera axes, through the centre of a pixel; z is 1.
  Vec3d direction(double x, double y) const {
    return {(x + 0.5 - 0.5 * width) / focal, (y + 0.5 - 0.5 * height) / focal, 1};
  }
};

struct FusionOptions {
  double truncation = 0;   // distances beyond it count as this far
  float least_weight = 0;  // of a sample that is known; a picture from one unit away counts 1 / cos
};

// Signed distance to the surface as a fraction of the truncation, below 0 inside, in blocks around
// everything that the pictures see; its mean over the pictures, each by its weight: the cosine
// between the pixel's ray and the surface that it meets, by the square of its distance, and behind
// the surface less and less. Where no picture sees a sample its weight stays 0: behind surfaces,
// beside pictures. The same bits for any number of threads. Throws Cancelled, and Error where the
// blocks need more memory than `memory_bytes`.
VoxelVolume fuse_depths(std::span<const DepthView> views, const VoxelLattice& lattice,
                        const FusionOptions& options, uint64_t memory_bytes, ThreadPool& pool,
                        const Cancel* cancel = nullptr);

// Makes samples unknown (weight 0) that no view sees, in front of a surface or behind it by less
// than the truncation; the volume's other weights become 1.
void carve_unseen(std::span<const DepthView> views, double truncation, VoxelVolume& volume,
                  ThreadPool& pool, const Cancel* cancel = nullptr);

// From each point of a surface to the views that see it (no more than `width` behind what they
// show), the mean of the directions, each by its cosine with the normal; the normal where none
// does. Unit vectors.
std::vector<Vec3d> mean_view_directions(std::span<const DepthView> views,
                                        std::span<const Vec3> positions,
                                        std::span<const Vec3> normals, double width,
                                        ThreadPool& pool);

}  // namespace nerf
