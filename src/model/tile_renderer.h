// Pictures of the grid method, tile by tile.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

#include "math/wanted_pixels.h"
#include "model/grid_integrator.h"
#include "model/object_pixels.h"
#include "model/ray_layers.h"
#include "nerf/model/renderer.h"
#include "nerf/parts/beam.h"

namespace nerf::internal {

// One thread's renderer of tiles: makes rays of a camera's pixels, which begin where the cone of
// their tile, and then of their block, may first meet matter.
class TileRenderer {
 public:
  // packs: of the field's networks. They, the field and the moment must outlive this.
  TileRenderer(const GridField& field, const GridMoment& moment, const LayerPacks& packs,
               const Camera& camera, const Pose& pose, const ModelInfo& info,
               const RenderOptions& options, const ObjectPixels& objects,
               const std::optional<ObliqueBox>& box, const std::optional<EngineMedium>& medium)
      : occupancy_(moment.occupancy),
        camera_(camera),
        pose_(pose),
        near_(info.near),
        options_(options),
        objects_(objects),
        integrator_(field, moment, packs, options, box, medium) {
    if (options.layers) layers_.emplace(field, *options.layers, info.to_engine);
  }

  // Pixels in columns [x0, x1) and rows [y0, y1): all, or those that `wanted` marks, which is one
  // byte for each pixel of the picture. unit: of depths, per engine unit.
  void render_tile(int x0, int y0, int x1, int y1, const uint8_t* wanted, Frame& frame,
                   double unit) {
    wanted_ = wanted;
    aim(x0, y0, x1, y1);
    const size_t pixels = directions_.size();
    rgb_.assign(3 * pixels, 0.0_r);
    opacity_.assign(pixels, 0.0_r);
    median_.assign(pixels, 0.0);
    RaySink sink{.rgb = rgb_.data(), .opacity = opacity_.data(), .median = median_.data()};
    if (layers_) {
      layers_->begin(pixels, sink);
      rays_.assign(pixels, {});
    }
    integrator_.begin(sink);
    const double tile_clear = clear_distance(x0, y0, x1, y1, near_);
    for (int v = y0; v < y1; v += kBlock)
      for (int u = x0; u < x1; u += kBlock) {
        const int v1 = std::min(v + kBlock, y1), u1 = std::min(u + kBlock, x1);
        if (!any_wanted(u, v, u1, v1)) continue;
        const double clear = clear_distance(u, v, u1, v1, tile_clear);
        for (int y = v; y < v1; ++y)
          for (int x = u; x < u1; ++x)
            if (is_wanted(x, y)) cast(x, y, clear);
      }
    integrator_.finish();
    if (layers_) layers_->finish(rays_, median_);
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x)
        if (is_wanted(x, y)) give(x, y, frame, unit);
  }

  const RenderStatistics& statistics() const { return integrator_.statistics(); }  // of all tiles

 private:
  // Finds the directions of a tile's rays.
  void aim(int x0, int y0, int x1, int y1) {
    tile_x_ = x0;
    tile_y_ = y0;
    tile_width_ = x1 - x0;
    const size_t width = static_cast<size_t>(tile_width_);
    directions_.resize(width * static_cast<size_t>(y1 - y0));
    for (int y = y0; y < y1; ++y)
      unproject_wanted(camera_, x0, y, wanted_ ? wanted_ + pixel(x0, y) : nullptr,
                       std::span(directions_).subspan(static_cast<size_t>(y - y0) * width, width));
    if (!camera_.motion.any()) return;
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) {
        Vec3d& d = directions_[static_cast<size_t>(place_of(x, y))];
        if (d != Vec3d()) d = ray_pose(camera_, {}, {x + 0.5, y + 0.5}).rotation * d;
      }
  }

  int pixel(int x, int y) const { return y * camera_.width + x; }
  bool any_wanted(int x0, int y0, int x1, int y1) const {
    if (!wanted_) return true;
    uint8_t any = 0;
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) any |= wanted_[pixel(x, y)];
    return any != 0;
  }
  bool is_wanted(int x, int y) const { return !wanted_ || wanted_[pixel(x, y)]; }

  // In coordinates of the picture's one pose, of unit length; zero where the lens sees nothing.
  const Vec3d& direction_of(int x, int y) const {
    return directions_[static_cast<size_t>(place_of(x, y))];
  }
  int place_of(int x, int y) const { return (y - tile_y_) * tile_width_ + x - tile_x_; }

  Pose pose_of(int x, int y) const { return ray_pose(camera_, pose_, {x + 0.5, y + 0.5}); }

  // A distance before which none of these pixels' rays meets matter, at least `near`.
  double clear_distance(int x0, int y0, int x1, int y1, double near) const {
    if (options_.unclipped) return 0;
    const auto each = [&](const auto& body) {
      for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x)
          if (const Vec3d& d = direction_of(x, y); d != Vec3d()) body(d);
    };
    Vec3d sum;
    each([&](const Vec3d& d) { sum = sum + d; });
    if (sum == Vec3d()) return near;  // no ray at all
    const Vec3d axis = normalized(sum);
    double spread = 0;
    each([&](const Vec3d& d) { spread = std::max(spread, dot(d - axis, d - axis)); });
    // Columns differ in where their rays begin: none is further away than the whole tile's width.
    // With lines that are read one after another all pixels do.
    const Vec3d origin = pose_of(x0, y0).translation;
    double width = 0;
    const int rows = camera_.motion.any() ? y1 : y0 + 1;
    for (int y = y0; y < rows; ++y)
      for (int x = x0; x < x1; ++x)
        width = std::max(width, length(pose_of(x, y).translation - origin));
    return clear_until(occupancy_, {origin, pose_.rotation * axis, std::sqrt(spread), near, width});
  }

  // A pixel's ray, which meets no matter before `clear`.
  void cast(int x, int y, double clear) {
    const Vec3d& in_camera = direction_of(x, y);
    const int place = place_of(x, y);
    if (in_camera == Vec3d()) {  // nothing is seen but the background
      for (int k = 0; k < 3; ++k) rgb_[static_cast<size_t>(3 * place + k)] = options_.background[k];
      return;
    }
    Ray ray;
    ray.origin = pose_of(x, y).translation;
    ray.direction = pose_.rotation * in_camera;
    ray.near = near_;
    ray.clear = clear;
    ray.time = options_.time;
    ray.background = options_.background;
    objects_.cut(static_cast<size_t>(pixel(x, y)), ray);
    if (layers_) rays_[static_cast<size_t>(place)] = ray;
    integrator_.add(ray, place);
  }

  // A pixel's results go into the picture.
  void give(int x, int y, Frame& frame, double unit) {
    const size_t from = static_cast<size_t>(place_of(x, y)), to = static_cast<size_t>(pixel(x, y));
    // Sums of many colours may end a few roundings above the brightest.
    for (size_t k = 0; k < 3; ++k)
      frame.rgb[3 * to + k] =
          std::min(rgb_[3 * from + k], std::max(1.0_r, options_.background[static_cast<int>(k)]));
    frame.alpha[to] = opacity_[from];
    const Real forward = static_cast<Real>(depth_per_distance(camera_, direction_of(x, y)));
    if (layers_) layers_->give(from, median_[from], forward, to, frame.layers);
    frame.depth_z[to] = static_cast<Real>(median_[from] * forward * unit);
  }

  const OccupancyGrid& occupancy_;
  const Camera& camera_;
  const Pose& pose_;
  double near_;
  const RenderOptions& options_;
  const ObjectPixels& objects_;
  GridIntegrator integrator_;
  static constexpr int kBlock = 8;  // pixels along the side of a part of a tile
  // Of the tile: where it is, its rays' directions row by row, and their results.
  int tile_x_ = 0, tile_y_ = 0, tile_width_ = 0;
  const uint8_t* wanted_ = nullptr;
  std::vector<Vec3d> directions_;
  std::vector<Real> rgb_, opacity_;
  std::vector<double> median_;
  std::optional<RayLayers> layers_;
  std::vector<Ray> rays_;  // with layers only
};

}  // namespace nerf::internal
