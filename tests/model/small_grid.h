// For tests: a grid field of a few hundred rows and narrow networks.
#pragma once

#include "nerf/model/grid_field.h"

namespace nerf::test {

inline GridOptions small_options(int density_layers, int colour_layers) {
  GridOptions o;
  o.table_bits = 32;  // gradients are found as they are
  o.levels = 2;
  o.log2_entries = 8;
  o.occupancy_side = 64;
  o.base_resolution = 4;
  o.finest_resolution = 16;
  o.hidden = 16;
  o.density_layers = density_layers;
  o.colour_layers = colour_layers;
  o.geometry_features = 5;
  return o;
}

}  // namespace nerf::test
