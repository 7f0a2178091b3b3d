// The window that opens over an encoding's frequencies, coarse ones first, while a deformation is
// learnt (Park et al. 2021, equation 8).
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include "nerf/base/real.h"

namespace nerf {

// weights[k] = (1 - cos(pi clamp(alpha - k, 0, 1))) / 2: `alpha` frequencies are open, 0 to
// weights.size().
inline void window_weights(double alpha, std::span<Real> weights) {
  for (size_t k = 0; k < weights.size(); ++k) {
    const double open = std::clamp(alpha - static_cast<double>(k), 0.0, 1.0);
    weights[k] = static_cast<Real>(0.5 * (1 - std::cos(std::numbers::pi * open)));
  }
}

}  // namespace nerf
