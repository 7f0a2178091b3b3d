#include "train/finest_resolution.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace nerf {

GridOptions resolved(const GridOptions& options, const Scene& scene, const PhotoSet& photos) {
  GridOptions o = options;
  if (o.finest_resolution != 0) return o;
  o.finest_resolution = GridOptions::kFinestUnbounded;
  if (scene.unbounded) return o;
  constexpr double kLeastDistance = 0.25;  // of a camera that stands in the middle of things
  std::vector<double> pixel_widths;        // at the origin, the middle of the region
  for (const int v : scene.train) {
    const View& view = scene.views[static_cast<size_t>(v)];
    if (view.scale > 1) continue;  // the same photo again
    const Camera& camera = photos.cameras[static_cast<size_t>(v)];
    const double apart =
        std::sqrt(3.0) * pixel_cone_radius(camera, {0.5 * camera.width, 0.5 * camera.height});
    const double distance = length(scene.to_engine.apply(view.pose).translation);
    if (apart > 0) pixel_widths.push_back(apart * std::max(distance, kLeastDistance));
  }
  if (pixel_widths.empty()) return o;
  const auto median = pixel_widths.begin() + static_cast<std::ptrdiff_t>(pixel_widths.size() / 2);
  std::nth_element(pixel_widths.begin(), median, pixel_widths.end());
  const double across = 2;  // the region [-1, 1]^3
  o.finest_resolution = static_cast<int>(
      std::lround(std::clamp(across / *median, static_cast<double>(o.base_resolution),
                             static_cast<double>(GridOptions::kFinestUnbounded))));
  return o;
}

}  // namespace nerf
