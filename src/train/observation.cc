// What the rays of a step, and random points between steps, tell the occupancy grid and the error
// map.
#include <algorithm>
#include <cmath>
#include <vector>

#include "nerf/kernels/elementwise.h"
#include "train/grid_trainer.h"

namespace nerf {

namespace {

// body(tile, squared error) for every ray of a step, in one order.
template <class Body>
void each_ray(const RayBatch& batch, const std::vector<Real>& errors, const Body& body) {
  for (const RayBatch::EmptyRay& ray : batch.empty_rays) body(ray.tile, ray.squared_error);
  for (int c = 0; c < batch.chunks; ++c) {
    const size_t first = static_cast<size_t>(c) * kChunkRays;
    const size_t end = first + static_cast<size_t>(batch.rays[static_cast<size_t>(c)]);
    for (size_t i = first; i < end; ++i) body(batch.tile[i], errors[i]);
  }
}

}  // namespace

void GridTrainer::observe_samples() {
  constexpr int kAhead = 24;  // samples: cells lie anywhere in memory
  alignas(64) Real seen[kChunkSamples];
  for (int c = 0; c < batch.chunks; ++c) {
    const size_t at = static_cast<size_t>(c) * kChunkSamples;
    const int n = batch.samples[static_cast<size_t>(c)];
    opacity(n, densities.data() + at, batch.cell_width.data() + at, seen);
    const int32_t* cells = batch.cell.data() + at;
    for (int s = 0; s < std::min(n, kAhead); ++s)
      field.occupancy.prefetch_memory(static_cast<size_t>(cells[s]));
    for (int s = 0; s < n; ++s) {
      if (s + kAhead < n) field.occupancy.prefetch_memory(static_cast<size_t>(cells[s + kAhead]));
      field.occupancy.observe(static_cast<size_t>(cells[s]), seen[s]);
    }
  }
}

void GridTrainer::observe_errors() {
  constexpr int64_t kInterval = 64;
  if (errors.keeps_all()) return;
  each_ray(batch, ray_errors,
           [&](int32_t tile, Real squared_error) { errors.observe(tile, squared_error); });
  if ((done + 1) % kInterval == 0) errors.refresh();
}

// Each ray stands for the pixels that were passed over on the way to it.
double GridTrainer::mean_squared_error() const {
  double sum = 0, pixels = 0;
  each_ray(batch, ray_errors, [&](int32_t tile, Real squared_error) {
    const double weight = errors.keeps_all() ? 1 : 1 / static_cast<double>(errors.chance(tile));
    sum += weight * static_cast<double>(squared_error);
    pixels += weight;
  });
  return sum / (3 * std::max(pixels, 1.0));
}

// One random point in one cell of every group of `group` cells.
void GridTrainer::refresh_occupancy() {
  constexpr int64_t kInterval = 16, kMostPoints = 1 << 17;
  if (done % kInterval != 0) return;
  const bool whole = done == 32 || done == 64 || done == 128 || done == 256;
  OccupancyGrid& grid = field.occupancy;
  const int64_t group =
      whole ? 1 : std::max<int64_t>(32, grid.cascades() * grid.cells() / kMostPoints);
  const int64_t points = grid.cascades() * grid.cells() / group;
  constexpr int64_t kBlock = kChunkSamples;
  pool.parallel_for_thread((points + kBlock - 1) / kBlock, [&](int64_t block, int thread) {
    Chunk& chunk = *workers[static_cast<size_t>(thread)];
    alignas(64) Real x[kBlock], y[kBlock], z[kBlock];
    int32_t cascade[kBlock];
    int64_t cell[kBlock];
    int n = 0;
    for (int64_t i = block * kBlock; i < std::min(points, (block + 1) * kBlock); ++i) {
      Random random(options.seed ^ salt, static_cast<uint64_t>(done) | uint64_t{1} << 62,
                    static_cast<uint64_t>(i));
      const int64_t at =
          i * group + static_cast<int64_t>(random.below(static_cast<uint64_t>(group)));
      const int c = static_cast<int>(at / grid.cells());
      const int64_t in = at % grid.cells();
      if (grid.is_off(c, in)) continue;
      const Real w = grid.cell_width(c);
      const Vec3 corner = grid.cell_corner(in, c);
      const Vec3 g = field.grid_position(
          corner + Vec3{random.uniform() * w, random.uniform() * w, random.uniform() * w});
      x[n] = g.x;
      y[n] = g.y;
      z[n] = g.z;
      cascade[n] = c;
      cell[n] = in;
      ++n;
    }
    if (n == 0) return;
    std::fill(x + n, x + round_up(n, kLane), 0.5_r);
    std::fill(y + n, y + round_up(n, kLane), 0.5_r);
    std::fill(z + n, z + round_up(n, kLane), 0.5_r);
    encode(field, {x, y, z}, n, chunk.data(tape.features), chunk.stride(tape.features));
    chunk.weights = field.weights.data();
    chunk.samples = n;
    chunk.rays = 0;
    tape.forward_density(chunk);
    const Real* density = chunk.data(tape.density);
    for (int k = 0; k < n; ++k)
      grid.observe(cascade[k], cell[k], -std::expm1(-density[k] * grid.cell_width(cascade[k])));
  });
  grid.rebuild(static_cast<Real>(options.grid_recipe.occupancy_threshold), &pool);
}

}  // namespace nerf
