#include "nerf/model/radiance_field.h"

#include <algorithm>
#include <vector>

#include "model/baked_occupancy.h"
#include "model/network_renderer.h"
#include "nerf/base/error.h"
#include "nerf/model/grid_field.h"

namespace nerf {

RadianceField::RadianceField(ModelInfo info, std::shared_ptr<const GridField> grid)
    : info_(std::move(info)), grid_(std::move(grid)) {}

RadianceField::RadianceField(ModelInfo info, std::shared_ptr<const NetworkField> network)
    : info_(std::move(info)), network_(std::move(network)) {}

bool RadianceField::bake(uint64_t pixels, ThreadPool& pool, const Cancel* cancel) {
  using internal::BakedOccupancy;
  if (!network_ || !internal::can_bake(*network_, info_)) return false;
  const uint64_t samples = static_cast<uint64_t>(network_->options.sampling.all_samples());
  // Skipping saves more than half of a picture's evaluations.
  const uint64_t asked =
      network_->networks.size() * static_cast<uint64_t>(BakedOccupancy::kEvaluations);
  if (!baked_ && pixels * samples > 2 * asked)
    baked_ =
        std::make_shared<BakedOccupancy>(internal::bake_occupancy(*network_, info_, pool, cancel));
  return baked_ != nullptr;
}

void RadianceField::query(std::span<const Vec3d> points, std::span<const Vec3d> directions,
                          std::span<Real> density, std::span<Real> rgb, ThreadPool& pool) const {
  const int64_t n = static_cast<int64_t>(points.size());
  NERF_CHECK_EQ(directions.size(), points.size());
  NERF_CHECK_EQ(density.size(), points.size());
  NERF_CHECK_EQ(rgb.size(), 3 * points.size());
  if (network_)
    return internal::query_network(*network_, info_.to_engine, points, directions, density, rgb,
                                   pool);
  const GridTape tape(*grid_, /*training=*/false);
  std::vector<std::unique_ptr<Chunk>> chunks(static_cast<size_t>(pool.size()));
  constexpr int64_t kBlock = kChunkSamples;
  pool.parallel_for_thread((n + kBlock - 1) / kBlock, [&](int64_t block, int thread) {
    auto& chunk = chunks[static_cast<size_t>(thread)];
    if (!chunk) chunk = std::make_unique<Chunk>(tape.tape);
    chunk->weights = grid_->weights.data();
    alignas(64) Real x[kBlock], y[kBlock], z[kBlock];
    int32_t ray_begin[kBlock + 1];
    bool inside[kBlock];
    const int64_t begin = block * kBlock;
    const int count = static_cast<int>(std::min(kBlock, n - begin));
    Real* direction = chunk->data(tape.directions);
    for (int i = 0; i < kBlock; ++i) {
      x[i] = y[i] = z[i] = 0.5_r;
      if (i >= count) continue;
      const Vec3d p = info_.to_engine.apply(points[static_cast<size_t>(begin + i)]);
      inside[i] = true;
      for (int k = 0; k < 3; ++k)
        inside[i] &= p[k] >= grid_->clip.min[k] && p[k] <= grid_->clip.max[k];
      inside[i] = inside[i] && grid_->occupancy.occupied(p.cast<Real>());
      const Vec3d d =
          info_.to_engine.rotation * normalized(directions[static_cast<size_t>(begin + i)]);
      const Vec3 g = grid_->grid_position(p.cast<Real>());
      x[i] = g.x;
      y[i] = g.y;
      z[i] = g.z;
      for (int k = 0; k < 3; ++k) direction[k * kChunkRays + i] = static_cast<Real>(d[k]);
      ray_begin[i] = i;
    }
    ray_begin[count] = count;
    chunk->samples = chunk->rays = count;
    chunk->ray_begin = ray_begin;
    encode(*grid_, {x, y, z}, count, chunk->data(tape.features), chunk->stride(tape.features));
    tape.forward_field(*chunk);
    const Real* sigma = chunk->data(tape.density);
    const Real* colour = chunk->data(tape.colour);
    for (int i = 0; i < count; ++i) {
      const size_t to = static_cast<size_t>(begin + i);
      density[to] = inside[i] ? static_cast<Real>(sigma[i] * info_.to_engine.scale) : 0.0_r;
      for (size_t k = 0; k < 3; ++k)
        rgb[3 * to + k] = colour[k * kChunkSamples + static_cast<size_t>(i)];
    }
  });
}

}  // namespace nerf
