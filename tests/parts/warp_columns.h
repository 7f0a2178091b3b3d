// Warps and sheets (parts/warp.h) as functions of whole values, for gradient_check.h.
#pragma once

#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/math/reference/encoding.h"
#include "nerf/parts/warp.h"

namespace nerf::on_columns {

// The network's outputs.
template <class T, class W>
Columns<T> point_outputs(const PointNetwork& n, const Columns<T>& x, const Columns<T>& code,
                         const std::vector<W>& weights, double open) {
  std::vector<double> window;
  for (int k = 0; k < n.shape.position_degrees; ++k)
    window.push_back(reference::window_weight(open, k));
  const Columns<T> encoded = frequency_encoding(x, window, n.shape.identity);
  const Columns<T> input = concat(encoded, code);
  Columns<T> h = input;
  for (size_t i = 0; i < n.hidden.size(); ++i) {
    if (static_cast<int>(i) + 1 == n.shape.skip)
      h = concat(n.shape.skip_position ? encoded : input, h);
    h = linear(h, weights, n.hidden[i], true);
  }
  return linear(h, weights, n.last, false);
}

template <class T, class W>
Columns<T> warped(const WarpNetwork& n, const Columns<T>& x, const Columns<T>& code,
                  const std::vector<W>& weights, double open) {
  const Columns<T> motion = point_outputs(n, x, code, weights, open);
  return n.kind == WarpKind::kSe3 ? rigid_motion(motion, x) : add(x, motion);
}

}  // namespace nerf::on_columns
