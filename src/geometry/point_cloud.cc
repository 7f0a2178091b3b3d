#include "nerf/geometry/point_cloud.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "nerf/base/error.h"

namespace nerf {

namespace {

struct Seen {
  Vec3 position, normal;
  uint32_t view;
};

bool is_surface(float d) { return d > 0 && d < DepthView::kNothing; }

// The surface's normal at a pixel, view's frame, towards the camera, by the nearer of its
// neighbours along each axis; no value where there are none.
std::optional<Vec3d> normal_at(const DepthView& view, int x, int y) {
  const auto point = [&](int i, int j) -> std::optional<Vec3d> {
    if (i < 0 || j < 0 || i >= view.width || j >= view.height) return std::nullopt;
    const float d = view.depth[static_cast<size_t>(j) * static_cast<size_t>(view.width) +
                               static_cast<size_t>(i)];
    if (!is_surface(d)) return std::nullopt;
    return view.direction(i, j) * double{d};
  };
  const Vec3d here = *point(x, y);
  const auto along = [&](int dx, int dy) -> std::optional<Vec3d> {
    const auto after = point(x + dx, y + dy), before = point(x - dx, y - dy);
    if (!after && !before) return std::nullopt;
    if (!before || (after && length(*after - here) < length(here - *before))) return *after - here;
    return here - *before;
  };
  const auto u = along(1, 0), v = along(0, 1);
  if (!u || !v) return std::nullopt;
  const Vec3d n = normalized(cross(*u, *v));
  if (n == Vec3d()) return std::nullopt;
  return view.to_world.rotation * (dot(n, here) > 0 ? -n : n);
}

// All that a view sees inside the box, each so many pixels.
std::vector<Seen> points_of(const DepthView& view, uint32_t index, const Box3& box, int step) {
  std::vector<Seen> points;
  for (int y = step / 2; y < view.height; y += step)
    for (int x = step / 2; x < view.width; x += step) {
      const float d = view.depth[static_cast<size_t>(y) * static_cast<size_t>(view.width) +
                                 static_cast<size_t>(x)];
      if (!is_surface(d)) continue;
      const Vec3d p = view.to_world * (view.direction(x, y) * double{d});
      bool inside = true;
      for (int k = 0; k < 3; ++k) inside = inside && p[k] > box.min[k] && p[k] < box.max[k];
      if (!inside) continue;
      if (const auto n = normal_at(view, x, y))
        points.push_back({p.cast<Real>(), n->cast<Real>(), index});
    }
  return points;
}

// Cubes of space, numbered. 21 bits for each axis.
class Cubes {
 public:
  Cubes(const Box3& box, double side) : box_(box), side_(side) {}
  uint64_t of(const Vec3& p) const {
    uint64_t key = 0;
    for (int k = 2; k >= 0; --k) {
      const double at = std::floor((static_cast<double>(p[k]) - box_.min[k]) / side_);
      key = key << 21 | (static_cast<uint64_t>(std::clamp(at, 0.0, kMost - 2)) + 1);
    }
    return key;
  }
  static uint64_t neighbour(uint64_t key, int x, int y, int z) {
    return key + static_cast<uint64_t>(int64_t{x} + (int64_t{y} << 21) + (int64_t{z} << 42));
  }
  static constexpr double kMost = (1 << 21) - 2;

 private:
  Box3 box_;
  double side_;
};

size_t count_cubes(const std::vector<Seen>& points, const Cubes& cubes) {
  std::vector<uint64_t> keys;
  keys.reserve(points.size());
  for (const Seen& p : points) keys.push_back(cubes.of(p.position));
  std::sort(keys.begin(), keys.end());
  return static_cast<size_t>(std::unique(keys.begin(), keys.end()) - keys.begin());
}

struct Place {
  uint64_t cube;
  Vec3 position, normal;
};

std::vector<Place> mean_places(const std::vector<Seen>& points, const Cubes& cubes,
                               int least_views) {
  std::vector<std::pair<uint64_t, uint32_t>> order;
  order.reserve(points.size());
  for (size_t i = 0; i < points.size(); ++i)
    order.emplace_back(cubes.of(points[i].position), static_cast<uint32_t>(i));
  std::sort(order.begin(), order.end());
  std::vector<Place> places;
  for (size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    Vec3d position, normal;
    int views = 0;
    uint32_t last = 0xffffffff;
    // Points stand in the order of their views.
    for (end = begin; end < order.size() && order[end].first == order[begin].first; ++end) {
      const Seen& p = points[order[end].second];
      position = position + p.position.cast<double>();
      normal = normal + p.normal.cast<double>();
      views += p.view != last;
      last = p.view;
    }
    normal = normalized(normal);
    if (views < least_views || normal == Vec3d()) continue;
    places.push_back({order[begin].first,
                      (position / static_cast<double>(end - begin)).cast<Real>(),
                      normal.cast<Real>()});
  }
  return places;
}

}  // namespace

TriangleMesh points_from_depths(std::span<const DepthView> views, const PointOptions& options,
                                ThreadPool& pool) {
  NERF_CHECK(!options.box.empty() && options.points > 0);
  int64_t pixels = 0;
  for (const DepthView& view : views) pixels += int64_t{view.width} * view.height;
  constexpr int64_t kMostPixels = 60'000'000;
  int step = 1;
  while (pixels / (int64_t{step} * step) > kMostPixels) ++step;
  std::vector<std::vector<Seen>> of_view(views.size());
  pool.parallel_for(static_cast<int64_t>(views.size()), [&](int64_t v) {
    const size_t i = static_cast<size_t>(v);
    of_view[i] = points_of(views[i], static_cast<uint32_t>(i), options.box, step);
  });
  std::vector<Seen> points;
  for (auto& some : of_view) {
    points.insert(points.end(), some.begin(), some.end());
    some = {};
  }
  TriangleMesh cloud;
  if (points.empty()) return cloud;
  // A surface passes as many cubes as the square of their number along a side: twice is enough.
  const Vec3d size = options.box.size();
  const double longest = std::max({size.x, size.y, size.z}), least = longest / Cubes::kMost;
  // Cubes that few pixels meet would be dropped for want of views and neighbours.
  constexpr double kPixels = 8;  // in a cube, in the mean
  const double most = std::max(1.0, std::min(static_cast<double>(options.points),
                                             static_cast<double>(points.size()) / kPixels));
  double side = std::max(least, longest / 256);
  for (int i = 0; i < 2; ++i) {
    const size_t n = count_cubes(points, {options.box, side});
    side = std::max(least, side * std::sqrt(static_cast<double>(n) / most));
  }
  const std::vector<Place> places = mean_places(points, {options.box, side}, options.least_views);
  const auto has = [&](uint64_t cube) {
    const auto at = std::lower_bound(places.begin(), places.end(), cube,
                                     [](const Place& p, uint64_t c) { return p.cube < c; });
    return at != places.end() && at->cube == cube;
  };
  std::vector<uint8_t> keep(places.size());
  constexpr size_t kPart = 4096;
  const size_t n = places.size();
  pool.parallel_for(static_cast<int64_t>((n + kPart - 1) / kPart), [&](int64_t part) {
    const size_t begin = static_cast<size_t>(part) * kPart;
    for (size_t i = begin; i < std::min(n, begin + kPart); ++i) {
      int neighbours = 0;
      for (int k = 0; k < 27; ++k)
        neighbours +=
            k != 13 && has(Cubes::neighbour(places[i].cube, k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1));
      keep[i] = neighbours >= options.least_neighbours;
    }
  });
  for (size_t i = 0; i < n; ++i) {
    if (!keep[i]) continue;
    cloud.positions.push_back(places[i].position);
    cloud.normals.push_back(places[i].normal);
  }
  return cloud;
}

}  // namespace nerf
