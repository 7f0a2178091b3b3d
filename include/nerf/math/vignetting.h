// How a lens darkens a picture towards its corners (Goldman 2010, equation 3): of the light of a
// pixel 1 + a r^2 + b r^4 + c r^6 arrives, r being its distance from the principal point, 1 as far
// away as a corner is from the picture's middle. Colours are sRGB, light is linear.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "nerf/base/real.h"
#include "nerf/math/camera.h"
#include "nerf/math/srgb.h"

namespace nerf {

inline constexpr int kFalloff = 3;
using Falloff = std::array<double, kFalloff>;  // a, b, c; zeros: none

// The square of a pixel's r. 0 in panoramas, which are not one lens's.
inline double corner_square(const Camera& camera, const Vec2d& pixel) {
  if (is_panorama(camera) || camera.width < 1 || camera.height < 1) return 0;
  const double x = pixel.x - camera.cx(), y = pixel.y - camera.cy();
  const double w = 0.5 * camera.width, h = 0.5 * camera.height;
  return (x * x + y * y) / (w * w + h * h);
}

// What arrives, at the square of r.
template <class T, class Numbers>
T falloff_gain(const Numbers& abc, T square) {
  return T(1) + square * (abc[0] + square * (abc[1] + square * abc[2]));
}

// How much darker, in stops, a corner is than the middle; below 0: brighter. What would be no light
// at all counts as ten stops.
inline double corner_stops(const Falloff& abc) {
  return -std::log2(std::max(falloff_gain(abc, 1.0), std::exp2(-10.0)));
}

// A colour's share of a pixel counts as this much at least where it is divided by it.
inline constexpr double kLeastOpacity = 1e-3;

// Of a pixel over a background, what stands before it in `gain` times the light. Of a colour that
// covers the share `opacity` of its pixel.
template <class T>
void dim(T rgb[3], T opacity, const Vec3& background, T gain) {
  const T share = std::max(opacity, T(kLeastOpacity));
  for (size_t k = 0; k < 3; ++k) {
    const T behind = (1 - opacity) * static_cast<T>(background[static_cast<int>(k)]);
    rgb[k] = behind + share * linear_to_srgb(gain * srgb_to_linear((rgb[k] - behind) / share));
  }
}

}  // namespace nerf
