// For tests: a sphere of many colours before transparency, seen by cameras all around it, as a
// Scene with photos in memory. Small and quick to learn.
#pragma once

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"

namespace nerf::test {

struct SyntheticCapture {
  Scene scene;
  PhotoSet photos;
};

inline constexpr double kSphereRadius = 0.7;
inline constexpr double kCameraDistance = 3;
inline constexpr double kFieldOfView = 0.7;  // horizontal, radians

// Straight colour and coverage (0 or 1) of what a ray from `origin` along `d` sees.
inline bool sphere_colour(const Vec3d& origin, const Vec3d& d, double rgb[3]) {
  const double b = dot(origin, d), c = dot(origin, origin) - kSphereRadius * kSphereRadius;
  const double root = b * b - c;
  if (root <= 0) return false;
  const Vec3d n = (origin + d * (-b - std::sqrt(root))) / kSphereRadius;
  for (int i = 0; i < 3; ++i) rgb[i] = 0.5 + 0.35 * n[i] + 0.1 * std::sin(7 * n[(i + 1) % 3]);
  return true;
}

// View i of n on a spiral from pole to pole, looking at the origin, the world's z up.
inline Pose spiral_pose(int i, int n) {
  const double z = 0.85 * (2 * (i + 0.5) / n - 1), angle = 2.4 * i;
  const double r = std::sqrt(1 - z * z);
  const Vec3d out{r * std::cos(angle), r * std::sin(angle), z};
  const Vec3d forward = -out, right = normalized(cross(forward, Vec3d{0, 0, 1}));
  Pose pose;
  pose.rotation.set_column(0, right);
  pose.rotation.set_column(1, cross(forward, right));
  pose.rotation.set_column(2, forward);
  pose.translation = out * kCameraDistance;
  return pose;
}

// Each pixel from sub x sub rays; colour(origin, unit direction, rgb) says whether one sees
// anything. Transparent where it does not and where the lens has no ray.
template <class Colour>
Photo photo_of(const Camera& camera, const Pose& pose, int sub, const Colour& colour) {
  Photo photo;
  photo.width = camera.width;
  photo.height = camera.height;
  photo.channels = 4;
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      double sum[3] = {0, 0, 0};
      int hits = 0;
      for (int s = 0; s < sub * sub; ++s) {
        const Vec2d at{x + (s % sub + 0.5) / sub, y + (s / sub + 0.5) / sub};
        double rgb[3];
        const auto d = unproject(camera, at);
        if (!d || !colour(pose.translation, normalized(pose.rotation * *d), rgb)) continue;
        ++hits;
        for (int k = 0; k < 3; ++k) sum[k] += rgb[k];
      }
      for (const double v : sum)
        photo.pixels8.push_back(static_cast<uint8_t>(hits ? std::lround(255 * v / hits) : 0));
      photo.pixels8.push_back(static_cast<uint8_t>(255 * hits / (sub * sub)));
    }
  return photo;
}

inline Photo sphere_photo(const Camera& camera, const Pose& pose, int sub = 3) {
  return photo_of(camera, pose, sub, sphere_colour);
}

inline Camera sphere_camera(int size) {
  Camera camera;
  camera.model = CameraModel::kPinhole;
  camera.width = camera.height = size;
  const double f = 0.5 * size / std::tan(0.5 * kFieldOfView);
  camera.params = {f, f, 0.5 * size, 0.5 * size};
  return camera;
}

// `views` square photos of `size` pixels; every 4th is held out.
inline SyntheticCapture sphere_capture(int views = 6, int size = 32) {
  SyntheticCapture capture;
  Scene& scene = capture.scene;
  scene.root = "sphere";
  scene.alpha = true;
  scene.near = 0.1;
  scene.far = 5;
  scene.cameras = {sphere_camera(size)};
  for (int i = 0; i < views; ++i) {
    View view;
    view.name = "r_" + std::to_string(100 + i);
    view.pose = spiral_pose(i, views);
    scene.views.push_back(view);
    (i % 4 == 0 ? scene.test : scene.train).push_back(i);
    capture.photos.photos.push_back(sphere_photo(scene.cameras[0], view.pose));
    capture.photos.cameras.push_back(scene.cameras[0]);
  }
  return capture;
}

// Sparse points of the sphere, observed by the training photos that they face.
inline void add_sphere_points(Scene& scene, int points = 200) {
  for (int i = 0; i < points; ++i) {
    const Vec3d out = spiral_pose(i, points).translation / kCameraDistance;
    const auto index = static_cast<int32_t>(scene.points.size());
    scene.points.push_back({out * kSphereRadius, 0.5, 3});
    for (const int v : scene.train) {
      const Vec3d& from = scene.views[static_cast<size_t>(v)].pose.translation;
      if (dot(out, from - out * kSphereRadius) > 0.5) scene.observations.push_back({v, index});
    }
  }
}

}  // namespace nerf::test
