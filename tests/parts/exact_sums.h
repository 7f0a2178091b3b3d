// Kernels that sum in double against golden values.
#pragma once

#include <vector>

#include "nerf/base/real.h"

namespace nerf::test {

using Doubles = std::vector<double>;

inline Doubles doubles(const std::vector<Real>& v) { return {v.begin(), v.end()}; }

// Sums in double of inputs that are floats.
inline constexpr double kSum = 1e-12;

}  // namespace nerf::test
