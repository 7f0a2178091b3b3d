#include "panorama.h"

#include <algorithm>
#include <cmath>

namespace nerf {
namespace {

constexpr double kSlack = 1e-12;  // of an angle: the picture's borders are seen whatever rounding

bool usable(const Camera& camera) {
  const auto& p = camera.params;
  return camera.fx() > 0 && camera.fy() > 0 &&
         std::all_of(p.begin(), p.begin() + 5, [](double x) { return std::isfinite(x); });
}

// Azimuth from the forward axis towards the right one, elevation downwards; radians.
struct Angles {
  double azimuth, down;
};

Angles angles_of(const Camera& camera, const Vec2d& pixel) {
  return {(pixel.x - camera.cx()) / camera.fx(), (pixel.y - camera.cy()) / camera.fy()};
}

Vec3d direction_of(const Angles& a) {
  const double level = std::cos(a.down);
  return {level * std::sin(a.azimuth), std::sin(a.down), level * std::cos(a.azimuth)};
}

}  // namespace

Camera panorama(int width, int height, double azimuths) {
  Camera camera;
  camera.model = CameraModel::kEquirectangular;
  camera.width = width;
  camera.height = height;
  camera.params = {width / azimuths, height / std::numbers::pi, 0.5 * width, 0.5 * height};
  return camera;
}

Pose ray_pose(const Camera& camera, const Pose& given, const Vec2d& pixel) {
  const Pose camera_to_world =
      camera.motion.any() ? line_pose(camera, given, line_share(camera, pixel)) : given;
  if (!is_panorama(camera) || camera.params[4] == 0) return camera_to_world;
  const double azimuth = angles_of(camera, pixel).azimuth;
  const Vec3d right{std::cos(azimuth), 0, -std::sin(azimuth)};
  return {camera_to_world.rotation, camera_to_world * (right * camera.params[4])};
}

double relative_solid_angle(const Camera& camera, double y) {
  if (!is_panorama(camera)) return 1;
  return std::max(0.0, std::cos(angles_of(camera, {0, y}).down));
}

std::optional<Vec2d> internal::project_panorama(const Camera& camera, const Vec3d& d) {
  const double level = std::hypot(d.x, d.z), size = level + std::abs(d.y);
  if (!usable(camera) || !(size > 0) || !std::isfinite(size)) return std::nullopt;
  return Vec2d{camera.fx() * std::atan2(d.x, d.z) + camera.cx(),
               camera.fy() * std::atan2(d.y, level) + camera.cy()};
}

std::optional<Vec3d> internal::unproject_panorama(const Camera& camera, const Vec2d& pixel) {
  const Angles a = angles_of(camera, pixel);
  if (!usable(camera) || !(std::abs(a.azimuth) <= std::numbers::pi + kSlack) ||
      !(std::abs(a.down) <= std::numbers::pi / 2 + kSlack))
    return std::nullopt;
  return direction_of(a);
}

// The neighbours of the last column are those of the first, and a pole has the far side's below it.
double internal::panorama_cone_radius(const Camera& camera, const Vec2d& pixel) {
  if (!usable(camera)) return 0;
  const Vec3d here = direction_of(angles_of(camera, pixel));
  const Vec3d right = direction_of(angles_of(camera, {pixel.x + 1, pixel.y}));
  const Vec3d below = direction_of(angles_of(camera, {pixel.x, pixel.y + 1}));
  return 0.5 * (length(right - here) + length(below - here)) * 2 / std::sqrt(12.0);
}

}  // namespace nerf
