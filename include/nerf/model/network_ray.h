// A ray in the space that a network field samples.
#pragma once

#include <limits>
#include <optional>

#include "nerf/base/real.h"
#include "nerf/math/camera.h"
#include "nerf/math/random.h"
#include "nerf/math/ray.h"
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
  Real time = 0;  // [0, 1]
  // Training only.
  bool everywhere = false;       // asks for all of its samples, in empty cells too
  int photo = -1;                // whose codes the network may read; below 0: none
  int moment = -1, camera = -1;  // likewise, rows of CodeBooks
  // First and last distance of its samples, in t; far of 0: the field's.
  Real near = 0, far = 0;
  Vec3 target;     // colour of the pixel
  Real depth = 0;  // where its light should end, in t; 0: unknown
  Real scale = 0;  // of its squared error, summed over channels, in the loss
  Random random{0, 0, 0};
};

// What Ray::radius is with this field: of the pixel's cone, of its cylinder in normalised device
// coordinates (see NetworkRay), or 0 where the field casts no cones. camera_to_engine: as
// ray_pose() takes it.
Real cast_radius(const NetworkField& field, const Camera& camera, const Pose& camera_to_engine,
                 const Vec2d& pixel);

// The ray there; radius, photo and background are the given one's. Target, scale, random and what
// is drawn of it are left for the caller. No value where it does not go forward in normalised
// device coordinates.
std::optional<NetworkRay> sampled_ray(const NetworkField& field, const Ray& ray);

// Distance in engine units of a t along the sampled ray.
double ray_distance(const NetworkField& field, const Ray& ray, double t);

// The t of a distance in engine units: the other way round. Below 0 before the near plane of
// normalised device coordinates.
double ray_parameter(const NetworkField& field, const Ray& ray, double distance);

}  // namespace nerf
