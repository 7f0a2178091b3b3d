// What a step says of its cameras: from the gradient of features to that of the samples' positions,
// of their rays, and of the photos that these are of.
#include <algorithm>
#include <cmath>
#include <span>

#include "nerf/math/contraction.h"
#include "train/camera_refinement.h"
#include "train/grid_trainer.h"

namespace nerf {

// Coarse levels alone tell a camera where to go from far off; fine ones would hold it where it is
// (Lin et al. 2021).
int64_t GridTrainer::open_levels() const {
  const int64_t levels = static_cast<int64_t>(field.shape.levels.size());
  if (!cameras || options.grid_recipe.cameras.refine != RefineCameras::kOn) return levels;
  const CameraRecipe& r = options.grid_recipe.cameras;
  const int64_t first = std::min<int64_t>(r.first_levels, levels);
  const double progress = progress_at(done);
  if (progress >= r.levels_open) return levels;
  return first +
         static_cast<int64_t>(static_cast<double>(levels - first) * progress / r.levels_open);
}

double GridTrainer::camera_rate() const {
  const CameraRecipe& r = options.grid_recipe.cameras;
  return r.rate * rate_factor * std::pow(r.final_rate, progress_at(done));
}

bool GridTrainer::cameras_learn() const {
  return cameras && done >= options.grid_recipe.cameras.first_step && given.empty();
}

void GridTrainer::find_camera_gradient() {
  pool.parallel_for(batch.chunks, [&](int64_t c) { find_ray_moves(c); });
  // Chunks that this batch does not fill hold rays of one before.
  cameras->add(std::span(ray_moves).first(static_cast<size_t>(batch.chunks) * kChunkRays));
}

void GridTrainer::find_ray_moves(int64_t c) {
  const RayLines& lines = *batch.lines;
  const int64_t ld = kChunkSamples;
  const Real* const d = d_position.data() + c * 3 * ld;
  const Real* const directions = batch.direction.data() + c * 3 * kChunkRays;
  RayMove* const moves = ray_moves.data() + c * kChunkRays;
  std::fill_n(moves, kChunkRays, RayMove());
  const int64_t kept = chunk_kept[static_cast<size_t>(c)];
  for (int64_t s = 0; s < kept;) {
    const int32_t ray = lines.ray[static_cast<size_t>(c * ld + s)];
    RayMove& move = moves[ray];
    move.source = lines.source[static_cast<size_t>(c * kChunkRays + ray)];
    const Vec3 direction{directions[ray], directions[kChunkRays + ray],
                         directions[2 * kChunkRays + ray]};
    const double share = lines.share[static_cast<size_t>(c * kChunkRays + ray)];
    Pose pose;  // while the ray's line was read
    if (move.source >= 0) {
      const size_t i = static_cast<size_t>(move.source);
      pose = line_pose(source.camera_of(i), source.pose_of(i), share);
    }
    const Vec3 origin = pose.translation.cast<Real>();
    Vec3d by_direction;
    for (; s < kept && lines.ray[static_cast<size_t>(c * ld + s)] == ray; ++s) {
      const Real distance = lines.distance[static_cast<size_t>(c * ld + s)];
      Vec3 g{d[s], d[ld + s], d[2 * ld + s]};
      // The contraction's Jacobian is its own transpose.
      g = field.unbounded ? contraction_jacobian(origin + direction * distance)(g) * 0.25_r
                          : g * 0.5_r;
      move.origin = move.origin + g.cast<double>();
      by_direction = by_direction + g.cast<double>() * static_cast<double>(distance);
    }
    if (move.source < 0) continue;
    move.torque = cross(direction.cast<double>(), by_direction);
    cameras->find_gradient(pose, share, direction.cast<double>(), by_direction, move);
  }
}

}  // namespace nerf
