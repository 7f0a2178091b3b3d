#include "train/visibility.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

namespace nerf {

namespace {

// What a photo says of a square of its pixels.
enum class Matter { kNone, kSomewhere, kEverywhere };

// Sums of "alpha > 0" over rectangles of a photo, at a quarter of its resolution.
class AlphaTable {
 public:
  static constexpr int kReduce = 4;

  AlphaTable() = default;
  explicit AlphaTable(const Photo& photo)
      : photo_width_(photo.width),
        photo_height_(photo.height),
        width_((photo.width + kReduce - 1) / kReduce),
        height_((photo.height + kReduce - 1) / kReduce),
        sums_(static_cast<size_t>(width_ + 1) * static_cast<size_t>(height_ + 1)) {
    std::vector<uint8_t> any(static_cast<size_t>(width_));
    for (int y = 0; y < height_; ++y) {
      std::ranges::fill(any, uint8_t{0});
      for (int v = kReduce * y; v < std::min(kReduce * (y + 1), photo.height); ++v)
        for (int u = 0; u < photo.width; ++u)
          // A masked-out pixel says nothing: it may be anything.
          any[static_cast<size_t>(u / kReduce)] |=
              !photo.transparent(u, v) || photo.masked_out(u, v);
      for (int x = 0; x < width_; ++x)
        at(x + 1, y + 1) = any[static_cast<size_t>(x)] + at(x, y + 1) + at(x + 1, y) - at(x, y);
    }
  }

  // Of the square of the given half-width (full-size pixels); kSomewhere where it is not all inside
  // the photo.
  Matter matter(double x, double y, double half) const {
    // In double first: what is far outside has no place in an int.
    if (!(x - half >= 0 && y - half >= 0 && x + half < photo_width_ && y + half < photo_height_))
      return Matter::kSomewhere;
    const int x0 = static_cast<int>(std::floor((x - half) / kReduce));
    const int y0 = static_cast<int>(std::floor((y - half) / kReduce));
    const int x1 = static_cast<int>(std::floor((x + half) / kReduce)) + 1;
    const int y1 = static_cast<int>(std::floor((y + half) / kReduce)) + 1;
    const int32_t sum = at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);
    return sum == 0                       ? Matter::kNone
           : sum == (x1 - x0) * (y1 - y0) ? Matter::kEverywhere
                                          : Matter::kSomewhere;
  }

 private:
  size_t place(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(width_ + 1) + static_cast<size_t>(x);
  }
  int32_t& at(int x, int y) { return sums_[place(x, y)]; }
  int32_t at(int x, int y) const { return sums_[place(x, y)]; }
  int photo_width_ = 0, photo_height_ = 0;
  int width_ = 0, height_ = 0;  // of the table
  std::vector<int32_t> sums_;
};

// A training camera in engine coordinates with a cone around its picture.
struct Eye {
  Pose to_camera;
  const Camera* camera;
  double cos_half, sin_half;  // of the cone's half-angle
  double pixels_per_radian;   // an upper bound near the axis
};

// Some lenses spread the middle of their picture further than the focal length says.
double pixels_per_radian_at_axis(const Camera& camera) {
  double most = std::max(camera.fx(), camera.fy());
  const auto axis = project(camera, {0, 0, 1});
  if (!axis) return most;
  constexpr double kStep = 1e-3;
  for (const Vec3d& d : {Vec3d{kStep, 0, 1}, Vec3d{0, kStep, 1}})
    if (const auto at = project(camera, d))
      most = std::max(most, std::hypot(at->x - axis->x, at->y - axis->y) / kStep);
  return most;
}

Eye make_eye(const Pose& pose, const Camera& camera) {
  Eye eye{pose.inverse(), &camera, -1, 0, pixels_per_radian_at_axis(camera)};
  double least = 1;
  for (int i = 0; i <= 8; ++i)
    for (int j = 0; j <= 8; ++j) {
      if (i % 8 && j % 8) continue;  // the border of the picture
      const auto d = unproject(camera, {camera.width * i / 8.0, camera.height * j / 8.0});
      if (!d) return eye;  // wider than the model can say: sees everything
      least = std::min(least, normalized(*d).z);
    }
  eye.cos_half = least;
  eye.sin_half = std::sqrt(std::max(0.0, 1 - least * least));
  return eye;
}

// What an eye says of a ball: outside its picture; wholly transparent; in front of matter all over,
// so that it will never say transparent of a part; or none of these.
enum class Sight { kOutside, kTransparent, kOpaque, kUndecided };

Sight look(const Eye& eye, const AlphaTable* alpha, const Vec3d& centre, double radius) {
  const Vec3d p = eye.to_camera * centre;
  const double distance = length(p);
  if (distance <= radius) return Sight::kUndecided;
  // Angle to the axis against the cone's half-angle widened by the ball's own.
  const double sin_ball = radius / distance;
  const double cos_ball = std::sqrt(1 - sin_ball * sin_ball);
  const double cos_wide = eye.cos_half * cos_ball - eye.sin_half * sin_ball;
  if (eye.cos_half > 0 && p.z / distance < cos_wide) return Sight::kOutside;
  if (!alpha || p.z <= radius) return Sight::kUndecided;
  const auto pixel = project(*eye.camera, p);
  if (!pixel) return Sight::kUndecided;
  // A pinhole's picture of a ball reaches radius / (cos(angle to the axis) (z - radius)) from that
  // of its centre, at a depth of 1. Lenses may bend it a fifth further.
  const double stretch = std::max(1.5, 1.2 * distance / p.z);
  const double half = stretch * radius * eye.pixels_per_radian / (p.z - radius) + 1;
  switch (alpha->matter(pixel->x, pixel->y, half)) {
    case Matter::kNone:
      return Sight::kTransparent;
    case Matter::kEverywhere:
      return Sight::kOpaque;
    case Matter::kSomewhere:
      break;
  }
  return Sight::kUndecided;
}

// Goes from cubes of cells to their halves, down to single cells where alpha can tell them apart
// and else to bricks. A half's ball lies inside its cube's, so that an eye which the cube is
// outside of, or all over matter to, has nothing to say of its halves, and one that finds the cube
// transparent finds them so too.
//
// A cell is off where matte_agreement() of the eyes find it transparent, or all that see it.
class Carver {
 public:
  // Of the cubes to begin with: what a grid's side is a multiple of.
  static constexpr int kSide = 16;

  // eyes: all of one moment. tables: of each eye, or none. Counts in `off` (of the cascade's cells)
  // how often a cell was found to be off.
  Carver(std::span<const Eye> eyes, std::span<const AlphaTable> tables, bool keep_unseen,
         const OccupancyGrid& grid, int cascade, std::span<uint16_t> off)
      : eyes_(eyes),
        tables_(tables),
        keep_unseen_(keep_unseen),
        agreement_(matte_agreement(eyes.size())),
        cascade_(cascade),
        last_(tables.empty() ? 4 : 1),
        grid_(grid),
        off_(off) {}

  void carve(const std::array<int, 3>& at) {
    std::vector<int> all(eyes_.size());
    std::iota(all.begin(), all.end(), 0);
    carve(at, kSide, all, {}, 0);
  }

 private:
  // Of the eyes that see all of a cube.
  struct Votes {
    int transparent = 0;  // find it so
    bool matter = false;  // some other eye may have matter before or in it
  };

  // Of the cube of `side` cells from `at` on, which the eyes of `asked` are yet to judge, and of
  // which the others have said `votes`. Moves the eyes that find it transparent to the front of
  // `asked`: what one half is transparent to, the next may be as well.
  void carve(const std::array<int, 3>& at, int side, std::span<int> asked, Votes votes,
             size_t level) {
    const Real w = grid_.cell_width(cascade_);
    const double half = 0.5 * side * w;
    const Vec3d centre =
        grid_.cell_corner(grid_.cell_at(at), cascade_).cast<double>() + Vec3d{half, half, half};
    const double radius = half * std::sqrt(3.0);
    std::vector<int>& undecided = undecided_[level];
    undecided.clear();
    size_t front = 0;
    for (size_t i = 0; i < asked.size(); ++i) {
      const size_t e = static_cast<size_t>(asked[i]);
      switch (look(eyes_[e], tables_.empty() ? nullptr : &tables_[e], centre, radius)) {
        case Sight::kOutside:
          break;
        case Sight::kTransparent:
          if (++votes.transparent >= agreement_) return switch_off(at, side);
          std::swap(asked[i], asked[front++]);
          break;
        case Sight::kOpaque:
          votes.matter = true;
          break;
        case Sight::kUndecided:
          undecided.push_back(asked[i]);
          if (tables_.empty() && side == last_) return;
          break;
      }
    }
    if (undecided.empty()) {
      if (!votes.matter && (votes.transparent > 0 || !keep_unseen_)) switch_off(at, side);
      return;
    }
    const bool may_agree =
        votes.transparent + static_cast<int>(undecided.size()) >= agreement_ || !votes.matter;
    if (side == last_ || !may_agree) return;
    const int h = side / 2;
    for (int i = 0; i < 8; ++i)
      carve({at[0] + (i & 1) * h, at[1] + (i >> 1 & 1) * h, at[2] + (i >> 2) * h}, h, undecided,
            votes, level + 1);
  }

  void switch_off(const std::array<int, 3>& at, int side) {
    for (int z = at[2]; z < at[2] + side; ++z)
      for (int y = at[1]; y < at[1] + side; ++y)
        for (int x = at[0]; x < at[0] + side; ++x)
          ++off_[static_cast<size_t>(grid_.cell_at({x, y, z}))];
  }

  std::span<const Eye> eyes_;
  std::span<const AlphaTable> tables_;
  bool keep_unseen_;
  int agreement_, cascade_, last_;
  const OccupancyGrid& grid_;
  std::span<uint16_t> off_;
  std::array<std::vector<int>, 5> undecided_;  // of cubes of 16, 8, 4, 2 and 1 cells
};

// The eyes of one moment, and their photos and tables where alpha carves.
struct Moment {
  std::vector<Eye> eyes;
  std::vector<const Photo*> photos;
  std::vector<AlphaTable> tables;
};

}  // namespace

void switch_off_impossible_cells(const Scene& scene, const PhotoSet& photos,
                                 const TrainOptions& options, ThreadPool& pool,
                                 OccupancyGrid& grid) {
  // Where lines have poses of their own, the hull that is seen from one is too small.
  const bool carves = scene.alpha && !options.grid_recipe.keep_transparent &&
                      !options.grid_recipe.cameras.rolling_shutter.any();
  const bool keep_unseen = options.grid_recipe.keep_unseen;
  if (keep_unseen && !carves) return;
  std::map<double, Moment> moments;  // where alpha carves; else all in one
  for (const int v : scene.train) {
    const View& view = scene.views[static_cast<size_t>(v)];
    // The same photo at another size is not another one's agreement.
    if (view.scale > 1) continue;
    Moment& moment = moments[carves ? view.time : 0];
    moment.eyes.push_back(
        make_eye(scene.to_engine.apply(view.pose), photos.cameras[static_cast<size_t>(v)]));
    if (!carves) continue;
    moment.photos.push_back(&photos.photos[static_cast<size_t>(v)]);
    moment.tables.emplace_back();
  }
  std::vector<std::pair<const Photo*, AlphaTable*>> tables;
  for (auto& [time, moment] : moments)
    for (size_t i = 0; i < moment.tables.size(); ++i)
      tables.emplace_back(moment.photos[i], &moment.tables[i]);
  pool.parallel_for(static_cast<int64_t>(tables.size()), [&](int64_t i) {
    const auto& [photo, table] = tables[static_cast<size_t>(i)];
    *table = AlphaTable(*photo);
  });

  const int cubes = grid.side() / Carver::kSide;
  std::vector<uint16_t> off(static_cast<size_t>(grid.cells()));
  for (int cascade = 0; cascade < grid.cascades(); ++cascade) {
    std::ranges::fill(off, uint16_t{0});
    pool.parallel_for(int64_t{cubes} * cubes * cubes, [&](int64_t i) {
      const int at = static_cast<int>(i);
      for (const auto& [time, moment] : moments)
        Carver(moment.eyes, moment.tables, keep_unseen, grid, cascade, off)
            .carve({at % cubes * Carver::kSide, at / cubes % cubes * Carver::kSide,
                    at / cubes / cubes * Carver::kSide});
    });
    // What was empty at one moment may have held matter at another.
    for (int64_t i = 0; i < grid.cells(); ++i)
      if (off[static_cast<size_t>(i)] == moments.size()) grid.switch_off(cascade, i);
  }
}

}  // namespace nerf
