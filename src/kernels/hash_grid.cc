#include "nerf/kernels/hash_grid.h"

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"

namespace nerf {

HashGridShape hash_grid_shape(int levels, int log2_entries, int base_resolution,
                              double finest_resolution, int features_per_entry) {
  NERF_CHECK_GE(levels, 1);
  NERF_CHECK_LE(log2_entries, 24);
  NERF_CHECK_GE(base_resolution, 2);
  NERF_CHECK(features_per_entry == 2 || features_per_entry == 4);
  HashGridShape shape;
  const double growth =
      levels > 1 ? std::exp(std::log(finest_resolution / base_resolution) / (levels - 1)) : 1.0;
  const uint64_t table = uint64_t{1} << log2_entries;
  for (int l = 0; l < levels; ++l) {
    HashGridLevel level;
    level.scale = static_cast<float>(base_resolution * std::pow(growth, l) - 1.0);
    // Sampling at x * scale + 0.5 reaches vertex ceil(scale) + 1 in the worst case.
    const uint64_t side = static_cast<uint64_t>(std::ceil(level.scale)) + 2;
    level.resolution = static_cast<uint32_t>(side);
    const uint64_t vertices = side * side * side;
    level.dense = vertices <= table;
    level.entries = static_cast<uint32_t>(level.dense ? (vertices + 7) / 8 * 8 : table);
    level.offset = shape.rows;
    level.features = features_per_entry;
    shape.rows += level.entries;
    shape.levels.push_back(level);
  }
  return shape;
}

}  // namespace nerf
