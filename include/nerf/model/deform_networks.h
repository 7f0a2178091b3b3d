// What leads the points of a paper method's networks to the canonical scene, and the coordinates
// that they have beside those of space. All levels share it.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "nerf/model/deform_options.h"
#include "nerf/parts/codes.h"
#include "nerf/parts/warp.h"

namespace nerf {

struct DeformNetworks {
  WarpNetwork warp;
  PointNetwork sheet;
  LinearWeights codes, planes;  // CodeBooks::deformation and plane
  size_t begin = 0, end = 0;    // of the networks, in the field's weights

  DeformNetworks() = default;
  DeformNetworks(const DeformOptions& options, size_t begin);
  std::vector<LinearWeights*> layers();
  // `layer` numbers the field's layers, for their random numbers; returns the next.
  uint64_t initialise(uint64_t seed, uint64_t layer, Real* weights) const;
};

// Features that the ambient coordinates add to a position's.
inline int ambient_features(const DeformOptions& o) {
  return o.slice == Slice::kNone ? 0 : 2 * o.ambient * o.ambient_degrees;
}

// How many frequencies of an encoding are open (math/window.h); all of them where training does not
// say otherwise.
struct DeformWindows {
  static constexpr double kOpen = 64;
  double warp = kOpen, ambient = kOpen;
};

// A moment on a tape.
struct DeformInputs {
  Value time = -1;    // in, without moments' codes: [1 x rays]
  Value moment = -1;  // in, training with codes: [1 x rays], a row of the books
  // In, else: [numbers x rays].
  Value code = -1, plane = -1;
  Value moving = -1;                      // in, still_start: [3 x rays], 0 at time 0, else 1
  std::array<Value, 3> axes{-1, -1, -1};  // in, with the elastic loss: [3 x samples], unit vectors
  Value elastic_scale = -1;               // in, with it: [1 x rays]
  std::array<Value, 3> jacobian{-1, -1, -1};  // of the warp, by columns [3 x samples]
  Value canonical = -1;                       // [3 x samples]
};

}  // namespace nerf
