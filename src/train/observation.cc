// What the rays of a step, and random points between steps, tell the occupancy grid.
#include <algorithm>
#include <cmath>

#include "nerf/kernels/elementwise.h"
#include "train/grid_trainer.h"

namespace nerf {

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

// A cell is on where there is matter at any moment: its points are of random photos' moments.
Real GridTrainer::moment(int64_t block) const {
  if (!moving) return 0;
  Random random(seed(), random_key(RandomStream::kMoment, done), static_cast<uint64_t>(block));
  return source.time_of(static_cast<size_t>(random.below(source.photos())));
}

// One random point in one cell of every group of `group` cells.
void GridTrainer::refresh() {
  constexpr int64_t kInterval = 16, kMostPoints = 1 << 17;
  if (done % kInterval != 0) return;
  const bool whole = done == 32 || done == 64 || done == 128 || done == 256;
  OccupancyGrid& grid = field.occupancy;
  const int64_t group =
      whole ? 1 : std::max<int64_t>(32, grid.cascades() * grid.cells() / kMostPoints);
  const int64_t points = grid.cascades() * grid.cells() / group;
  constexpr int64_t kBlock = kChunkSamples;
  pool.parallel_for_thread((points + kBlock - 1) / kBlock, [&](int64_t block, int thread) {
    auto& query = queries[static_cast<size_t>(thread)];
    if (!query) query = field.query(&dense->packs());
    Vec3d at_points[kBlock];
    Real density[kBlock];
    int32_t cascade[kBlock];
    int64_t cell[kBlock];
    int n = 0;
    for (int64_t i = block * kBlock; i < std::min(points, (block + 1) * kBlock); ++i) {
      Random random(seed(), random_key(RandomStream::kOccupancy, done), static_cast<uint64_t>(i));
      const int64_t at =
          i * group + static_cast<int64_t>(random.below(static_cast<uint64_t>(group)));
      const int c = static_cast<int>(at / grid.cells());
      const int64_t in = at % grid.cells();
      if (grid.is_off(c, in)) continue;
      const Real w = grid.cell_width(c);
      const Vec3 corner = grid.cell_corner(in, c);
      const Vec3 p =
          corner + Vec3{random.uniform() * w, random.uniform() * w, random.uniform() * w};
      at_points[n] = p.cast<double>();
      cascade[n] = c;
      cell[n] = in;
      ++n;
    }
    const size_t count = static_cast<size_t>(n);
    if (n == 0) return;
    query->ask({.positions = std::span(at_points, count),
                .time = moment(block),
                .motion_spacing = grid.brick_width(cascade[0])},
               {.density = std::span(density, count)});
    for (int k = 0; k < n; ++k)
      grid.observe(cascade[k], cell[k], -std::expm1(-density[k] * grid.cell_width(cascade[k])));
  });
  grid.rebuild(static_cast<Real>(options.grid_recipe.occupancy_threshold), &pool);
}

}  // namespace nerf
