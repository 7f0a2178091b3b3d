// Normalised device coordinates of a forward-facing capture (Mildenhall et al. 2020, appendix C):
// what a reference camera sees, from its near plane to infinity, becomes the cube [-1, 1]^3, and
// lines stay lines.
#pragma once

#include <cmath>
#include <limits>
#include <optional>

#include "nerf/math/vec.h"

namespace nerf {

// A point p in the reference camera's axes (OpenCV: z forward) becomes
// (scale_x x / z, scale_y y / z, 1 - 2 near / z).
struct NdcFrame {
  Pose reference;                   // camera-to-world of the reference camera
  double scale_x = 1, scale_y = 1;  // focal length over half the picture's size
  double near = 1;                  // depth of the near plane, > 0
};

// A ray in normalised device coordinates, for t in [0, 1): t = 0 on the near plane, 1 at infinity.
// The direction's length is that of the whole way through the cube.
struct NdcRay {
  Vec3d origin, direction;
  double depth = 0;    // of the point t = 0 in the reference camera's axes: the near plane's
  double forward = 0;  // z component of the world ray's direction there
  double start = 0;    // distance along the world ray up to t = 0
};

// No value where the ray does not go forward in the reference camera's axes (equations 24 to 26,
// with z turned round).
inline std::optional<NdcRay> to_ndc(const NdcFrame& frame, const Vec3d& origin,
                                    const Vec3d& direction) {
  const Mat3d to_camera = frame.reference.rotation.transposed();
  Vec3d o = to_camera * (origin - frame.reference.translation);
  const Vec3d d = to_camera * direction;
  if (!(d.z > 1e-6 * length(d))) return std::nullopt;
  NdcRay ray;
  ray.start = (frame.near - o.z) / d.z;
  o = o + d * ray.start;
  o.z = frame.near;
  ray.depth = frame.near;
  ray.forward = d.z;
  ray.origin = {frame.scale_x * o.x / o.z, frame.scale_y * o.y / o.z, 1 - 2 * frame.near / o.z};
  ray.direction = {frame.scale_x * (d.x / d.z - o.x / o.z), frame.scale_y * (d.y / d.z - o.y / o.z),
                   2 * frame.near / o.z};
  return ray;
}

// The point itself; no value behind the reference camera.
inline std::optional<Vec3d> point_to_ndc(const NdcFrame& frame, const Vec3d& p) {
  const Vec3d c = frame.reference.rotation.transposed() * (p - frame.reference.translation);
  if (!(c.z > 0)) return std::nullopt;
  return Vec3d{frame.scale_x * c.x / c.z, frame.scale_y * c.y / c.z, 1 - 2 * frame.near / c.z};
}

// Length in the cube per length in the world, at the point p along the unit direction d: the length
// of point_to_ndc's derivative. A density per unit of the cube times this is one per unit of the
// world. 0 behind the reference camera.
inline double ndc_stretch(const NdcFrame& frame, const Vec3d& p, const Vec3d& d) {
  const Mat3d to_camera = frame.reference.rotation.transposed();
  const Vec3d c = to_camera * (p - frame.reference.translation), g = to_camera * d;
  if (!(c.z > 0)) return 0;
  return length(Vec3d{frame.scale_x * (g.x - c.x * g.z / c.z),
                      frame.scale_y * (g.y - c.y * g.z / c.z), 2 * frame.near * g.z / c.z}) /
         c.z;
}

// Distance along the world ray of a t in [0, 1); infinite for 1.
inline double ndc_distance(const NdcRay& ray, double t) {
  return ray.start + (ray.depth / (1 - t) - ray.depth) / ray.forward;
}

// The other way round: below 0 before the near plane, -infinity from the camera's plane on back.
inline double ndc_parameter(const NdcRay& ray, double distance) {
  const double depth = ray.depth + (distance - ray.start) * ray.forward;
  return depth > 0 ? 1 - ray.depth / depth : -std::numeric_limits<double>::infinity();
}

}  // namespace nerf
