// The transfer function of sRGB (IEC 61966-2-1), both ways.
#pragma once

#include <cmath>

#include "nerf/math/vec.h"

namespace nerf {

inline double srgb_to_linear(double x) {
  return x <= 0.04045 ? x / 12.92 : std::pow((x + 0.055) / 1.055, 2.4);
}
inline double linear_to_srgb(double x) {
  return x <= 0.0031308 ? x * 12.92 : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
}

inline Vec3d srgb_to_linear(const Vec3d& c) {
  return {srgb_to_linear(c.x), srgb_to_linear(c.y), srgb_to_linear(c.z)};
}
inline Vec3d linear_to_srgb(const Vec3d& c) {
  return {linear_to_srgb(c.x), linear_to_srgb(c.y), linear_to_srgb(c.z)};
}

}  // namespace nerf
