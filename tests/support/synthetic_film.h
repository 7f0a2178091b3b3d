// For tests: the sphere of synthetic_scene.h filmed on the way around it, by a camera whose rows
// are read one after another. Each row is drawn from where the camera is by then on its path, which
// knows nothing of twists.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "support/synthetic_scene.h"

namespace nerf::test {

// Where the camera is `t` frames after the first: it goes round in some 24 frames, rises and falls,
// pans and sways.
inline Pose film_pose(double t) {
  const double angle = 0.26 * t, height = 0.7 * std::sin(0.4 * t), sway = 0.15 * std::sin(0.5 * t);
  const double pan = 0.18 * std::sin(0.35 * t + 1);
  const Vec3d out{std::cos(angle) * std::cos(height), std::sin(angle) * std::cos(height),
                  std::sin(height)};
  const Vec3d forward = -out, level = normalized(cross(forward, Vec3d{0, 0, 1}));
  const Vec3d down = cross(forward, level);
  Pose pose;
  const Vec3d right = level * std::cos(sway) + down * std::sin(sway);
  pose.rotation.set_column(0, right * std::cos(pan) - forward * std::sin(pan));
  pose.rotation.set_column(1, down * std::cos(sway) - level * std::sin(sway));
  pose.rotation.set_column(2, forward * std::cos(pan) + right * std::sin(pan));
  pose.translation = out * kCameraDistance;
  return pose;
}

// A sphere of many stripes.
inline bool film_colour(const Vec3d& origin, const Vec3d& d, double rgb[3]) {
  double smooth[3];
  if (!sphere_colour(origin, d, smooth)) return false;
  for (int i = 0; i < 3; ++i) rgb[i] = 0.5 + 0.45 * std::sin(5 * smooth[i] + i);
  return true;
}

// Frame t, in whose middle the camera is at film_pose(t); its rows take `readout` of the time to
// the next frame.
inline Photo film_photo(const Camera& camera, double t, double readout) {
  Photo photo;
  for (int y = 0; y < camera.height; ++y) {
    const double share = (y + 0.5) / camera.height - 0.5;
    const Photo row = photo_of(camera.rows(y, 1), film_pose(t + share * readout), 3, film_colour);
    photo.pixels8.insert(photo.pixels8.end(), row.pixels8.begin(), row.pixels8.end());
  }
  photo.width = camera.width;
  photo.height = camera.height;
  photo.channels = 4;
  return photo;
}

// The views of a capture become such frames.
inline void film(SyntheticCapture& capture, double readout) {
  for (size_t v = 0; v < capture.scene.views.size(); ++v) {
    const double t = static_cast<double>(v);
    View& view = capture.scene.views[v];
    view.pose = film_pose(t);
    view.clock = t;
    capture.photos.photos[v] = film_photo(capture.photos.cameras[v], t, readout);
  }
}

inline SyntheticCapture film_capture(int frames, int size, double readout) {
  SyntheticCapture capture = sphere_capture(frames, size);
  film(capture, readout);
  return capture;
}

}  // namespace nerf::test
