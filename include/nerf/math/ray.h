// The one ray: from photos, cameras and camera paths to the integral along it.
#pragma once

#include <optional>

#include "nerf/base/real.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"

namespace nerf {

// Engine coordinates. The direction has unit length, so that t is Euclidean distance.
struct Ray {
  Vec3d origin;
  Vec3d direction;
  double near = 0, far = 1e30;  // nothing of what lies outside is seen
  double clear = 0;             // the caller knows of no matter before it (clear_until() of a beam)
  Real radius = 0;              // of the pixel's cone at distance 1; 0: a line
  Real time = 0;                // [0, 1], from the capture's first moment to its last
  int photo = -1;               // whose codes the field may take; below 0: none
  Vec3 background{};            // sRGB, seen behind everything
  bool ends = false;            // at `far`, before the sky of a field that has learnt one
  double medium_from = 0;       // a medium is passed from here to `far`, wherever `near` is

  // Lets it end on something opaque of this colour.
  void end_on(double distance, const Vec3& colour) {
    far = distance;
    background = colour;
    ends = true;
  }
};

// The ray through an image point (pixels). camera_to_engine: as ray_pose() takes it. No value where
// the lens has no ray there. Its cone's radius is left for the caller (pixel_cone_radius()).
inline std::optional<Ray> camera_ray(const Camera& camera, const Pose& camera_to_engine,
                                     const Vec2d& pixel) {
  const auto direction = unproject(camera, pixel);
  if (!direction) return std::nullopt;
  Ray ray;
  const Pose pose = ray_pose(camera, camera_to_engine, pixel);
  ray.origin = pose.translation;
  ray.direction = normalized(pose.rotation * *direction);
  return ray;
}

}  // namespace nerf
