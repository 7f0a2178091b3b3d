// How exact the templates of math/reference are in double.
#pragma once

#include <algorithm>
#include <cmath>

namespace nerf::test {

// Values and derivatives by complex step or dual numbers are exact up to a few roundings: neither
// cancels.
inline constexpr double kExact = 1e-11;
inline double tolerance(double want) { return kExact * std::max(1.0, std::fabs(want)); }

}  // namespace nerf::test
