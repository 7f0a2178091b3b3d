// What is seen of inserted objects in one picture.
#pragma once

#include <cstdint>
#include <vector>

#include "nerf/math/ray.h"
#include "nerf/math/vec.h"
#include "nerf/model/layers.h"

namespace nerf::internal {

// Row by row from the top; empty where no object is seen, but for the directions.
struct ObjectPixels {
  std::vector<Vec3> directions;  // unit, camera coordinates; zero where the lens sees nothing
  std::vector<double> far;       // distance of the first surface, engine units; infinite: none
  std::vector<Vec3> background;  // sRGB: what a ray that gets so far sees
  std::vector<Real> opacity;     // of the first surface and what is behind it
  std::vector<Real> cover;       // share of the light that gets so far that surfaces take
  std::vector<double> half;      // distance at which, from `far` on, half of the light is stopped
  std::vector<Vec3> normal;      // there, towards the camera, engine coordinates
  // Where the light that gets to `far` is stopped, front to back, engine distances along the ray;
  // empty where no layer asks for it.
  std::vector<std::vector<DeepSample>> stops;

  bool empty() const { return far.empty(); }
  bool seen(size_t pixel) const { return !far.empty() && far[pixel] < 1e300; }
  // Ends a pixel's ray at the first surface on it.
  void cut(size_t pixel, Ray& ray) const {
    if (seen(pixel)) ray.end_on(far[pixel], background[pixel]);
  }
};

}  // namespace nerf::internal
