// What a capture may say at most. Beyond it a file is damaged, and believing it would ask for
// terabytes or overflow the geometry.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>

#include "nerf/math/camera.h"

namespace nerf::internal {

inline constexpr int kMaxImageSide = 65536;  // pixels
inline constexpr int64_t kMaxImagePixels = int64_t{1} << 30;
inline constexpr const char* kImageSizeHint =
    "image sides are 1 to 65536 pixels, at most 2^30 pixels in all, and focal lengths positive";

// Geocentric metres are 6e6, projected coordinates 1e7: this leaves room for any unit.
inline bool coordinate_ok(const Vec3d& v) {
  constexpr double kMax = 1e12;
  return std::abs(v.x) <= kMax && std::abs(v.y) <= kMax && std::abs(v.z) <= kMax;  // not NaN
}

// What is wrong with a camera, as the end of the sentence "camera 3 ...".
inline std::optional<std::string> camera_problem(const Camera& camera) {
  const int64_t w = camera.width, h = camera.height;
  if (w < 1 || h < 1 || w > kMaxImageSide || h > kMaxImageSide || w * h > kMaxImagePixels) {
    return "says " + std::to_string(w) + " x " + std::to_string(h) + " pixels";
  }
  for (const double p : camera.params) {
    if (!(std::abs(p) <= 1e12)) return "has a parameter that is not finite";
  }
  if (!(camera.fx() > 0 && camera.fy() > 0)) return "has a focal length that is not positive";
  if (is_panorama(camera) && std::abs(w - 2 * h) > std::max<int64_t>(2, w / 50)) {
    return "is EQUIRECTANGULAR of " + std::to_string(w) + " x " + std::to_string(h) +
           " pixels, but 360 x 180 degrees are twice as wide as high: a cropped panorama must be "
           "laid into its whole frame again";
  }
  // A lens that sees nothing in the middle of its picture would give no ray at all.
  if (!unproject(camera, {w / 2.0, h / 2.0})) {
    return "has lens parameters that give the middle of the picture no direction";
  }
  return std::nullopt;
}

}  // namespace nerf::internal
