// Rotations between poses and the smooth curve through them.
#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"
#include "nerf/math/camera_paths.h"

namespace nerf {
namespace {

Quaternion operator*(const Quaternion& a, const Quaternion& b) {
  return {
      a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
      a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
}
double dot(const Quaternion& a, const Quaternion& b) {
  return a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
}
Quaternion operator-(const Quaternion& q) { return {-q.w, -q.x, -q.y, -q.z}; }
Quaternion conjugate(const Quaternion& q) { return {q.w, -q.x, -q.y, -q.z}; }
Quaternion normalized(const Quaternion& q) {
  const double n = std::sqrt(dot(q, q));
  return {q.w / n, q.x / n, q.y / n, q.z / n};
}

// Half the rotation vector of a unit quaternion with w >= 0, and the way back.
Vec3d log_of(const Quaternion& q) {
  const Vec3d v{q.x, q.y, q.z};
  const double s = length(v);
  return s > 1e-12 ? v * (std::atan2(s, q.w) / s) : v;
}
Quaternion exp_of(const Vec3d& v) {
  const double angle = length(v);
  const double s = angle > 1e-12 ? std::sin(angle) / angle : 1.0;
  return {std::cos(angle), v.x * s, v.y * s, v.z * s};
}

// Without the choice of the shorter arc, which squad must not make halfway.
Quaternion slerp_as_given(const Quaternion& a, const Quaternion& b, double u) {
  const double c = std::clamp(dot(a, b), -1.0, 1.0);
  const double angle = std::acos(c);
  // Nearly equal, or nearly opposite, which is the same rotation: a straight line between them.
  double p = 1 - u, q = c < 0 ? -u : u;
  if (std::sin(angle) > 1e-6) {
    p = std::sin((1 - u) * angle) / std::sin(angle);
    q = std::sin(u * angle) / std::sin(angle);
  }
  return normalized(
      Quaternion{p * a.w + q * b.w, p * a.x + q * b.x, p * a.y + q * b.y, p * a.z + q * b.z});
}

}  // namespace

Quaternion to_quaternion(const Mat3d& r) {
  const auto& m = r.m;
  const double trace = m[0][0] + m[1][1] + m[2][2];
  Quaternion q;
  // The largest of the four components first: the others are quotients by it.
  if (trace > 0) {
    q = {1 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]};
  } else if (m[0][0] >= m[1][1] && m[0][0] >= m[2][2]) {
    q = {m[2][1] - m[1][2], 1 + m[0][0] - m[1][1] - m[2][2], m[0][1] + m[1][0], m[0][2] + m[2][0]};
  } else if (m[1][1] >= m[2][2]) {
    q = {m[0][2] - m[2][0], m[0][1] + m[1][0], 1 - m[0][0] + m[1][1] - m[2][2], m[1][2] + m[2][1]};
  } else {
    q = {m[1][0] - m[0][1], m[0][2] + m[2][0], m[1][2] + m[2][1], 1 - m[0][0] - m[1][1] + m[2][2]};
  }
  return normalized(q);
}

Mat3d to_rotation(const Quaternion& q) {
  Mat3d r;
  r.m = {
      {{1 - 2 * (q.y * q.y + q.z * q.z), 2 * (q.x * q.y - q.w * q.z), 2 * (q.x * q.z + q.w * q.y)},
       {2 * (q.x * q.y + q.w * q.z), 1 - 2 * (q.x * q.x + q.z * q.z), 2 * (q.y * q.z - q.w * q.x)},
       {2 * (q.x * q.z - q.w * q.y), 2 * (q.y * q.z + q.w * q.x),
        1 - 2 * (q.x * q.x + q.y * q.y)}}};
  return r;
}

Quaternion slerp(const Quaternion& a, const Quaternion& b, double u) {
  return slerp_as_given(a, dot(a, b) < 0 ? -b : b, u);
}

double rotation_angle(const Mat3d& a, const Mat3d& b) {
  const Quaternion q = conjugate(to_quaternion(a)) * to_quaternion(b);
  return 2 * std::atan2(length(Vec3d{q.x, q.y, q.z}), std::abs(q.w));
}

PoseSpline::PoseSpline(std::span<const Pose> keys, double turn_weight) {
  NERF_CHECK(!keys.empty());
  NERF_CHECK(turn_weight > 0);
  // Knots: the square root of each distance. What is nearer than a millionth of the whole way is
  // the same key, and would give a division by almost nothing below.
  std::vector<double> step(keys.size(), 0.0);
  double whole = 0;
  for (size_t i = 1; i < keys.size(); ++i) {
    const double moved = length(keys[i].translation - keys[i - 1].translation);
    const double turned = turn_weight * rotation_angle(keys[i - 1].rotation, keys[i].rotation);
    step[i] = std::sqrt(moved * moved + turned * turned);
    whole += step[i];
  }
  for (size_t i = 0; i < keys.size(); ++i) {
    if (i > 0 && !(step[i] > 1e-6 * whole)) continue;
    Key key;
    key.index = static_cast<int>(i);
    key.position = keys[i].translation;
    key.rotation = to_quaternion(keys[i].rotation);
    if (!keys_.empty()) {
      key.knot = keys_.back().knot + std::sqrt(step[i]);
      if (dot(keys_.back().rotation, key.rotation) < 0) key.rotation = -key.rotation;
    }
    keys_.push_back(key);
  }
  const int n = static_cast<int>(keys_.size());
  for (int i = 0; i < n; ++i) {
    Key& key = keys_[i];
    key.control_in = key.control_out = key.rotation;
    if (n == 1) continue;
    const Key& before = keys_[std::max(0, i - 1)];
    const Key& after = keys_[std::min(n - 1, i + 1)];
    // Derivative at the middle knot of the parabola through three keys; at an end of two keys the
    // straight line's.
    if (i == 0) {
      key.tangent = (after.position - key.position) / (after.knot - key.knot);
    } else if (i == n - 1) {
      key.tangent = (key.position - before.position) / (key.knot - before.knot);
    } else {
      const double h0 = key.knot - before.knot, h1 = after.knot - key.knot;
      const Vec3d v0 = (key.position - before.position) / h0;
      const Vec3d v1 = (after.position - key.position) / h1;
      key.tangent = (v0 * h1 + v1 * h0) / (h0 + h1);
      // The same for the turn, as a vector in the key's own axes; the controls are what gives squad
      // this derivative on either side, whose spans differ.
      const Quaternion inverse = conjugate(key.rotation);
      const Vec3d turn0 = -log_of(inverse * before.rotation);
      const Vec3d turn1 = log_of(inverse * after.rotation);
      const Vec3d rate = (turn0 / h0 * h1 + turn1 / h1 * h0) / (h0 + h1);
      key.control_in = key.rotation * exp_of((turn0 - rate * h0) * 0.5);
      key.control_out = key.rotation * exp_of((rate * h1 - turn1) * 0.5);
    }
  }
}

int PoseSpline::segment(double u, double& fraction) const {
  const double knot = std::clamp(u, 0.0, 1.0) * keys_.back().knot;
  const auto above = std::upper_bound(keys_.begin() + 1, keys_.end() - 1, knot,
                                      [](double x, const Key& key) { return x < key.knot; });
  const int i = static_cast<int>(above - keys_.begin()) - 1;
  fraction = std::clamp((knot - keys_[i].knot) / (keys_[i + 1].knot - keys_[i].knot), 0.0, 1.0);
  return i;
}

Pose PoseSpline::at(double u) const {
  if (keys_.size() == 1) return {to_rotation(keys_[0].rotation), keys_[0].position};
  double s = 0;
  const int i = segment(u, s);
  const Key& a = keys_[i];
  const Key& b = keys_[i + 1];
  const double h = b.knot - a.knot;
  const double s2 = s * s, s3 = s2 * s;
  Pose pose;
  pose.translation = a.position * (2 * s3 - 3 * s2 + 1) + a.tangent * (h * (s3 - 2 * s2 + s)) +
                     b.position * (3 * s2 - 2 * s3) + b.tangent * (h * (s3 - s2));
  pose.rotation =
      to_rotation(slerp_as_given(slerp_as_given(a.rotation, b.rotation, s),
                                 slerp_as_given(a.control_out, b.control_in, s), 2 * s * (1 - s)));
  return pose;
}

PoseSpline::Place PoseSpline::place_of(double u) const {
  if (keys_.size() == 1) return {keys_[0].index, keys_[0].index, 0.0};
  double s = 0;
  const size_t i = static_cast<size_t>(segment(u, s));
  return {keys_[i].index, keys_[i + 1].index, s};
}

}  // namespace nerf
