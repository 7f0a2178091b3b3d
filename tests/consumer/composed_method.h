// A method that the library does not hold, composed of its parts.
#pragma once

#include <cstdint>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"

// Hash grids in contracted space, sampled by a proposal that another hash grid learns: mip-NeRF
// 360's sampling and losses (Barron et al. 2022) on Mueller et al. 2022's fields.
struct ComposedLosses {
  double squared_error = 0;  // of the pixels, mean over channels
  double loss = 0;           // all that was descended
};

// Trains for some steps on one thread; the means of the first and the last tenth of them.
struct ComposedResult {
  ComposedLosses first, last;
};
ComposedResult train_composed_method(const nerf::Scene& scene, const nerf::PhotoSet& photos,
                                     int steps, uint64_t seed);
