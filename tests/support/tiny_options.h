// For tests: options with which a step takes milliseconds, and everything that steps wrote.
#pragma once

#include <cstdint>
#include <vector>

#include "nerf/base/file.h"
#include "nerf/train/trainer.h"
#include "support/temp_folder.h"

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

// The trainer's state as bytes.
inline std::vector<uint8_t> bits_of(const Trainer& trainer) {
  const TempFolder folder;
  trainer.save_checkpoint(folder / "bits");
  return read_file(folder / "bits");
}

}  // namespace nerf::test
