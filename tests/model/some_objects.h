// For tests: simple objects and the cameras that look at them.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

#include "nerf/geometry/object.h"
#include "nerf/math/srgb.h"
#include "nerf/model/insertion.h"
#include "support/cameras.h"

namespace nerf::test {

// A rectangle from corner a along u and v; its outside is where u, v and it make a right hand.
inline void add_rectangle(const Vec3& a, const Vec3& u, const Vec3& v, int32_t material,
                          SceneObject& object) {
  const auto first = static_cast<uint32_t>(object.mesh.positions.size());
  for (const Vec3& p : {a, a + u, a + u + v, a + v}) object.mesh.positions.push_back(p);
  object.mesh.triangles.push_back({first, first + 1, first + 2});
  object.mesh.triangles.push_back({first, first + 2, first + 3});
  object.material.insert(object.material.end(), 2, material);
}

inline Material unlit(const Vec3d& srgb, double alpha = 1) {
  Material m;
  m.base = srgb_to_linear(srgb);
  m.alpha = alpha;
  m.alpha_mode = AlphaMode::kBlend;
  m.double_sided = m.unlit = true;
  return m;
}

// Upright at x, across the way of a camera that looks along x.
inline SceneObject screen(Real x, double alpha, Real half = 3) {
  SceneObject object;
  object.materials = {unlit({0.2, 0.4, 0.9}, alpha)};
  add_rectangle({x, -half, -half}, {0, 2 * half, 0}, {0, 0, 2 * half}, 0, object);
  return object;
}

// At (-3, 0, 0) or elsewhere, along x, z up.
inline Pose along_x(double x = -3) {
  Pose pose;
  pose.rotation.m = {{{0, 0, 1}, {-1, 0, 0}, {0, -1, 0}}};
  pose.translation = {x, 0, 0};
  return pose;
}

inline Camera narrow() { return pinhole(9, 9, 200); }
inline size_t middle_of(const Frame& f) { return f.alpha.size() / 2; }

inline InsertionOptions without_shadows() {
  InsertionOptions o;
  o.shadows = false;
  return o;
}

inline SceneObject box_around(const Vec3& centre, Real half) {
  SceneObject object;
  object.materials = {unlit({1, 0, 0})};
  for (int axis = 0; axis < 3; ++axis)
    for (const Real side : {-1.0_r, 1.0_r}) {
      Vec3 a = centre - Vec3{half, half, half}, u, v;
      if (side > 0) a[axis] += 2 * half;
      u[(axis + 1) % 3] = v[(axis + 2) % 3] = 2 * half;
      if (side > 0)
        add_rectangle(a, u, v, 0, object);
      else
        add_rectangle(a, v, u, 0, object);
    }
  return object;
}

// Black, at height z.
inline SceneObject black_disc(double z, double radius) {
  SceneObject disc;
  disc.materials = {unlit({0, 0, 0})};
  disc.materials[0].unlit = false;
  constexpr uint32_t kSides = 64;
  disc.mesh.positions.push_back({0, 0, static_cast<Real>(z)});
  for (uint32_t i = 0; i < kSides; ++i) {
    const double a = 2 * std::numbers::pi * i / kSides;
    disc.mesh.positions.push_back(
        Vec3d{radius * std::cos(a), radius * std::sin(a), z}.cast<Real>());
    disc.mesh.triangles.push_back({0, 1 + i, 1 + (i + 1) % kSides});
    disc.material.push_back(0);
  }
  return disc;
}

// Down at a point from the side, so that what is right above it is not in the way.
inline Pose from_above(const Vec3d& at) {
  const Vec3d forward = normalized(Vec3d{1, 0, -0.4});
  Pose pose;
  pose.rotation.set_column(0, {0, -1, 0});
  pose.rotation.set_column(1, cross(forward, Vec3d{0, -1, 0}));
  pose.rotation.set_column(2, forward);
  pose.translation = at - forward * 2.0;
  return pose;
}

}  // namespace nerf::test
