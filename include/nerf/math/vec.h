// Small fixed-size vectors and rigid transforms of plain doubles or floats: layout and alignment do
// not depend on compiler flags, so they may appear in public headers.
#pragma once

#include <array>
#include <cmath>

#include "nerf/base/real.h"

namespace nerf {

template <class T>
struct TVec3 {
  T x{}, y{}, z{};
  T& operator[](int i) { return i == 0 ? x : i == 1 ? y : z; }
  const T& operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
  TVec3 operator+(const TVec3& b) const { return {x + b.x, y + b.y, z + b.z}; }
  TVec3 operator-(const TVec3& b) const { return {x - b.x, y - b.y, z - b.z}; }
  TVec3 operator-() const { return {-x, -y, -z}; }
  TVec3 operator*(T s) const { return {x * s, y * s, z * s}; }
  TVec3 operator/(T s) const { return {x / s, y / s, z / s}; }
  bool operator==(const TVec3&) const = default;
  template <class U>
  TVec3<U> cast() const {
    return {static_cast<U>(x), static_cast<U>(y), static_cast<U>(z)};
  }
};
using Vec3 = TVec3<Real>;
using Vec3d = TVec3<double>;

template <class T>
T dot(const TVec3<T>& a, const TVec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
TVec3<T> cross(const TVec3<T>& a, const TVec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <class T>
T length(const TVec3<T>& a) {
  return std::sqrt(dot(a, a));
}
// The zero vector stays zero.
template <class T>
TVec3<T> normalized(const TVec3<T>& a) {
  const T n = length(a);
  return n > T(0) ? a / n : a;
}

template <class T>
struct TVec2 {
  T x{}, y{};
  bool operator==(const TVec2&) const = default;
};
using Vec2 = TVec2<Real>;
using Vec2d = TVec2<double>;

// Row-major 3x3 matrix; m[r][c].
struct Mat3d {
  std::array<std::array<double, 3>, 3> m{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  Vec3d operator*(const Vec3d& v) const {
    return {m[0][0] * v.x + m[0][1] * v.y + m[0][2] * v.z,
            m[1][0] * v.x + m[1][1] * v.y + m[1][2] * v.z,
            m[2][0] * v.x + m[2][1] * v.y + m[2][2] * v.z};
  }
  Mat3d operator*(const Mat3d& b) const {
    Mat3d r;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        r.m[i][j] = m[i][0] * b.m[0][j] + m[i][1] * b.m[1][j] + m[i][2] * b.m[2][j];
    return r;
  }
  Mat3d transposed() const {
    Mat3d r;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) r.m[i][j] = m[j][i];
    return r;
  }
  Vec3d column(int c) const { return {m[0][c], m[1][c], m[2][c]}; }
  void set_column(int c, const Vec3d& v) {
    m[0][c] = v.x;
    m[1][c] = v.y;
    m[2][c] = v.z;
  }
};

// Rigid transform x -> R x + t. A camera pose is camera-to-world: columns of R are the camera's
// x (right), y (down), z (forward) axes in world coordinates, t is the camera's centre.
struct Pose {
  Mat3d rotation;
  Vec3d translation;
  Vec3d operator*(const Vec3d& v) const { return rotation * v + translation; }
  Pose inverse() const {
    Pose p;
    p.rotation = rotation.transposed();
    p.translation = -(p.rotation * translation);
    return p;
  }
};

// x -> scale * rotation * (x - center): input coordinates to engine coordinates.
struct Similarity {
  double scale = 1;
  Mat3d rotation;
  Vec3d center;
  Vec3d apply(const Vec3d& x) const { return rotation * (x - center) * scale; }
  Vec3d apply_inverse(const Vec3d& y) const { return rotation.transposed() * (y / scale) + center; }
  // Moves a camera-to-world pose along; its rotation stays orthonormal.
  Pose apply(const Pose& p) const { return {rotation * p.rotation, apply(p.translation)}; }
  Pose apply_inverse(const Pose& p) const {
    return {rotation.transposed() * p.rotation, apply_inverse(p.translation)};
  }
  Similarity inverse() const {
    return {1 / scale, rotation.transposed(), rotation * center * -scale};
  }
  // First the other one, then this.
  Similarity operator*(const Similarity& first) const {
    return {scale * first.scale, rotation * first.rotation, first.apply_inverse(center)};
  }
};

struct Box3 {
  Vec3d min{1e300, 1e300, 1e300}, max{-1e300, -1e300, -1e300};
  bool empty() const { return !(min.x <= max.x && min.y <= max.y && min.z <= max.z); }
  void extend(const Vec3d& p) {
    for (int i = 0; i < 3; ++i) {
      if (p[i] < min[i]) min[i] = p[i];
      if (p[i] > max[i]) max[i] = p[i];
    }
  }
  Vec3d center() const { return (min + max) * 0.5; }
  Vec3d size() const { return max - min; }
};

}  // namespace nerf
