// The transfer function of sRGB (IEC 61966-2-1): colours as photos hold them, and linear light.
#pragma once

#include <cmath>

#include "nerf/math/vec.h"

namespace nerf {

// Both go on above 1 as they are below; below 0 they are straight lines.
template <class T>
T srgb_to_linear(T x) {
  return x <= T(0.04045) ? x / T(12.92) : std::pow((x + T(0.055)) / T(1.055), T(2.4));
}
template <class T>
T linear_to_srgb(T x) {
  return x <= T(0.0031308) ? x * T(12.92) : T(1.055) * std::pow(x, 1 / T(2.4)) - T(0.055);
}

inline Vec3d srgb_to_linear(const Vec3d& c) {
  return {srgb_to_linear(c.x), srgb_to_linear(c.y), srgb_to_linear(c.z)};
}
inline Vec3d linear_to_srgb(const Vec3d& c) {
  return {linear_to_srgb(c.x), linear_to_srgb(c.y), linear_to_srgb(c.z)};
}

}  // namespace nerf
