#include "nerf/model/network_ray.h"

#include <cmath>

namespace nerf {

namespace {

// Where the ray of a pixel meets the near plane, on the cube.
std::optional<Vec3d> ndc_origin(const NdcFrame& frame, const Camera& camera, const Pose& pose,
                                const Vec2d& pixel) {
  const auto ray = camera_ray(camera, pose, pixel);
  if (!ray) return std::nullopt;
  const auto ndc = to_ndc(frame, ray->origin, ray->direction);
  return ndc ? std::optional(ndc->origin) : std::nullopt;
}

}  // namespace

Real cast_radius(const NetworkField& field, const Camera& camera, const Pose& pose,
                 const Vec2d& pixel) {
  if (field.options.cast != Cast::kCone) return 0;
  if (field.options.space != Space::kNdc)
    return static_cast<Real>(pixel_cone_radius(camera, pixel));
  const auto here = ndc_origin(field.ndc, camera, pose, pixel);
  const auto right = ndc_origin(field.ndc, camera, pose, {pixel.x + 1, pixel.y});
  const auto below = ndc_origin(field.ndc, camera, pose, {pixel.x, pixel.y + 1});
  if (!here || !right || !below) return 0;
  return static_cast<Real>(0.5 * (length(*right - *here) + length(*below - *here)) * 2 /
                           std::sqrt(12.0));
}

std::optional<NetworkRay> sampled_ray(const NetworkField& field, const Ray& given) {
  NetworkRay ray;
  ray.view = given.direction.cast<Real>();
  ray.radius = given.radius;
  ray.photo = given.photo;
  ray.time = given.time;
  ray.background = given.background;
  if (field.options.space != Space::kNdc) {
    ray.origin = given.origin.cast<Real>();
    ray.direction = ray.view;
    return ray;
  }
  const auto ndc = to_ndc(field.ndc, given.origin, given.direction);
  if (!ndc) return std::nullopt;
  ray.origin = ndc->origin.cast<Real>();
  ray.direction = ndc->direction.cast<Real>();
  ray.length = length(ray.direction);
  return ray;
}

double ray_distance(const NetworkField& field, const Ray& ray, double t) {
  if (field.options.space != Space::kNdc) return t;
  const auto ndc = to_ndc(field.ndc, ray.origin, ray.direction);
  return ndc ? ndc_distance(*ndc, t) : 0;
}

double ray_parameter(const NetworkField& field, const Ray& ray, double distance) {
  if (field.options.space != Space::kNdc) return distance;
  const auto ndc = to_ndc(field.ndc, ray.origin, ray.direction);
  return ndc ? ndc_parameter(*ndc, distance) : 0;
}

}  // namespace nerf
