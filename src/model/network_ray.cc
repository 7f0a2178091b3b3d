#include "nerf/model/network_ray.h"

#include <cmath>

namespace nerf {

namespace {

std::optional<Vec3d> world_direction(const Camera& camera, const Pose& pose, const Vec2d& pixel) {
  const auto direction = unproject(camera, pixel);
  if (!direction) return std::nullopt;
  return normalized(pose.rotation * *direction);
}

// Where the ray of a neighbouring pixel meets the near plane, on the cube.
std::optional<Vec3d> ndc_origin(const NdcFrame& frame, const Camera& camera, const Pose& pose,
                                const Vec2d& pixel) {
  const auto d = world_direction(camera, pose, pixel);
  if (!d) return std::nullopt;
  const auto ray = to_ndc(frame, pose.translation, *d);
  return ray ? std::optional(ray->origin) : std::nullopt;
}

}  // namespace

std::optional<NetworkRay> cast_ray(const NetworkField& field, const Camera& camera,
                                   const Pose& pose, const Vec2d& pixel) {
  const auto d = world_direction(camera, pose, pixel);
  if (!d) return std::nullopt;
  NetworkRay ray;
  ray.view = d->cast<Real>();
  if (field.options.space != Space::kNdc) {
    ray.origin = pose.translation.cast<Real>();
    ray.direction = ray.view;
    ray.radius = static_cast<Real>(pixel_cone_radius(camera, pixel));
    return ray;
  }
  const auto ndc = to_ndc(field.ndc, pose.translation, *d);
  if (!ndc) return std::nullopt;
  ray.origin = ndc->origin.cast<Real>();
  ray.direction = ndc->direction.cast<Real>();
  ray.length = length(ray.direction);
  const auto right = ndc_origin(field.ndc, camera, pose, {pixel.x + 1, pixel.y});
  const auto below = ndc_origin(field.ndc, camera, pose, {pixel.x, pixel.y + 1});
  if (right && below)
    ray.radius = static_cast<Real>(
        0.5 * (length(*right - ndc->origin) + length(*below - ndc->origin)) * 2 / std::sqrt(12.0));
  return ray;
}

double ray_distance(const NetworkField& field, const Pose& pose, const NetworkRay& ray, double t) {
  if (field.options.space != Space::kNdc) return t;
  const auto ndc = to_ndc(field.ndc, pose.translation, ray.view.cast<double>());
  return ndc ? ndc_distance(*ndc, t) : 0;
}

double ray_parameter(const NetworkField& field, const Pose& pose, const NetworkRay& ray,
                     double distance) {
  if (field.options.space != Space::kNdc) return distance;
  const auto ndc = to_ndc(field.ndc, pose.translation, ray.view.cast<double>());
  return ndc ? ndc_parameter(*ndc, distance) : 0;
}

}  // namespace nerf
