// For tests: options with which a step takes milliseconds.
#pragma once

#include "nerf/train/trainer.h"

namespace nerf::test {

inline TrainOptions tiny_options(int64_t steps) {
  TrainOptions o;
  o.steps = steps;
  o.batch_samples = 4800;
  o.rate = 0.01;
  o.grid.levels = 4;
  o.grid.log2_entries = 12;
  o.grid.occupancy_side = 64;
  o.grid.base_resolution = 8;
  o.grid.finest_resolution = 64;
  o.grid.hidden = 16;
  o.grid.colour_layers = 1;
  return o;
}

}  // namespace nerf::test
