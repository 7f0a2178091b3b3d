#include <algorithm>

#include "nerf/kernels/hash_grid.h"
#include "nerf/train/run.h"

namespace nerf {

namespace {
constexpr uint64_t kAccumulators = 32;  // of the networks' gradients
}  // namespace

uint64_t training_memory_bytes(const TrainOptions& options, int threads) {
  const GridOptions& o = options.grid;
  const HashGridShape shape =
      hash_grid_shape(o.levels, o.log2_entries, o.base_resolution, o.finest_resolution);
  // Table, gradient, two moments; flag and counter of a row. A snapshot to render from copies the
  // table once more.
  const uint64_t table = shape.rows * (5 * kGridFeatures * sizeof(float) + 3);
  constexpr uint64_t kCascades = 5, kBytesPerCell = 6;
  const auto cells = [&](bool unbounded) {
    const uint64_t side = static_cast<uint64_t>(occupancy_side(o, unbounded));
    return side * side * side * (unbounded ? kCascades : 1);
  };
  const uint64_t occupancy = 2 * std::max(cells(false), cells(true)) * kBytesPerCell;
  const uint64_t hidden = static_cast<uint64_t>(o.hidden);
  const uint64_t network =
      hidden * hidden * static_cast<uint64_t>(o.density_layers + o.colour_layers + 2) * 4;
  const uint64_t networks = network * (4 + kAccumulators);
  // Features and their gradients; positions and the rest of a sample twice (per block, per chunk).
  const uint64_t samples = static_cast<uint64_t>(options.batch_samples) *
                           (2 * static_cast<uint64_t>(shape.features()) * 4 + 2 * 28 + 40);
  const uint64_t layers = static_cast<uint64_t>(o.density_layers + o.colour_layers);
  const uint64_t arena = kChunkSamples * 4 * 2 * (hidden * layers + 256);
  return table + occupancy + networks + samples + static_cast<uint64_t>(threads) * arena;
}

}  // namespace nerf
