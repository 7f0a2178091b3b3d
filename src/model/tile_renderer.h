// Pictures of the grid method, tile by tile.
#pragma once

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "math/wanted_pixels.h"
#include "model/oblique_box.h"
#include "model/tile_ray.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/renderer.h"
#include "nerf/parts/beam.h"
#include "nerf/parts/ray_sampler.h"

namespace nerf::internal {

// One thread's renderer of tiles.
class TileRenderer {
 public:
  // packs: of the field's networks; must outlive this.
  TileRenderer(const GridField& field, const LayerPacks& packs, const Camera& camera,
               const Pose& pose, double near, const RenderOptions& options,
               const std::optional<ObliqueBox>& box)
      : field_(field),
        camera_(camera),
        pose_(pose),
        near_(near),
        options_(options),
        box_(box),
        tape_(field, /*training=*/false),
        chunk_(tape_.tape),
        shading_(tape_.tape),
        sampler_(field.occupancy, sampler_options(field, options), field.clip) {
    chunk_.weights = shading_.weights = field.weights.data();
    chunk_.packs = shading_.packs = &packs;
    delta_row_ = chunk_.data(tape_.delta);
    direction_rows_ = chunk_.data(tape_.directions);
    for (auto* a : {&x_, &y_, &z_}) *a = AlignedArray<Real>(kChunkSamples);
    for (auto* a : {&geometry_, &shaded_geometry_})
      *a = AlignedArray<Real>(kChunkSamples * geometry_features());
    ray_begin_.resize(kChunkRays + 1);
    shaded_begin_.resize(kChunkRays + 1);
  }

  // Pixels in columns [x0, x1) and rows [y0, y1): all, or those that `wanted` marks, which is one
  // byte for each pixel of the picture.
  void render_tile(int x0, int y0, int x1, int y1, const uint8_t* wanted, Frame& frame,
                   double unit) {
    frame_ = &frame;
    unit_ = unit;
    wanted_ = wanted;
    rays_.clear();
    t_.clear();
    delta_.clear();
    aim(x0, y0, x1, y1);
    const double tile_clear = clear_distance(x0, y0, x1, y1, near_);
    for (int v = y0; v < y1; v += kBlock)
      for (int u = x0; u < x1; u += kBlock) {
        const int v1 = std::min(v + kBlock, y1), u1 = std::min(u + kBlock, x1);
        if (!any_wanted(u, v, u1, v1)) continue;
        const double clear = clear_distance(u, v, u1, v1, tile_clear);
        for (int y = v; y < v1; ++y)
          for (int x = u; x < u1; ++x)
            if (is_wanted(x, y)) march(x, y, clear);
      }
    ask();
    shade();
    // Sums of many colours may end a few roundings above the brightest.
    for (int y = y0; y < y1; ++y) {
      Real* row = frame.rgb.data() + 3 * static_cast<size_t>(y) * static_cast<size_t>(frame.width);
      for (int i = 3 * x0; i < 3 * x1; ++i)
        row[i] = std::min(row[i], std::max(1.0_r, options_.background[i % 3]));
    }
  }

  const RenderStatistics& statistics() const { return statistics_; }  // of all tiles

 private:
  static SamplerOptions sampler_options(const GridField& field, const RenderOptions& options) {
    SamplerOptions s = field.options.sampler;
    s.min_transmittance = options.min_transmittance;
    s.samples_per_cell *= options.sample_factor;
    s.max_samples = std::min(std::max(s.max_samples, options.max_samples), kChunkSamples);
    s.uniform_share = std::clamp(options.uniform_share, 0.0_r, 1e6_r);
    return s;
  }

  // Cuts the ray to the options' box; false where it misses the box.
  bool inside_box(Ray& ray) const {
    return !box_ || box_->clip(ray.origin, ray.direction, ray.near, ray.far);
  }

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

  // In camera coordinates, of unit length; zero where the lens sees nothing.
  const Vec3d& direction_of(int x, int y) const {
    return directions_[static_cast<size_t>((y - tile_y_) * tile_width_ + x - tile_x_)];
  }

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
    const Vec3d origin = pose_of(x0, y0).translation;
    double width = 0;
    for (int x = x0; x < x1; ++x)
      width = std::max(width, length(pose_of(x, y0).translation - origin));
    return clear_until(field_.occupancy,
                       {origin, pose_.rotation * axis, std::sqrt(spread), near, width});
  }

  // Places the samples of a pixel's ray, which meets no matter before `clear`.
  void march(int x, int y, double clear) {
    TileRay ray;
    ray.pixel = pixel(x, y);
    const Vec3d& in_camera = direction_of(x, y);
    if (in_camera == Vec3d()) return finish(ray);
    Ray line;
    line.origin = pose_of(x, y).translation;
    line.direction = pose_.rotation * in_camera;
    line.near = near_;
    line.clear = clear;
    line.time = options_.time;
    if (!inside_box(line)) return finish(ray);
    ++statistics_.rays;
    if (std::isinf(clear)) return finish(ray);
    const int count = options_.unclipped ? sampler_.sample_all(line, 4, samples_)
                                         : sampler_.sample(line, nullptr, true, samples_);
    statistics_.segments += static_cast<int64_t>(sampler_.segments().size());
    if (count == 0) return finish(ray);
    ray.entry = sampler_.entry();
    ray.direction = line.direction.cast<Real>();
    ray.start = sampler_.start();
    ray.forward = static_cast<Real>(depth_per_distance(camera_, in_camera));
    ray.begin = ray.next = t_.size();
    t_.insert(t_.end(), samples_.t.begin(), samples_.t.end());
    delta_.insert(delta_.end(), samples_.delta.begin(), samples_.delta.end());
    ray.end = t_.size();
    rays_.push_back(ray);
  }

  // Asks the network a stretch of every ray after the other, from the camera on: of what lies
  // behind opaque matter at most the rest of a stretch is asked for, and chunks are full
  // nevertheless.
  void ask() {
    geometry_sums_.assign(rays_.size() * geometry_features(), 0.0_r);
    waiting_.resize(rays_.size());
    std::iota(waiting_.begin(), waiting_.end(), size_t{0});
    while (!waiting_.empty()) {
      for (const size_t r : waiting_) {
        const size_t until = std::min(rays_[r].next + kStretch, rays_[r].end);
        while (!rays_[r].finished && rays_[r].next < until) {
          if (samples_used_ == kChunkSamples || parts_ == kChunkRays)
            flush();
          else
            add_part(r, until);
        }
      }
      flush();
      std::erase_if(waiting_, [&](size_t r) { return rays_[r].finished; });
    }
  }

  // As many of the ray's samples before `until` as the chunk has room for.
  void add_part(size_t r, size_t until) {
    constexpr int64_t lr = kChunkRays;
    TileRay& ray = rays_[r];
    part_ray_[parts_] = r;
    part_first_[parts_] = ray.next;
    ray_begin_[static_cast<size_t>(parts_)] = samples_used_;
    const size_t n = std::min(until - ray.next, static_cast<size_t>(kChunkSamples - samples_used_));
    const size_t at = static_cast<size_t>(samples_used_);
    const Real* const delta = delta_.data() + ray.next;
    if (n == kStretch)
      std::copy_n(delta, kStretch, delta_row_ + at);  // without a call
    else
      std::copy_n(delta, n, delta_row_ + at);
    place_samples(field_, ray.entry, ray.direction, t_.data() + ray.next, static_cast<int64_t>(n),
                  x_.data() + at, y_.data() + at, z_.data() + at);
    ray.next += n;
    samples_used_ += static_cast<int>(n);
    for (int k = 0; k < 3; ++k) direction_rows_[k * lr + parts_] = ray.direction[k];
    ++parts_;
    ray_begin_[static_cast<size_t>(parts_)] = samples_used_;
  }

  void flush() {
    if (parts_ == 0) return;
    const int64_t padded = round_up(samples_used_, kLane);
    for (int64_t i = samples_used_; i < padded; ++i) {
      const size_t at = static_cast<size_t>(i);
      x_[at] = y_[at] = z_[at] = 0.5_r;
      delta_row_[i] = 0;
    }
    chunk_.samples = samples_used_;
    chunk_.rays = parts_;
    chunk_.ray_begin = ray_begin_.data();
    encode(field_, {x_.data(), y_.data(), z_.data()}, samples_used_, chunk_.data(tape_.features),
           chunk_.stride(tape_.features));
    tape_.forward_density(chunk_);
    opacity(samples_used_, chunk_.data(tape_.density), delta_row_, alphas_.data());
    const size_t features = geometry_features();
    transpose(samples_used_, static_cast<int64_t>(features), chunk_.data(tape_.geometry),
              chunk_.stride(tape_.geometry), geometry_.data(), static_cast<int64_t>(features));
    statistics_.density_evaluations += samples_used_;
    for (int part = 0; part < parts_; ++part) composite(part, alphas_.data());
    parts_ = samples_used_ = 0;
  }

  // Takes in what the network said of a part of a ray.
  void composite(int part, const Real* alphas) {
    const size_t features = geometry_features(), r = part_ray_[part];
    TileRay& ray = rays_[r];
    Real* const sums = geometry_sums_.data() + r * features;
    const int begin = ray_begin_[static_cast<size_t>(part)];
    const int end = ray_begin_[static_cast<size_t>(part) + 1];
    // In registers: a store to the sums might change what lies in memory.
    double transmittance = ray.transmittance;
    Real unshaded = ray.unshaded, shared = ray.shared;
    for (int i = begin; i < end; ++i) {
      const double alpha = alphas[i];
      const Real w = static_cast<Real>(transmittance * alpha);
      if (unshaded + w <= options_.unshaded) {
        unshaded += w;
      } else {
        if (shared + w > options_.shared_colour) {
          add_shaded(r, shared);
          shared = 0;
        }
        shared += w;
        add_weighted(features, w, geometry_.data() + static_cast<size_t>(i) * features, sums);
      }
      transmittance *= 1 - alpha;
      if (ray.median < 0 && transmittance <= 0.5)
        ray.median = t_[part_first_[part] + static_cast<size_t>(i - begin)];
      // Whatever of the ray was asked for with the others': a pixel is that of its ray alone.
      if (transmittance < options_.stop_transmittance) break;
    }
    ray.transmittance = transmittance;
    ray.unshaded = unshaded;
    ray.shared = shared;
    if (ray.next < ray.end && !(transmittance < options_.stop_transmittance)) return;
    add_shaded(r, shared);
    finish(ray);
  }

  size_t geometry_features() const { return static_cast<size_t>(field_.options.geometry_features); }

  // The features that a ray's samples have summed, of weight `shared`, wait for the colour network
  // with others.
  void add_shaded(size_t r, Real shared) {
    const TileRay& ray = rays_[r];
    if (!(shared > 0)) return;
    if (shaded_ == kChunkSamples) shade();
    const bool same_ray =
        shaded_rays_ > 0 && shaded_pixel_[static_cast<size_t>(shaded_ - 1)] == ray.pixel;
    if (!same_ray) {
      for (int k = 0; k < 3; ++k)
        shading_.data(tape_.directions)[k * kChunkRays + shaded_rays_] = ray.direction[k];
      shaded_begin_[static_cast<size_t>(shaded_rays_++)] = shaded_;
    }
    const Real scale = 1 / shared;
    Real* to = shaded_geometry_.data() + static_cast<size_t>(shaded_) * geometry_features();
    Real* sums = geometry_sums_.data() + r * geometry_features();
    for (size_t f = 0; f < geometry_features(); ++f) {
      to[f] = sums[f] * scale;
      sums[f] = 0;
    }
    shaded_pixel_[static_cast<size_t>(shaded_)] = ray.pixel;
    shaded_weight_[static_cast<size_t>(shaded_)] = shared;
    ++shaded_;
  }

  void shade() {
    if (shaded_ == 0) return;
    shaded_begin_[static_cast<size_t>(shaded_rays_)] = shaded_;
    statistics_.colour_evaluations += shaded_;
    shading_.samples = shaded_;
    shading_.rays = shaded_rays_;
    shading_.ray_begin = shaded_begin_.data();
    const int64_t features = static_cast<int64_t>(geometry_features());
    transpose(features, shaded_, shaded_geometry_.data(), features, shading_.data(tape_.geometry),
              shading_.stride(tape_.geometry));
    tape_.forward_colour(shading_);
    const Real* colour = shading_.data(tape_.colour);
    for (int i = 0; i < shaded_; ++i) {
      const size_t p = static_cast<size_t>(shaded_pixel_[static_cast<size_t>(i)]);
      for (size_t k = 0; k < 3; ++k)
        frame_->rgb[3 * p + k] += shaded_weight_[static_cast<size_t>(i)] *
                                  colour[k * kChunkSamples + static_cast<size_t>(i)];
    }
    shaded_ = shaded_rays_ = 0;
  }

  void finish(TileRay& ray) {
    const size_t p = static_cast<size_t>(ray.pixel);
    for (int k = 0; k < 3; ++k)
      frame_->rgb[3 * p + static_cast<size_t>(k)] +=
          static_cast<Real>(ray.transmittance * options_.background[k]);
    frame_->alpha[p] = static_cast<Real>(1 - ray.transmittance);
    frame_->depth_z[p] =
        ray.median < 0 ? 0.0_r : static_cast<Real>((ray.start + ray.median) * ray.forward * unit_);
    ray.finished = true;
  }

  const GridField& field_;
  const Camera& camera_;
  const Pose& pose_;
  double near_;
  const RenderOptions& options_;
  std::optional<ObliqueBox> box_;
  GridTape tape_;
  Chunk chunk_, shading_;
  Real *delta_row_ = nullptr, *direction_rows_ = nullptr;  // inputs of chunk_
  RaySampler sampler_;
  RaySamples samples_;
  AlignedArray<Real> x_, y_, z_;  // [kChunkSamples]
  AlignedArray<Real> alphas_{kChunkSamples};
  static constexpr int kBlock = 8;       // pixels along the side of a part of a tile
  static constexpr size_t kStretch = 6;  // samples of a ray that are asked for at a time
  // Of the tile: where it is, its rays' directions row by row.
  int tile_x_ = 0, tile_y_ = 0, tile_width_ = 0;
  std::vector<Vec3d> directions_;
  // Of the tile: rays that meet matter, their samples one ray after the other.
  std::vector<TileRay> rays_;
  std::vector<Real> t_, delta_;
  std::vector<size_t> waiting_;      // rays that are not finished
  std::vector<Real> geometry_sums_;  // of each ray: features times weights, to be shaded
  // [kChunkSamples][geometry_features()]: of the chunk's samples, and of what waits for a colour.
  AlignedArray<Real> geometry_, shaded_geometry_;
  // Of the chunk: parts of rays.
  size_t part_ray_[kChunkRays], part_first_[kChunkRays];  // which ray's, and its first sample
  std::vector<int32_t> ray_begin_;
  int parts_ = 0, samples_used_ = 0;
  std::vector<int32_t> shaded_begin_;
  int shaded_pixel_[kChunkSamples];
  Real shaded_weight_[kChunkSamples];
  int shaded_ = 0, shaded_rays_ = 0;
  // Rays take turns, so that each colour may need a direction of its own.
  static_assert(kChunkRays >= kChunkSamples);
  Frame* frame_ = nullptr;
  const uint8_t* wanted_ = nullptr;
  double unit_ = 1;
  RenderStatistics statistics_;
};

}  // namespace nerf::internal
