#include "train/visibility.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace nerf {

namespace {

// Sums of "alpha > 0" over rectangles of a photo, at a quarter of its resolution.
class AlphaTable {
 public:
  static constexpr int kReduce = 4;

  explicit AlphaTable(const Photo& photo)
      : width_((photo.width + kReduce - 1) / kReduce),
        height_((photo.height + kReduce - 1) / kReduce),
        sums_(static_cast<size_t>(width_ + 1) * static_cast<size_t>(height_ + 1)) {
    std::vector<uint8_t> any(static_cast<size_t>(width_) * static_cast<size_t>(height_));
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x) {
        Real rgba[4];
        photo.pixel(x, y, rgba);
        // A masked-out pixel says nothing: it may be anything.
        if (rgba[3] > 0 || photo.masked_out(x, y))
          any[static_cast<size_t>(y / kReduce) * static_cast<size_t>(width_) +
              static_cast<size_t>(x / kReduce)] = 1;
      }
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x)
        at(x + 1, y + 1) =
            any[static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x)] +
            at(x, y + 1) + at(x + 1, y) - at(x, y);
  }

  // Whether the square of the given half-width (full-size pixels) holds no opaque pixel and lies
  // inside the photo.
  bool transparent(double x, double y, double half) {
    // In double first: what is far outside has no place in an int.
    if (!(x - half >= 0 && y - half >= 0 && x + half < double{kReduce} * width_ &&
          y + half < double{kReduce} * height_))
      return false;
    const int x0 = static_cast<int>(std::floor((x - half) / kReduce));
    const int y0 = static_cast<int>(std::floor((y - half) / kReduce));
    const int x1 = static_cast<int>(std::floor((x + half) / kReduce)) + 1;
    const int y1 = static_cast<int>(std::floor((y + half) / kReduce)) + 1;
    return at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0) == 0;
  }

 private:
  int32_t& at(int x, int y) {
    return sums_[static_cast<size_t>(y) * static_cast<size_t>(width_ + 1) + static_cast<size_t>(x)];
  }
  int width_, height_;
  std::vector<int32_t> sums_;
};

// A training camera in engine coordinates with a cone around its picture.
struct Eye {
  Pose to_camera;
  const Camera* camera;
  double cos_half, sin_half;  // of the cone's half-angle
  double pixels_per_radian;   // an upper bound near the axis
};

Eye make_eye(const Pose& pose, const Camera& camera) {
  Eye eye{pose.inverse(), &camera, -1, 0, std::max(camera.fx(), camera.fy())};
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

enum class Sight { kOutside, kMatterPossible, kTransparent };

// What an eye says of a ball: outside its picture, possibly matter, or wholly transparent.
Sight look(const Eye& eye, AlphaTable* alpha, const Vec3d& centre, double radius) {
  const Vec3d p = eye.to_camera * centre;
  const double distance = length(p);
  if (distance <= radius) return Sight::kMatterPossible;
  // Angle to the axis against the cone's half-angle widened by the ball's own.
  const double sin_ball = radius / distance;
  const double cos_ball = std::sqrt(1 - sin_ball * sin_ball);
  const double cos_wide = eye.cos_half * cos_ball - eye.sin_half * sin_ball;
  if (eye.cos_half > 0 && p.z / distance < cos_wide) return Sight::kOutside;
  if (!alpha || p.z <= radius) return Sight::kMatterPossible;
  const auto pixel = project(*eye.camera, p);
  if (!pixel) return Sight::kMatterPossible;
  const double half = 1.5 * radius * eye.pixels_per_radian / (p.z - radius) + 1;
  return alpha->transparent(pixel->x, pixel->y, half) ? Sight::kTransparent
                                                      : Sight::kMatterPossible;
}

}  // namespace

void switch_off_impossible_cells(const Scene& scene, const PhotoSet& photos,
                                 const TrainOptions& options, ThreadPool& pool,
                                 OccupancyGrid& grid) {
  std::vector<Eye> eyes;
  for (int v : scene.train)
    eyes.push_back(make_eye(scene.to_engine.apply(scene.views[static_cast<size_t>(v)].pose),
                            photos.cameras[static_cast<size_t>(v)]));
  std::vector<AlphaTable> tables;
  if (scene.alpha && !options.keep_transparent)
    for (int v : scene.train) tables.emplace_back(photos.photos[static_cast<size_t>(v)]);

  if (options.keep_unseen && tables.empty()) return;
  const auto possible = [&](const Vec3& corner, Real width) {
    const double half = 0.5 * width;
    const Vec3d centre = corner.cast<double>() + Vec3d{half, half, half};
    const double radius = half * std::sqrt(3.0);
    bool seen = options.keep_unseen;
    for (size_t e = 0; e < eyes.size(); ++e) {
      const Sight sight = look(eyes[e], tables.empty() ? nullptr : &tables[e], centre, radius);
      if (sight == Sight::kTransparent) return false;
      seen |= sight == Sight::kMatterPossible;
      if (seen && tables.empty()) return true;
    }
    return seen;
  };

  const int64_t bricks = grid.cells() / 64;
  pool.parallel_for(grid.cascades() * bricks, [&](int64_t i) {
    const int c = static_cast<int>(i / bricks);
    const int64_t first = i % bricks * 64;
    const Real w = grid.cell_width(c);
    const bool brick = possible(grid.cell_corner(first, c), 4 * w);
    for (int64_t cell = first; cell < first + 64; ++cell)
      // Single cells only where alpha can tell them apart.
      if (!brick || (!tables.empty() && !possible(grid.cell_corner(cell, c), w)))
        grid.switch_off(c, cell);
  });
}

}  // namespace nerf
