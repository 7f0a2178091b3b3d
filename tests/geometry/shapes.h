// For tests: pictures of depth of shapes with a closed form.
#pragma once

#include <cmath>
#include <functional>
#include <vector>

#include "nerf/geometry/depth_fusion.h"

namespace nerf::test {

inline constexpr double kShapeRadius = 0.7;

inline Pose looking_at(const Vec3d& from, const Vec3d& at) {
  const Vec3d forward = normalized(at - from);
  const Vec3d up = std::fabs(forward.z) < 0.9 ? Vec3d{0, 0, 1} : Vec3d{0, 1, 0};
  const Vec3d right = normalized(cross(forward, up));
  Pose pose;
  pose.rotation.set_column(0, right);
  pose.rotation.set_column(1, cross(forward, right));
  pose.rotation.set_column(2, forward);
  pose.translation = from;
  return pose;
}

// distance(origin, unit direction): along the ray; infinite where it meets nothing.
using Shape = std::function<double(const Vec3d&, const Vec3d&)>;

inline DepthView view_of(const Shape& shape, const Pose& pose, int side = 120, double focal = 150) {
  DepthView view;
  view.to_world = pose;
  view.focal = focal;
  view.width = view.height = side;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const Vec3d d = normalized(view.direction(x, y));
      view.depth.push_back(static_cast<float>(shape(pose.translation, pose.rotation * d) * d.z));
    }
  return view;
}

inline double sphere(const Vec3d& o, const Vec3d& d) {
  const double b = dot(o, d), c = dot(o, o) - kShapeRadius * kShapeRadius, root = b * b - c;
  return root < 0 ? double{DepthView::kNothing} : -b - std::sqrt(root);
}

inline Shape plane_at(double x) {
  return [x](const Vec3d& o, const Vec3d& d) {
    return d.x < 0 ? (x - o.x) / d.x : double{DepthView::kNothing};
  };
}

inline std::vector<DepthView> sphere_views() {
  std::vector<DepthView> views;
  for (int i = 0; i < 20; ++i) {
    const double z = 1 - 2 * (i + 0.5) / 20, r = std::sqrt(1 - z * z);
    views.push_back(view_of(
        sphere, looking_at(Vec3d{r * std::cos(2.4 * i), r * std::sin(2.4 * i), z} * 2.5, {})));
  }
  return views;
}

}  // namespace nerf::test
