// The default film: once around what the photos look at, where the photographer walked.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "nerf/math/camera_paths.h"

namespace nerf::internal {

// Engine coordinates, +z up.
struct OrbitInput {
  std::vector<Pose> cameras;  // one or more
  Vec3d focus;                // what they look at
  bool outward = false;       // or away from
  // Densities at points, 1 / engine unit; empty: nothing is known of matter.
  std::function<std::vector<double>(std::span<const Vec3d>)> density;
};

// A level curve of poses over [0, 1] that closes, all looking at the focus (or away from it):
// - at each azimuth as far away and as high as the cameras near that azimuth, their mean by a
//   Gaussian weight of their azimuth; cameras three times as far as most, or as near, do not count;
// - all the way round where no gap between the cameras' azimuths is 90 degrees or more, at a
//   constant angular speed; else to and fro along the arc that they cover, slowing down where it
//   turns, and up and down as far as they were held;
// - where the camera would be in matter, or see nothing but what is right before it, drawn in,
//   raised or lowered (dynamic programming over the whole closed curve, so that it gives way
//   early and smoothly).
// `notes` gets a line where it is no full circle, and where it gives way.
PoseCurve make_orbit(const OrbitInput& input, std::vector<std::string>& notes);

}  // namespace nerf::internal
