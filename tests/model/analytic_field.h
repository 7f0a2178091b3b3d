// For tests: opaque surfaces whose place and normals have a closed form.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "nerf/model/grid_field.h"
#include "nerf/model/radiance_field.h"

namespace nerf::test {

// Density of a signed distance d (engine units, below 0 inside; interpolated between 96^3
// vertices): exp(-s d) s ln 2, which stops half of the light of a ray that meets the surface at
// right angles at d = 0. Colour sigmoid(0). What cells remember is that density at their nearest
// point. `motion`: networks of weights 0, by which all moments are alike.
template <class Distance>
RadianceField surface_field(const Similarity& to_engine, const Distance& distance,
                            const MotionShape& motion = {}) {
  constexpr double kSharpness = 2000;
  GridOptions options;
  options.levels = 1;
  options.log2_entries = 20;
  options.features = 2;
  options.base_resolution = 96;
  options.finest_resolution = 96;
  options.hidden = 16;
  options.table_bits = 32;
  options.occupancy_side = 128;
  auto grid =
      std::make_shared<GridField>(options, /*unbounded=*/false, 1, GridParts{.motion = motion});
  const HashGridLevel& level = grid->shape.levels[0];
  const uint32_t n = level.resolution;
  for (uint32_t z = 0; z < n; ++z)
    for (uint32_t y = 0; y < n; ++y)
      for (uint32_t x = 0; x < n; ++x) {
        const auto engine = [&](uint32_t i) { return 2 * (i - 0.5) / level.scale - 1; };
        const double d = distance(Vec3d{engine(x), engine(y), engine(z)});
        grid->table[2 * (x + static_cast<size_t>(n) * (y + static_cast<size_t>(n) * z))] =
            static_cast<Real>(std::log(kSharpness * std::log(2.0)) - kSharpness * d);
      }
  // The first feature, as max(f, 0) - max(-f, 0).
  const auto weight = [&](size_t layer, int to, int from) -> Real& {
    const LinearWeights& w = grid->density_layers[layer];
    return grid->weights[w.offset + static_cast<size_t>(to * weight_stride(w.in) + from)];
  };
  weight(0, 0, 0) = weight(1, 0, 0) = 1;
  weight(0, 1, 0) = weight(1, 0, 1) = -1;
  const OccupancyGrid& cells = grid->occupancy;
  const double width = cells.cell_width(0);
  std::vector<uint8_t> levels(cells.levels().size());
  for (size_t i = 0; i < levels.size(); ++i) {
    const Vec3 corner = cells.cell_corner(static_cast<int64_t>(i), 0);
    const Vec3d middle = corner.cast<double>() + Vec3d{1, 1, 1} * (0.5 * width);
    const double inside = 0.9 * width - distance(middle);
    if (inside > 0) levels[i] = inside > width ? 255 : 128;
  }
  grid->occupancy.set_levels(levels);
  ModelInfo info;
  info.to_engine = to_engine;
  info.near = 1e-3;
  info.alpha = true;
  return RadianceField(std::move(info), std::move(grid));
}

}  // namespace nerf::test
