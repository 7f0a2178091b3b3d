#include "train/free_space.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <set>

#include "nerf/train/motion_recipe.h"

namespace nerf {

namespace {

// Of the distance to the nearest points. What has none may be nearer still, such as fur before a
// wall: a photo's own rays begin early, or they would paint it onto what is behind. Cells need two
// cameras that agree.
constexpr double kNearShare = 0.6, kNearShareOfTwo = 0.9;
constexpr double kNearQuantile = 0.01;  // of the points that a view sees; nearer ones may be wrong
constexpr size_t kEnoughPoints = 20;    // in a view, to tell where its content begins
constexpr double kSightShare = 0.85;    // of a line of sight; a surface has some depth
constexpr int kSureViews = 3;           // of a point that may be nearer than all that a photo saw
constexpr size_t kSurePoints = 4;       // of them, the nearest of which may be wrong
constexpr size_t kMostPoints = 20000;   // that are looked at for each view
const double kHalfDiagonal = 0.5 * std::sqrt(3.0);  // of a cell of width 1

// Parts of a film, each of as many moments of the training photos: what is empty in one may hold
// matter in another. One for all where a camera filmed on its way: each part sees too little of the
// space then (docs/moving.md).
class FilmParts {
 public:
  static constexpr int kMost = 6;

  explicit FilmParts(const Scene& scene) : is_one_(filmed_on_the_way(scene)) {
    std::set<double> moments;
    for (const int v : scene.train) moments.insert(scene.views[static_cast<size_t>(v)].time);
    moments_.assign(moments.begin(), moments.end());
  }
  int count() const {
    return is_one_ ? 1 : static_cast<int>(std::min<size_t>(moments_.size(), kMost));
  }
  // Of a training photo.
  int of(const View& view) const {
    const auto at = std::ranges::lower_bound(moments_, view.time) - moments_.begin();
    return static_cast<int>(at * count() / static_cast<std::ptrdiff_t>(moments_.size()));
  }

 private:
  bool is_one_;
  std::vector<double> moments_;  // ascending
};

// Witnesses of each cell: how many, up to two, and of which parts of the film. The same for any
// order and any number of threads.
class Witnesses {
 public:
  Witnesses(const OccupancyGrid& grid, int parts)
      : grid_(grid),
        all_parts_(static_cast<uint8_t>((1 << parts) - 1)),
        of_(static_cast<size_t>(grid.cascades() * grid.cells())) {}

  void add(int cascade, int64_t cell, int part) {
    const std::atomic_ref of(of_[index(cascade, cell)]);
    const uint8_t before = of.fetch_or(static_cast<uint8_t>(kOne | 1 << part), kRelaxed);
    if (before & kOne && !(before & kTwo)) of.fetch_or(kTwo, kRelaxed);
  }
  // Whether two saw the cell empty, and one in each part of the film.
  bool agree(int cascade, int64_t cell) const {
    const uint8_t of = of_[index(cascade, cell)];
    return of & kTwo && (of & all_parts_) == all_parts_;
  }

  // Every cell that half cell widths along the line meet, once.
  void add_line(const Vec3d& from, const Vec3d& to, int part) {
    const double whole = length(to - from);
    const Vec3d along = (to - from) / whole;
    int last_cascade = -1;
    int64_t last = -1;
    for (double t = 0; t < whole;) {
      const Vec3 p = (from + along * t).cast<Real>();
      const int cascade = grid_.cascade_of(p);
      if (cascade >= grid_.cascades()) return;
      const int64_t cell = grid_.cell_of(p, cascade);
      if (cell != last || cascade != last_cascade) add(cascade, cell, part);
      last = cell;
      last_cascade = cascade;
      t += 0.5 * static_cast<double>(grid_.cell_width(cascade));
    }
  }

  // Cells that lie wholly within `reach` of a camera.
  template <class Counts>
  void add_ball(const Vec3d& centre, double reach, int part, const Counts& counts) {
    const int side = grid_.side();
    for (int c = 0; c < grid_.cascades(); ++c) {
      const double w = static_cast<double>(grid_.cell_width(c));
      std::array<int, 3> lo{}, hi{};
      for (size_t k = 0; k < 3; ++k) {
        const double x = centre[static_cast<int>(k)];
        const auto place = [&](double at) {
          return static_cast<int>(std::clamp(std::floor(at / w) + side / 2, 0.0, side - 1.0));
        };
        lo[k] = place(x - reach);
        hi[k] = place(x + reach);
      }
      for (int z = lo[2]; z <= hi[2]; ++z)
        for (int y = lo[1]; y <= hi[1]; ++y)
          for (int x = lo[0]; x <= hi[0]; ++x) {
            const int64_t cell = grid_.cell_at({x, y, z});
            if (grid_.is_off(c, cell)) continue;
            const double h = 0.5 * w;
            const Vec3d middle = grid_.cell_corner(cell, c).cast<double>() + Vec3d{h, h, h};
            const double farthest = length(middle - centre) + kHalfDiagonal * w;
            if (farthest <= reach && counts(middle, farthest)) add(c, cell, part);
          }
    }
  }

 private:
  size_t index(int cascade, int64_t cell) const {
    return static_cast<size_t>(cascade * grid_.cells() + cell);
  }
  static constexpr uint8_t kOne = 1 << FilmParts::kMost, kTwo = 1 << (FilmParts::kMost + 1);
  static constexpr auto kRelaxed = std::memory_order_relaxed;
  const OccupancyGrid& grid_;
  const uint8_t all_parts_;
  std::vector<uint8_t> of_;
};

// Whether the camera's picture shows the direction.
bool shows(const Camera& camera, const Vec3d& p) {
  const auto pixel = project(camera, p);
  return pixel && pixel->x >= 0 && pixel->y >= 0 && pixel->x < camera.width &&
         pixel->y < camera.height;
}

// A property of all cells of one cascade, by place along each axis.
class CellSet {
 public:
  explicit CellSet(int side)
      : side_(side),
        is_(static_cast<size_t>(side) * static_cast<size_t>(side) * static_cast<size_t>(side)) {}
  uint8_t& at(int x, int y, int z) {
    return is_[(static_cast<size_t>(z) * static_cast<size_t>(side_) + static_cast<size_t>(y)) *
                   static_cast<size_t>(side_) +
               static_cast<size_t>(x)];
  }
  // Takes in cells next to one that is `value`, diagonals included, so that they are so too; what
  // lies outside is as the cell at the border.
  void spread(uint8_t value) {
    const size_t n = static_cast<size_t>(side_);
    std::vector<uint8_t> before;
    for (const size_t stride : {size_t{1}, n, n * n}) {
      before = is_;
      for (size_t i = 0; i < is_.size(); ++i) {
        const size_t place = i / stride % n;
        if ((place > 0 && before[i - stride] == value) ||
            (place + 1 < n && before[i + stride] == value))
          is_[i] = value;
      }
    }
  }

 private:
  int side_;
  std::vector<uint8_t> is_;
};

// Cells that hold a point which two photos agree on, and their neighbours.
std::vector<uint8_t> cells_with_points(const Scene& scene, const OccupancyGrid& grid) {
  std::vector<uint8_t> out(static_cast<size_t>(grid.cascades() * grid.cells()));
  for (const ScenePoint& point : scene.points) {
    if (point.views == 1) continue;  // 0: a point cloud, of which nobody says who sees it
    const Vec3 p = scene.to_engine.apply(point.position).cast<Real>();
    const int cascade = grid.cascade_of(p);
    if (cascade >= grid.cascades()) continue;
    const Real w = grid.cell_width(cascade);
    for (int i = 0; i < 27; ++i) {
      const Vec3 q = p + Vec3{static_cast<Real>(i % 3 - 1), static_cast<Real>(i / 3 % 3 - 1),
                              static_cast<Real>(i / 9 - 1)} *
                             w;
      const int c = grid.cascade_of(q);
      if (c < grid.cascades()) out[static_cast<size_t>(c * grid.cells() + grid.cell_of(q, c))] = 1;
    }
  }
  return out;
}

double nearest(std::vector<double>& distances, size_t least) {
  const size_t n = distances.size();
  const size_t at = std::min(
      n - 1, std::max(least, static_cast<size_t>(
                                 std::lround(kNearQuantile * static_cast<double>(n - 1)))));
  std::nth_element(distances.begin(), distances.begin() + static_cast<std::ptrdiff_t>(at),
                   distances.end());
  return distances[at];
}

// Distances, engine units, to the nearest points of a view's picture, and to the nearest of all.
struct Nearness {
  size_t view;
  double in_picture, around;
};

// Of views that see enough points to tell.
std::vector<Nearness> nearness_of_views(const Scene& scene) {
  std::vector<Nearness> out;
  if (!scene.unbounded || scene.options.near) return out;  // --near says it of every photo
  std::vector<std::vector<double>> seen(scene.views.size());
  for (const Observation& o : scene.observations) {
    const size_t v = static_cast<size_t>(o.image);
    const Vec3d& p = scene.points[static_cast<size_t>(o.point)].position;
    seen[v].push_back(length(p - scene.views[v].pose.translation) * scene.to_engine.scale);
  }
  // What a photo shows but was not recognised in it, others tell.
  std::vector<Vec3d> points;
  for (const ScenePoint& p : scene.points)
    if (p.views == 0 || p.views >= kSureViews) points.push_back(p.position);
  const size_t every = std::max<size_t>(1, points.size() / kMostPoints);
  std::vector<double> in_picture, around;
  for (size_t v = 0; v < seen.size(); ++v) {
    if (seen[v].size() < kEnoughPoints) continue;
    const View& view = scene.views[v];
    const Pose to_camera = view.pose.inverse();
    in_picture.clear();
    around.clear();
    for (size_t i = 0; i < points.size(); i += every) {
      const Vec3d p = to_camera * points[i];
      const double d = length(p) * scene.to_engine.scale;
      around.push_back(d);
      if (shows(scene.cameras[static_cast<size_t>(view.camera)], p)) in_picture.push_back(d);
    }
    double near = nearest(seen[v], 0);
    if (!in_picture.empty()) near = std::min(near, nearest(in_picture, kSurePoints));
    const double any = around.empty() ? near : std::min(near, nearest(around, kSurePoints));
    out.push_back({v, near, any});
  }
  return out;
}

}  // namespace

std::vector<double> near_of_views(const Scene& scene) {
  std::vector<double> near(scene.views.size(), scene.near);
  for (const Nearness& n : nearness_of_views(scene))
    near[n.view] = std::max(near[n.view], kNearShare * n.in_picture);
  // A photo at another scale stands behind the one that points were seen in.
  std::map<std::filesystem::path, double> of_file;
  for (size_t v = 0; v < near.size(); ++v) {
    const View& view = scene.views[v];
    if (view.scale == 1)
      of_file.try_emplace(view.image_path, near[v]);
    else if (const auto it = of_file.find(view.image_path); it != of_file.end())
      near[v] = it->second;
  }
  return near;
}

void switch_off_free_space(const Scene& scene, const PhotoSet& photos, ThreadPool& pool,
                           OccupancyGrid& grid) {
  if (!scene.unbounded || scene.observations.empty()) return;
  std::vector<uint8_t> trains(scene.views.size());
  for (const int v : scene.train) trains[static_cast<size_t>(v)] = 1;
  const FilmParts parts(scene);
  Witnesses witnesses(grid, parts.count());

  pool.parallel_for(static_cast<int64_t>(scene.observations.size()), [&](int64_t i) {
    const Observation& o = scene.observations[static_cast<size_t>(i)];
    const size_t v = static_cast<size_t>(o.image);
    if (!trains[v]) return;
    const Vec3d eye = scene.to_engine.apply(scene.views[v].pose.translation);
    const Vec3d p = scene.to_engine.apply(scene.points[static_cast<size_t>(o.point)].position);
    witnesses.add_line(eye, eye + (p - eye) * kSightShare, parts.of(scene.views[v]));
  });

  const std::vector<Nearness> near = nearness_of_views(scene);
  pool.parallel_for(static_cast<int64_t>(near.size()), [&](int64_t i) {
    const Nearness& n = near[static_cast<size_t>(i)];
    if (!trains[n.view]) return;
    const Pose pose = scene.to_engine.apply(scene.views[n.view].pose), to_camera = pose.inverse();
    witnesses.add_ball(pose.translation, kNearShareOfTwo * n.in_picture,
                       parts.of(scene.views[n.view]), [&](const Vec3d& middle, double farthest) {
                         return farthest <= kNearShareOfTwo * n.around ||
                                shows(photos.cameras[n.view], to_camera * middle);
                       });
  });

  const std::vector<uint8_t> points = cells_with_points(scene, grid);
  pool.parallel_for(grid.cascades(), [&](int64_t i) {
    const int c = static_cast<int>(i);
    const auto each_cell = [&](const auto& body) {
      for (int z = 0; z < grid.side(); ++z)
        for (int y = 0; y < grid.side(); ++y)
          for (int x = 0; x < grid.side(); ++x) body(x, y, z, grid.cell_at({x, y, z}));
    };
    CellSet free(grid.side());
    each_cell(
        [&](int x, int y, int z, int64_t cell) { free.at(x, y, z) = witnesses.agree(c, cell); });
    // Gaps of a cell between lines close. Then the rim goes: a line past an edge crosses a cell
    // that the edge is in.
    free.spread(1);
    free.spread(0);
    free.spread(0);
    each_cell([&](int x, int y, int z, int64_t cell) {
      if (free.at(x, y, z) && !points[static_cast<size_t>(c * grid.cells() + cell)])
        grid.switch_off(c, cell);
    });
  });
}

}  // namespace nerf
