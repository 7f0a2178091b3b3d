// For tests: a medium whose pictures have a closed form.
#pragma once

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "nerf/model/grid_field.h"
#include "nerf/model/radiance_field.h"

namespace nerf::test {

// Density exp(0) = 1 per engine unit everywhere in [-1, 1]^3, or where x > 0 alone; colour
// sigmoid(0). `level` is what the cache says of each cell.
inline RadianceField homogeneous_field(const Similarity& to_engine, bool half_empty = false,
                                       uint8_t level = 30) {
  GridOptions options;
  options.levels = 1;
  options.log2_entries = 10;
  options.base_resolution = 4;
  options.hidden = 16;
  options.occupancy_side = 32;
  auto grid = std::make_shared<GridField>(options, /*unbounded=*/false, 1);
  std::vector<uint8_t> levels(grid->occupancy.levels().size(), level);
  for (size_t i = 0; half_empty && i < levels.size(); ++i)
    if (grid->occupancy.cell_corner(static_cast<int64_t>(i), 0).x < 0) levels[i] = 0;
  grid->occupancy.set_levels(levels);
  ModelInfo info;
  info.to_engine = to_engine;
  info.near = 1e-3;
  return RadianceField(std::move(info), std::move(grid));
}

// A frame whose axes, unit and origin all differ from the input's.
inline Similarity tilted() {
  const double a = 0.5, b = 0.7;
  Mat3d turn, tilt;
  turn.m = {{{std::cos(a), -std::sin(a), 0}, {std::sin(a), std::cos(a), 0}, {0, 0, 1}}};
  tilt.m = {{{1, 0, 0}, {0, std::cos(b), -std::sin(b)}, {0, std::sin(b), std::cos(b)}}};
  Similarity s;
  s.rotation = turn * tilt;
  s.center = {3, -1, 2};
  s.scale = 0.25;
  return s;
}

}  // namespace nerf::test
