// The equirectangular camera: what camera.h says of every model, for this one. In closed form.
#pragma once

#include <optional>

#include "nerf/math/camera.h"

namespace nerf::internal {

std::optional<Vec2d> project_panorama(const Camera& camera, const Vec3d& direction);
std::optional<Vec3d> unproject_panorama(const Camera& camera, const Vec2d& pixel);
double panorama_cone_radius(const Camera& camera, const Vec2d& pixel);

}  // namespace nerf::internal
