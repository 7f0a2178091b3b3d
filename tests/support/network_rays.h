// Rays of paper methods through the origin, as NetworkLevels takes them.
#pragma once

#include <optional>
#include <vector>

#include "nerf/math/random.h"
#include "nerf/model/network_ray.h"

namespace nerf::test {

// From `distance` before the origin, each in its own direction.
inline std::vector<NetworkRay> some_rays(int count, Real distance) {
  std::vector<NetworkRay> rays;
  for (int i = 0; i < count; ++i) {
    Random random(9, 0, static_cast<uint64_t>(i));
    NetworkRay ray;
    Vec3 d{random.uniform() - 0.5_r, random.uniform() - 0.5_r, -1};
    ray.direction = d / length(d);
    ray.origin = ray.direction * -distance;
    ray.view = ray.direction;
    ray.radius = 0.001_r;
    ray.background = {1, 1, 1};
    ray.target = {0.2_r, 0.4_r, 0.6_r};
    ray.scale = 1.0_r / static_cast<Real>(3 * count);
    ray.random = random;
    rays.push_back(ray);
  }
  return rays;
}

// The ray of a camera's pixel as the field samples it.
inline std::optional<NetworkRay> network_ray(const NetworkField& field, const Camera& camera,
                                             const Pose& pose, const Vec2d& pixel) {
  auto ray = camera_ray(camera, pose, pixel);
  if (!ray) return std::nullopt;
  ray->radius = cast_radius(field, camera, pose, pixel);
  return sampled_ray(field, *ray);
}

}  // namespace nerf::test
