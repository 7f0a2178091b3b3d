#include <algorithm>

#include "nerf/kernels/adam.h"
#include "nerf/kernels/encoding.h"
#include "nerf/kernels/hash_grid.h"
#include "nerf/train/evaluation.h"
#include "train/grid_trainer.h"
#include "train/method_rows.h"
#include "train/network_trainer.h"

namespace nerf {

namespace {

// Widths of the values on the way through one network, its input included.
uint64_t network_values(uint64_t in, uint64_t hidden, uint64_t layers, uint64_t out) {
  return in + 2 * layers * hidden + out;  // before and after each activation
}
uint64_t network_weights(uint64_t in, uint64_t hidden, uint64_t layers, uint64_t out) {
  return in * hidden + (layers - 1) * hidden * hidden + hidden * out;
}

}  // namespace

// Follows the members of NetworkTrainer.
uint64_t internal::network_memory_bytes(const TrainOptions& options, bool /*unbounded*/,
                                        int threads) {
  constexpr uint64_t kFloat = sizeof(Real);
  const uint64_t weights = place_networks(options.network).back().end;
  const uint64_t accumulators = static_cast<uint64_t>(network_accumulators(weights));
  uint64_t packs = 0;
  for (const RadianceNetwork& n : place_networks(options.network))
    packs += 2 * kFloat * (n.end - n.begin);  // rows and columns, in whole blocks
  const int rays = std::min(NetworkLevels::rays_per_chunk(options.network), options.recipe.rays);
  const uint64_t worker =
      NetworkLevels::memory_bytes(options.network, rays, true, losses_of(options.recipe));
  // Weights, gradient and two moments; the same again while a checkpoint is read and a model saved.
  return packs + kFloat * weights * (4 + accumulators + 4) +
         static_cast<uint64_t>(threads) * worker +
         static_cast<uint64_t>(options.recipe.rays) * sizeof(NetworkRay);
}

// Follows the members of GridTrainer, in their order.
uint64_t internal::grid_memory_bytes(const TrainOptions& options, bool unbounded, int threads) {
  constexpr uint64_t kFloat = sizeof(Real);
  const GridOptions& o = options.grid;
  const HashGridShape shape = hash_grid_shape(o);  // a resolution left open: the finest
  const uint64_t rows = shape.rows;
  const uint64_t weights_of_rows = shape.size() * kFloat;
  const uint64_t half_table = shape.size() * sizeof(uint16_t);
  const uint64_t table = o.table_bits == 16 ? half_table : weights_of_rows;

  // A cell: opacity, level, and two masks of a bit.
  const uint64_t side = static_cast<uint64_t>(occupancy_side(o, unbounded));
  const uint64_t cells = side * side * side * (unbounded ? kMostCascades : 1);
  const uint64_t occupancy = cells * (kFloat + 1) + cells / 4;

  const uint64_t hidden = static_cast<uint64_t>(o.hidden);
  const uint64_t features = static_cast<uint64_t>(shape.features());
  const uint64_t geometry = static_cast<uint64_t>(o.geometry_features);
  const uint64_t density_layers = static_cast<uint64_t>(o.density_layers);
  const uint64_t colour_layers = static_cast<uint64_t>(o.colour_layers);
  const uint64_t colour_in = geometry + kSphericalHarmonics;
  const uint64_t weights = kFloat * (network_weights(features, hidden, density_layers, geometry) +
                                     network_weights(colour_in, hidden, colour_layers, 3));
  const uint64_t field = table + occupancy + 3 * weights;  // packed in bf16 too

  // Gradient and states of the table, of the networks' weights gradient and two moments; a row's
  // mark and place in the list of those that have a gradient.
  const uint64_t optimiser =
      (1 + kRowParts) * weights_of_rows + 3 * weights + (sizeof(uint32_t) + 1) * rows;
  const uint64_t accumulators = kAccumulators * weights;

  // Values and gradients of a chunk, per thread.
  const uint64_t chunk_values = network_values(features, hidden, density_layers, geometry) +
                                network_values(colour_in, hidden, colour_layers, 3) + 32;
  const uint64_t workers =
      static_cast<uint64_t>(threads) * 2 * kChunkSamples * kFloat * chunk_values;

  // Of a sample: features with their gradient, position, width, cell, density, and once more what
  // its block of rays holds (with a vector's reserve). There may be as many rays as samples, each
  // with a record of some 100 bytes.
  const uint64_t sample = 2 * features * kFloat + 7 * kFloat + 2 * 6 * kFloat + 12 * kFloat + 100;
  const uint64_t batch = static_cast<uint64_t>(options.grid_recipe.batch_samples) * sample;

  // Besides the trainer, at different times: a copy of the field with its table in half precision
  // and its levels compressed (a saved model), a checkpoint read whole, moments made anew.
  const uint64_t saving = field + half_table + cells;
  const uint64_t resuming = 3 * (weights_of_rows + weights) + kFloat * rows + cells * (kFloat + 2);
  const uint64_t restarting = optimiser;
  return field + optimiser + accumulators + workers + batch +
         std::max({saving, resuming, restarting});
}

// Frame (5 numbers), its 8-bit pictures by way of three more, the three pictures side by side and
// their encoder's copies.
uint64_t evaluation_memory_bytes(uint64_t pixels) { return (8 * sizeof(Real) + 32) * pixels; }

}  // namespace nerf
