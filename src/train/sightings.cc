#include "train/sightings.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace nerf {

namespace {

// How far a point's distance may be off, as a share of it: its error in the picture against the
// widest angle between two lines of sight. Infinite where the angle is none.
std::vector<double> uncertainty_of_points(const Scene& scene) {
  struct Fan {
    Vec3d first;  // a line of sight, and the largest distance of another's direction to it
    double width = 0, focal = 0;
    bool any = false;
  };
  std::vector<Fan> fans(scene.points.size());
  for (const Observation& seen : scene.observations) {
    const View& view = scene.views[static_cast<size_t>(seen.image)];
    Fan& fan = fans[static_cast<size_t>(seen.point)];
    const Vec3d along =
        normalized(scene.points[static_cast<size_t>(seen.point)].position - view.pose.translation);
    if (!fan.any) fan.first = along;
    fan.any = true;
    fan.width = std::max(fan.width, length(along - fan.first));
    fan.focal = std::max(fan.focal, scene.cameras[static_cast<size_t>(view.camera)].fx());
  }
  std::vector<double> out;
  for (size_t i = 0; i < fans.size(); ++i) {
    const double pixels = std::max(0.5, scene.points[i].error);
    out.push_back(pixels / (fans[i].focal * fans[i].width));
  }
  return out;
}

}  // namespace

std::vector<Sighting> sightings_of(const Scene& scene, const PhotoSet& photos) {
  constexpr int kFewestViews = 3;
  constexpr double kMostUncertain = 0.01;
  const std::vector<double> uncertainty = uncertainty_of_points(scene);
  std::unordered_map<int32_t, size_t> source_of;  // of a view
  for (size_t i = 0; i < scene.train.size(); ++i)
    source_of.emplace(static_cast<int32_t>(scene.train[i]), i);
  std::vector<Sighting> out;
  for (const Observation& seen : scene.observations) {
    const auto source = source_of.find(seen.image);
    const ScenePoint& point = scene.points[static_cast<size_t>(seen.point)];
    if (source == source_of.end() || point.views < kFewestViews ||
        !(uncertainty[static_cast<size_t>(seen.point)] < kMostUncertain))
      continue;
    const size_t view = static_cast<size_t>(seen.image);
    const Camera& camera = photos.cameras[view];
    const Pose pose = scene.to_engine.apply(scene.views[view].pose);
    const Vec3d away = scene.to_engine.apply(point.position) - pose.translation;
    const auto pixel = project(camera, pose.rotation.transposed() * away);
    if (!pixel || !(pixel->x >= 0 && pixel->y >= 0)) continue;
    const int x = static_cast<int>(pixel->x), y = static_cast<int>(pixel->y);
    if (x >= camera.width || y >= camera.height || photos.photos[view].masked_out(x, y)) continue;
    out.push_back({source->second, seen.point, x, y, length(away)});
  }
  return out;
}

}  // namespace nerf
