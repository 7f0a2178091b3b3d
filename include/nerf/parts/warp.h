// Where a point of a moment stands in the canonical scene, which does not move:
//   x' = x + d(x, code)               translation (Pumarola et al. 2021, section 4)
//   x' = exp(s(x, code)) x            a rigid motion of each point (Park et al. 2021, section 3.2)
// A small network of the encoded position and of the moment's code gives d or s.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/base/options.h"

namespace nerf {

enum class WarpKind { kNone, kTranslation, kSe3 };
inline auto option_names(WarpKind) {
  return std::array{OptionName{WarpKind::kNone, "none"},
                    OptionName{WarpKind::kTranslation, "translation"},
                    OptionName{WarpKind::kSe3, "se3"}};
}

struct WarpShape {
  WarpKind kind = WarpKind::kNone;
  int position_degrees = 0;  // frequencies of the encoded position, beside the position itself
  int code = 0;              // numbers that say which moment it is
  int depth = 3, width = 64;
  // The hidden layer that the input is given again to, counted from 1; 0: none. With
  // `skip_position` only the encoded position.
  int skip = 0;
  bool skip_position = false;
  Real last_bound = 1e-4_r;  // of the last layer's first weights: next to nothing moves at first

  bool any() const { return kind != WarpKind::kNone; }
};

// The network's layers in a field's weights.
struct WarpNetwork {
  WarpShape shape;
  std::vector<LinearWeights> hidden;
  LinearWeights last;         // to 3 numbers (a translation) or 6 (rotation vector and velocity)
  size_t begin = 0, end = 0;  // in the field's weights

  WarpNetwork() = default;
  WarpNetwork(const WarpShape& shape, size_t begin);
  bool empty() const { return !shape.any(); }
  // `layer` numbers the field's layers, for their random numbers.
  void initialise(uint64_t seed, uint64_t layer, Real* weights) const;
};

// position [3 x samples], code [shape.code x samples] -> canonical position [3 x samples]. The
// window holds shape.position_degrees weights of the encoding's frequencies.
Value record_warp(Tape& tape, const WarpNetwork& network, Value position, Value code,
                  const FrequencyWeights& window);

}  // namespace nerf
