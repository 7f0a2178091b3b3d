// Poses of captures whose frame is to be found.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "nerf/io/scene.h"
#include "test_scenes.h"

namespace nerf::test {

inline constexpr double kDegree = std::numbers::pi / 180;

inline std::vector<View> views_of(const std::vector<Pose>& poses) {
  std::vector<View> views;
  for (const Pose& pose : poses) {
    View view;
    view.pose = pose;
    views.push_back(view);
  }
  return views;
}

inline double angle(const Vec3d& a, const Vec3d& b) { return std::acos(std::min(1.0, dot(a, b))); }

// A rotation without symmetry, so that nothing works by being axis-aligned.
inline Mat3d tilted() {
  return look_at({0, 0, 0}, {0.3, -0.8, 0.5}, normalized(Vec3d{0.2, 0.5, 0.9})).rotation;
}

inline std::vector<Pose> rotated(std::vector<Pose> poses, const Mat3d& r) {
  for (Pose& p : poses) p = {r * p.rotation, r * p.translation};
  return poses;
}

// Level cameras at several heights on an arc, all looking at the origin.
inline std::vector<Pose> arc(int n, double degrees, double low = 0.3, double high = 2.5) {
  std::vector<Pose> poses;
  for (int i = 0; i < n; ++i) {
    const double a = degrees * kDegree * i / (n - 1);
    const double z = i % 2 == 0 ? low : high;
    poses.push_back(look_at({4 * std::cos(a), 4 * std::sin(a), z}, {0, 0, 0}));
  }
  return poses;
}

inline Pose rolled(const Pose& pose, double radians) {
  Mat3d roll;
  roll.m = {{{std::cos(radians), -std::sin(radians), 0},
             {std::sin(radians), std::cos(radians), 0},
             {0, 0, 1}}};
  return {pose.rotation * roll, pose.translation};
}

}  // namespace nerf::test
