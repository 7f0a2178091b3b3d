// Occupancy grids whose cells are given by a function of their integer places, so that a test knows
// what is where without asking the grid.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

#include "nerf/parts/occupancy.h"

namespace nerf {

inline const Box3 kEverywhere{{-1e30, -1e30, -1e30}, {1e30, 1e30, 1e30}};

// Integer place of a cell in its cascade, each in [0, side).
struct CellPlace {
  int cascade, x, y, z;
};

inline CellPlace place_of(const OccupancyGrid& grid, int64_t cell, int cascade) {
  const Vec3 corner = grid.cell_corner(cell, cascade);
  const Real w = grid.cell_width(cascade);
  const auto index = [&](Real v) { return static_cast<int>(std::lround(v / w)) + grid.side() / 2; };
  return {cascade, index(corner.x), index(corner.y), index(corner.z)};
}

// Level of a cell: 0 = empty, 255 = opaque.
using Pattern = std::function<uint8_t(const CellPlace&)>;

// Cells of a cascade that a finer one answers for are empty.
inline OccupancyGrid make_grid(int cascades, const Pattern& pattern,
                               int side = OccupancyGrid::kDefaultSide) {
  OccupancyGrid grid(cascades, side);
  std::vector<uint8_t> levels(static_cast<size_t>(cascades * grid.cells()));
  for (int c = 0; c < cascades; ++c)
    for (int64_t cell = 0; cell < grid.cells(); ++cell) {
      const CellPlace p = place_of(grid, cell, c);
      const auto inner = [&](int i) { return i >= side / 4 && i < side / 4 * 3; };
      const bool finer = c > 0 && inner(p.x) && inner(p.y) && inner(p.z);
      levels[static_cast<size_t>(c * grid.cells() + cell)] = finer ? 0 : pattern(p);
    }
  grid.set_levels(levels);
  return grid;
}

}  // namespace nerf
