#include "nerf/io/depth_points.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "nerf/io/plane_sweep.h"
#include "scene_statistics.h"

namespace nerf {

namespace {

constexpr size_t kMostPoints = 60000;  // of all maps together
constexpr size_t kMostOfMap = 2500, kLeastOfMap = 100;
constexpr size_t kEnoughLooks = 500;   // into other maps, to tell whether maps fit
constexpr double kLeastAgreed = 0.1;   // share of the looks
constexpr double kThrough = 0.1;       // farther by that is behind, not beside
constexpr double kMostUnknown = 0.01;  // share of pixels, for far to be known

struct Map {
  size_t view;
  Pose pose, to_camera;  // engine coordinates
  const Camera* camera;
  const DepthMap* depth;
};

struct Place {
  Vec3d position;  // engine coordinates
  std::vector<size_t> maps;
};

struct Looks {
  std::vector<Place> places;
  size_t all = 0, agreed = 0, opposed = 0;
};

// Along the optical axis; of panoramas along the ray.
double depth_of(const Camera& camera, const Vec3d& p) {
  return is_panorama(camera) ? length(p) : p.z;
}

// Whether a place of the picture is away from edges as far as a pixel of the map.
double steady_depth(const DepthMap& map, int x, int y) {
  const double middle = map.pixel(x, y);
  if (!(middle > 0)) return 0;
  for (int j = std::max(0, y - 1); j <= std::min(map.height - 1, y + 1); ++j)
    for (int i = std::max(0, x - 1); i <= std::min(map.width - 1, x + 1); ++i) {
      const double z = map.pixel(i, j);
      if (!(std::abs(z - middle) <= kDepthEdge * middle)) return 0;
    }
  return middle;
}

bool is_kept(const Photo& photo, double u, double v) {
  const int x = std::min(photo.width - 1, static_cast<int>(u * photo.width));
  const int y = std::min(photo.height - 1, static_cast<int>(v * photo.height));
  return !photo.masked_out(x, y) && !photo.transparent(x, y);
}

Looks look(const std::vector<Map>& maps, size_t own, const Photo& photo, size_t wanted) {
  const Map& map = maps[own];
  const DepthMap& depth = *map.depth;
  Looks out;
  const double pixels = static_cast<double>(depth.z.size());
  const int every =
      std::max(1, static_cast<int>(std::lround(std::sqrt(pixels / static_cast<double>(wanted)))));
  for (int y = every / 2; y < depth.height; y += every)
    for (int x = every / 2; x < depth.width; x += every) {
      const double z = steady_depth(depth, x, y);
      const double u = (x + 0.5) / depth.width, v = (y + 0.5) / depth.height;
      if (!(z > 0) || !is_kept(photo, u, v)) continue;
      const auto ray = unproject(*map.camera, {u * map.camera->width, v * map.camera->height});
      if (!ray || !(depth_of(*map.camera, *ray) > 0)) continue;
      Place place{map.pose * (*ray * (z / depth_of(*map.camera, *ray))), {own}};
      size_t opposed = 0;
      for (size_t other = 0; other < maps.size(); ++other) {
        const Map& o = maps[other];
        if (other == own) continue;
        const Vec3d p = o.to_camera * place.position;
        const auto pixel = project(*o.camera, p);
        if (!pixel || !(pixel->x >= 0 && pixel->y >= 0 && pixel->x < o.camera->width &&
                        pixel->y < o.camera->height))
          continue;
        const double there = o.depth->at(pixel->x / o.camera->width, pixel->y / o.camera->height);
        const double here = depth_of(*o.camera, p);
        if (!(there > 0)) continue;
        ++out.all;
        if (std::abs(there - here) <= kDepthEdge * here) {
          ++out.agreed;
          place.maps.push_back(other);
        } else if (there > (1 + kThrough) * here) {
          ++out.opposed;
          ++opposed;
        }
      }
      if (opposed < place.maps.size()) out.places.push_back(std::move(place));
    }
  return out;
}

bool knows_nearly_all(const std::vector<Map>& maps) {
  size_t unknown = 0, all = 0;
  for (const Map& map : maps) {
    unknown += static_cast<size_t>(std::ranges::count(map.depth->z, uint16_t{0}));
    all += map.depth->z.size();
  }
  return static_cast<double>(unknown) <= kMostUnknown * static_cast<double>(all);
}

}  // namespace

DepthPoints add_depth_points(Scene& scene, PhotoSet& photos, ThreadPool& pool,
                             const Cancel* cancel) {
  DepthPoints result;
  std::vector<Map> maps;
  for (const int view : scene.train) {
    const size_t v = static_cast<size_t>(view);
    if (photos.photos[v].depth.empty() || scene.views[v].scale != 1) continue;
    const Pose pose = scene.to_engine.apply(scene.views[v].pose);
    maps.push_back({v, pose, pose.inverse(), &photos.cameras[v], &photos.photos[v].depth});
  }
  result.maps = static_cast<int>(maps.size());
  if (maps.empty()) return result;
  const bool has_near = static_cast<int>(scene.points.size()) >= kFewPoints || scene.states_depths;
  std::vector<Looks> looks(maps.size());
  const size_t wanted = std::clamp(kMostPoints / maps.size(), kLeastOfMap, kMostOfMap);
  pool.parallel_for(static_cast<int64_t>(maps.size()), [&](int64_t i) {
    if (cancel && cancel->requested()) throw Cancelled();
    const size_t own = static_cast<size_t>(i);
    looks[own] = look(maps, own, photos.photos[maps[own].view], wanted);
  });
  size_t all = 0, agreed = 0, opposed = 0;
  for (const Looks& l : looks) {
    all += l.all;
    agreed += l.agreed;
    opposed += l.opposed;
  }
  if (all > 0) {
    result.agreed = static_cast<double>(agreed) / static_cast<double>(all);
    result.opposed = static_cast<double>(opposed) / static_cast<double>(all);
  }
  if (all >= kEnoughLooks && (result.agreed < kLeastAgreed || opposed > agreed)) {
    result.rejected = true;
    for (Photo& photo : photos.photos) photo.depth = {};
    return result;
  }
  if (!scene.unbounded) return result;  // which ends where its box does
  std::vector<double> distances;
  for (const Looks& l : looks)
    for (const Place& place : l.places) {
      const auto point = static_cast<int32_t>(scene.points.size());
      scene.points.push_back({scene.to_engine.apply_inverse(place.position), 0,
                              static_cast<int>(place.maps.size()) + 1});
      for (const size_t m : place.maps) {
        scene.observations.push_back({static_cast<int32_t>(maps[m].view), point});
        distances.push_back(length(place.position - maps[m].pose.translation));
      }
      ++result.points;
    }
  if (result.points >= kFewPoints && !has_near) {
    const double far = scene.far;
    internal::set_near_far(distances, scene);
    if (!scene.options.far && !knows_nearly_all(maps)) scene.far = std::max(scene.far, far);
  }
  return result;
}

}  // namespace nerf
