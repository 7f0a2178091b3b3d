// A pixel's ray on its way through a picture of the grid method.
#pragma once

#include <cstddef>

#include "nerf/base/real.h"
#include "nerf/math/vec.h"

namespace nerf::internal {

struct TileRay {
  int pixel = 0;
  size_t begin = 0, end = 0;  // its samples among the tile's
  size_t next = 0;            // the first that the network was not asked for yet
  double transmittance = 1;   // a product of many 1 - alpha; in float thin matter loses its opacity
  Real unshaded = 0;          // weight of the samples left without colour
  Real shared = 0;            // weight of those whose features are summed for one colour
  Real median = -1;           // distance at which half of the light is stopped
  Vec3 entry, direction;      // of the march, engine coordinates
  double start = 0;           // of the march, from the camera
  Real forward = 1;           // depth_per_distance()
  bool finished = false;
};

// Adds n features of a sample of weight w to its ray's.
inline void add_weighted(size_t n, Real w, const Real* __restrict x, Real* __restrict sums) {
  constexpr size_t kUsual = 16;
  if (n == kUsual)
    for (size_t f = 0; f < kUsual; ++f) sums[f] += w * x[f];
  else
    for (size_t f = 0; f < n; ++f) sums[f] += w * x[f];
}

}  // namespace nerf::internal
