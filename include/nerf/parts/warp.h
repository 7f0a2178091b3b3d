// Where a point of a moment stands in the canonical scene, which does not move:
//   x' = x + d(x, code)               translation (Pumarola et al. 2021, section 4)
//   x' = exp(s(x, code)) x            a rigid motion of each point (Park et al. 2021, section 3.2)
// A small network of the encoded position and of the moment's code gives d or s. Another of the
// same kind bends a sheet through more coordinates than three, where the shape itself changes (Park
// et al. 2021b, section 4).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/autodiff/tangents.h"
#include "nerf/base/options.h"

namespace nerf {

enum class WarpKind { kNone, kTranslation, kSe3 };
inline auto option_names(WarpKind) {
  return std::array{OptionName{WarpKind::kNone, "none"},
                    OptionName{WarpKind::kTranslation, "translation"},
                    OptionName{WarpKind::kSe3, "se3"}};
}

struct PointShape {
  int position_degrees = 0;  // frequencies of the encoded position
  bool identity = true;      // the position itself above them
  int code = 0;              // numbers that say which moment it is
  int depth = 3, width = 64;
  // The hidden layer that the input is given again to, counted from 1; 0: none. With
  // `skip_position` only the encoded position.
  int skip = 0;
  bool skip_position = false;
  Real last_bound = 1e-4_r;  // of the last layer's first weights: next to nothing moves at first

  int encoded() const { return (identity ? 3 : 0) + 6 * position_degrees; }
};

// ReLU layers from a point's encoded position above its moment's code, in a field's weights.
struct PointNetwork {
  PointShape shape;
  std::vector<LinearWeights> hidden;
  LinearWeights last;
  size_t begin = 0, end = 0;  // in the field's weights

  PointNetwork() = default;
  PointNetwork(const PointShape& shape, int outputs, size_t begin);
  bool empty() const { return last.out == 0; }
  std::vector<LinearWeights*> layers();  // in their order
  // `layer` numbers the field's layers, for their random numbers.
  void initialise(uint64_t seed, uint64_t layer, Real* weights) const;
};

struct WarpShape : PointShape {
  WarpKind kind = WarpKind::kNone;
  bool any() const { return kind != WarpKind::kNone; }
};

// To 3 numbers (a translation) or 6 (rotation vector and velocity).
struct WarpNetwork : PointNetwork {
  WarpKind kind = WarpKind::kNone;
  WarpNetwork() = default;
  WarpNetwork(const WarpShape& shape, size_t begin);
};

// position [3 x samples], code [shape.code x samples] -> canonical position [3 x samples]. The
// window holds shape.position_degrees weights of the encoding's frequencies. `moving` [3 x
// samples], where it is given, is what a translation is multiplied by: 0 where nothing moves.
Value record_warp(Tape& tape, const WarpNetwork& network, Value position, Value code,
                  const FrequencyWeights& window, Value moving = -1);
// With the tangents of the position: along the three axes the result's are the columns of the
// warp's Jacobian. The code and `moving` are the same in every direction.
WithTangents record_warp(Tape& tape, const WarpNetwork& network, const WithTangents& position,
                         Value code, const FrequencyWeights& window, Value moving = -1);

// The network's outputs as they are: ambient coordinates [outputs x samples].
Value record_sheet(Tape& tape, const PointNetwork& network, Value position, Value code,
                   const FrequencyWeights& window);

}  // namespace nerf
