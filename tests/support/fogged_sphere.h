// For tests: the sphere of synthetic_scene.h seen through a medium with known coefficients, by
// cameras at many distances.
#pragma once

#include <cmath>

#include "nerf/model/medium.h"
#include "support/synthetic_scene.h"

namespace nerf::test {

// View i of n of it: from 1.4 to 3.4 units away.
inline Pose fogged_pose(int i, int n) {
  Pose pose = spiral_pose(i, n);
  pose.translation = pose.translation * ((1.4 + 2.0 * (i * 5 % 8) / 7) / kCameraDistance);
  return pose;
}

// What a ray from `origin` along `d` sees through a medium without an end.
inline void fogged_colour(const Medium& m, const Vec3d& origin, const Vec3d& d, double rgb[3]) {
  const double b = dot(origin, d), c = dot(origin, origin) - kSphereRadius * kSphereRadius;
  const bool hit = sphere_colour(origin, d, rgb);
  const double distance = hit ? -b - std::sqrt(b * b - c) : 1e9;
  for (int k = 0; k < 3; ++k)
    rgb[k] = (hit ? std::exp(-m.attenuation[k] * distance) * rgb[k] : 0) -
             std::expm1(-m.backscatter[k] * distance) * static_cast<double>(m.colour[k]);
}

inline Photo fogged_photo(const Medium& m, const Camera& camera, const Pose& pose, int sub = 3) {
  return photo_of(camera, pose, sub, [&](const Vec3d& origin, const Vec3d& d, double rgb[3]) {
    fogged_colour(m, origin, d, rgb);
    return true;
  });
}

// `views` square photos without alpha; every 4th is held out.
inline SyntheticCapture fogged_capture(const Medium& medium, int views = 32, int size = 32) {
  SyntheticCapture capture = sphere_capture(views, size);
  capture.scene.alpha = false;
  for (int i = 0; i < views; ++i) {
    View& view = capture.scene.views[static_cast<size_t>(i)];
    view.pose = fogged_pose(i, views);
    capture.photos.photos[static_cast<size_t>(i)] =
        fogged_photo(medium, capture.scene.cameras[0], view.pose);
  }
  return capture;
}

}  // namespace nerf::test
