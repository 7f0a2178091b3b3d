// The number that the field computes with: float, or double in a build with NERF_DOUBLE, which is
// there to tell what of a result is rounding (docs/architecture.md). Files, photos and their
// pixels keep their own types.
#pragma once

namespace nerf {

#ifdef NERF_DOUBLE
using Real = double;
#else
using Real = float;
#endif

// 0.1_r is the Real next to 0.1.
consteval Real operator""_r(long double x) { return static_cast<Real>(x); }

}  // namespace nerf
