// From a camera's pixel to a ray of a network field.
#pragma once

#include <limits>
#include <optional>

#include "nerf/base/real.h"
#include "nerf/math/camera.h"
#include "nerf/math/random.h"
#include "nerf/math/vec.h"
#include "nerf/model/network_field.h"

namespace nerf {

// In the space that the field samples: engine coordinates, where the direction has unit length and
// t is Euclidean distance, or normalised device coordinates.
struct NetworkRay {
  Vec3 origin, direction;
  Vec3 view;        // unit direction in engine coordinates, which colours depend on
  Real length = 1;  // of `direction`
  // Of the pixel's cone at t = 1, or of its cylinder in normalised device coordinates: mean
  // distance to the neighbouring rays, times 2 / sqrt(12).
  Real radius = 0;
  // The part of the way that is drawn, in t; pictures only.
  Real drawn_from = 0, drawn_to = std::numeric_limits<Real>::infinity();
  Vec3 background;
  // Training only.
  int photo = -1;  // whose code the colour may depend on; below 0: none
  Vec3 target;     // colour of the pixel
  Real scale = 0;  // of its squared error, summed over channels, in the loss
  Random random{0, 0, 0};
};

// The ray through an image point (pixels); pose is camera-to-engine, moved to where the ray begins
// (ray_pose() of math/camera.h). Background, target, scale and random are left for the caller. No
// value where the lens has no ray there, or where it does not go forward in normalised device
// coordinates.
std::optional<NetworkRay> cast_ray(const NetworkField& field, const Camera& camera,
                                   const Pose& pose, const Vec2d& pixel);

// Distance in engine units of a t along the ray.
double ray_distance(const NetworkField& field, const Pose& pose, const NetworkRay& ray, double t);

// The t of a distance in engine units: the other way round. Below 0 before the near plane of
// normalised device coordinates.
double ray_parameter(const NetworkField& field, const Pose& pose, const NetworkRay& ray,
                     double distance);

}  // namespace nerf
