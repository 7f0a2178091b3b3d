#include "nerf/math/twist.h"

#include <cmath>

#include "nerf/math/camera_paths.h"
#include "nerf/math/refined_camera.h"
#include "rotation_series.h"

namespace nerf {

using internal::turned_twice;

namespace {

// (1 - (x / 2) cot(x / 2)) / x^2, of x^2.
double inverse_ratio(double x2) {
  if (x2 < 1e-2) return 1.0 / 12 + x2 / 720 + x2 * x2 / 30240 + x2 * x2 * x2 / 1209600;
  const double half = 0.5 * std::sqrt(x2);
  return (1 - half * std::cos(half) / std::sin(half)) / x2;
}

}  // namespace

Pose motion_by(const Twist& twist) {
  const Vec3d &w = twist.rotation, &v = twist.translation;
  const double x2 = dot(w, w);
  return {rotation_by(w), v + cross(w, v) * internal::cosine_ratio(x2) +
                              turned_twice(w, v) * internal::sine_ratio(x2)};
}

Twist twist_of(const Pose& motion) {
  const Quaternion q = to_quaternion(motion.rotation);
  const Vec3d axis = Vec3d{q.x, q.y, q.z} * (q.w < 0 ? -1.0 : 1.0);
  const double sine = length(axis), cosine = std::abs(q.w);
  const Vec3d w = axis * (sine > 1e-12 ? 2 * std::atan2(sine, cosine) / sine : 2.0);
  const Vec3d& t = motion.translation;
  return {w, t - cross(w, t) * 0.5 + turned_twice(w, t) * inverse_ratio(dot(w, w))};
}

}  // namespace nerf
