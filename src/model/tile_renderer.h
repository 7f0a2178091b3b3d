// Pictures of the grid method, tile by tile.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "model/oblique_box.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/renderer.h"
#include "nerf/parts/ray_sampler.h"

namespace nerf::internal {

// A pixel's ray on its way through the network: its samples may span several chunks.
struct PixelState {
  int pixel = 0;
  double transmittance = 1;  // a product of many 1 - alpha; in float thin matter loses its opacity
  Real unshaded = 0;         // weight of the samples left without colour
  Real median = -1;          // distance at which half of the light is stopped
  double start = 0;          // of the march, from the camera
  Real forward = 1;          // cosine between ray and optical axis
  bool continued = false;    // from the chunk before
  Real radius = 0;           // of the pixel's cone at distance 1; GridOptions::sees_cones
};

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
    const size_t points = static_cast<size_t>(field.options.cone_points) * kChunkSamples;
    for (auto* a : {&x_, &y_, &z_, &spread_}) *a = AlignedArray<Real>(points);
    t_.resize(kChunkSamples);
    geometry_sums_.resize(static_cast<size_t>(field.options.geometry_features));
    ray_begin_.resize(kChunkRays + 1);
    shaded_begin_.resize(kChunkRays + 1);
  }

  void render_tile(int x0, int y0, int x1, int y1, Frame& frame, double unit) {
    frame_ = &frame;
    unit_ = unit;
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) render_pixel(x, y);
    flush();
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
    s.min_transmittance = std::min(s.min_transmittance, options.min_transmittance);
    s.samples_per_cell *= options.sample_factor;
    s.max_samples = static_cast<int>(
        std::min(static_cast<Real>(s.max_samples) * options.sample_factor, Real{kChunkSamples}));
    return s;
  }

  // Cuts the ray to the options' box; false where it misses the box.
  bool inside_box(Ray& ray) const {
    return !box_ || box_->clip(ray.origin, ray.direction, ray.near, ray.far);
  }

  void render_pixel(int x, int y) {
    PixelState state;
    state.pixel = y * camera_.width + x;
    const auto direction = unproject(camera_, {x + 0.5, y + 0.5});
    if (!direction) {
      finish(state);
      return;
    }
    const Vec3d in_camera = normalized(*direction);
    Ray ray;
    ray.origin = pose_.translation;
    ray.direction = pose_.rotation * in_camera;
    ray.near = near_;
    if (!inside_box(ray)) {
      finish(state);
      return;
    }
    const int count = options_.unclipped ? sampler_.sample_all(ray, 4, samples_)
                                         : sampler_.sample(ray, nullptr, true, samples_);
    ++statistics_.rays;
    statistics_.segments += static_cast<int64_t>(sampler_.segments().size());
    if (count == 0) {
      finish(state);
      return;
    }
    state.start = sampler_.start();
    state.forward = static_cast<Real>(in_camera.z);
    if (field_.options.sees_cones())
      state.radius = static_cast<Real>(pixel_cone_radius(camera_, {x + 0.5, y + 0.5}));
    const Vec3 d = ray.direction.cast<Real>();
    for (int from = 0; from < count;) {
      if (samples_used_ == kChunkSamples || rays_ == kChunkRays) flush();
      const int take = std::min(count - from, kChunkSamples - samples_used_);
      // A ray goes on in the next chunk only where it does not fit into a whole one.
      if (take < count - from && samples_used_ > 0 && count <= kChunkSamples) {
        flush();
        continue;
      }
      add_part(state, d, from, take, from + take == count);
      from += take;
      if (from < count) {
        flush();
        state = carried_;
      }
    }
  }

  void add_part(const PixelState& state, const Vec3& d, int from, int take, bool last) {
    constexpr int64_t lr = kChunkRays;
    Real* delta = chunk_.data(tape_.delta);
    ConeSample sample{sampler_.entry(), d};
    sample.radius = state.radius;
    for (int i = 0; i < take; ++i) {
      const size_t s = static_cast<size_t>(from + i);
      const size_t at = static_cast<size_t>(samples_used_ + i);
      sample.t = t_[at] = samples_.t[s];
      sample.delta = samples_.delta[s];
      sample.distance = static_cast<Real>(state.start) + sample.t;
      if (s % 2 == 1) {  // neighbours wind against each other, half a step apart
        sample.reversed = true;
        sample.cosine = std::sqrt(3.0_r) / 2;
        sample.sine = 0.5_r;
      } else {
        sample.reversed = false;
        sample.cosine = 1;
        sample.sine = 0;
      }
      place_points(field_, sample, kChunkSamples, x_.data() + at, y_.data() + at, z_.data() + at,
                   field_.options.antialias ? spread_.data() + at : nullptr);
      delta[at] = samples_.delta[s];
    }
    Real* directions = chunk_.data(tape_.directions);
    for (int k = 0; k < 3; ++k) directions[k * lr + rays_] = d[k];
    ray_begin_[static_cast<size_t>(rays_)] = samples_used_;
    states_[static_cast<size_t>(rays_)] = state;
    last_[static_cast<size_t>(rays_)] = last;
    ++rays_;
    samples_used_ += take;
    ray_begin_[static_cast<size_t>(rays_)] = samples_used_;
  }

  void flush() {
    if (rays_ == 0) return;
    const int64_t padded = round_up(samples_used_, kLane);
    Real* delta = chunk_.data(tape_.delta);
    for (int64_t i = samples_used_; i < padded; ++i) {
      for (int64_t j = 0; j < field_.options.cone_points; ++j) {
        const size_t at = static_cast<size_t>(j * kChunkSamples + i);
        x_[at] = y_[at] = z_[at] = 0.5_r;
        spread_[at] = 0;
      }
      delta[i] = 0;
    }
    chunk_.samples = samples_used_;
    chunk_.rays = rays_;
    chunk_.ray_begin = ray_begin_.data();
    encode(field_,
           {x_.data(), y_.data(), z_.data(), field_.options.antialias ? spread_.data() : nullptr,
            field_.options.cone_points, kChunkSamples},
           samples_used_, chunk_.data(tape_.features), chunk_.stride(tape_.features));
    tape_.forward_density(chunk_);
    Real* alphas = alphas_.data();
    opacity(samples_used_, chunk_.data(tape_.density), delta, alphas);
    const Real* geometry = chunk_.data(tape_.geometry);
    const bool per_ray = field_.options.colour_per_ray;
    statistics_.density_evaluations += samples_used_;
    for (int r = 0; r < rays_; ++r) {
      PixelState& state = states_[static_cast<size_t>(r)];
      const int begin = ray_begin_[static_cast<size_t>(r)];
      const int end = ray_begin_[static_cast<size_t>(r) + 1];
      for (int i = begin; i < end; ++i) {
        const double alpha = alphas[i];
        const Real w = static_cast<Real>(state.transmittance * alpha);
        if (per_ray)
          weights_[static_cast<size_t>(i)] = w;
        else if (state.unshaded + w <= options_.unshaded)
          state.unshaded += w;
        else
          add_shaded(state.pixel, r, geometry + i, kChunkSamples, w);
        state.transmittance *= 1 - alpha;
        if (state.median < 0 && state.transmittance <= 0.5)
          state.median = t_[static_cast<size_t>(i)];
      }
      if (per_ray) sum_geometry(begin, end, state.continued);
      if (last_[static_cast<size_t>(r)]) {
        const Real alpha = static_cast<Real>(1 - state.transmittance);
        if (per_ray && alpha > options_.unshaded)
          add_shaded(state.pixel, r, geometry_sums_.data(), 1, alpha);
        finish(state);
      } else {
        carried_ = state;
        carried_.continued = true;
      }
    }
    rays_ = samples_used_ = 0;
  }

  // Weights times features of the samples [begin, end) of one ray, behind those of the chunk
  // before.
  void sum_geometry(int begin, int end, bool continued) {
    for (size_t f = 0; f < geometry_sums_.size(); ++f) {
      const Real* row = chunk_.data(tape_.geometry) + static_cast<int64_t>(f) * kChunkSamples;
      double sum = continued ? geometry_sums_[f] : 0;
      for (int i = begin; i < end; ++i)
        sum += static_cast<double>(weights_[static_cast<size_t>(i)]) * static_cast<double>(row[i]);
      geometry_sums_[f] = sum;
    }
  }

  // Features of ray r, those of a sample that matters or of all together, wait for the colour
  // network with others.
  template <class T>
  void add_shaded(int pixel, int r, const T* from, int64_t stride, Real weight) {
    if (shaded_ == kChunkSamples) shade();
    const bool same_ray =
        shaded_rays_ > 0 && shaded_pixel_[static_cast<size_t>(shaded_ - 1)] == pixel;
    if (!same_ray) {
      for (int k = 0; k < 3; ++k)
        shading_.data(tape_.directions)[k * kChunkRays + shaded_rays_] =
            chunk_.data(tape_.directions)[k * kChunkRays + r];
      shaded_begin_[static_cast<size_t>(shaded_rays_++)] = shaded_;
    }
    Real* to = shading_.data(tape_.geometry) + shaded_;
    for (int f = 0; f < field_.options.geometry_features; ++f)
      to[int64_t{f} * kChunkSamples] = static_cast<Real>(from[int64_t{f} * stride]);
    shaded_pixel_[static_cast<size_t>(shaded_)] = pixel;
    shaded_weight_[static_cast<size_t>(shaded_)] = weight;
    ++shaded_;
  }

  void shade() {
    if (shaded_ == 0) return;
    shaded_begin_[static_cast<size_t>(shaded_rays_)] = shaded_;
    statistics_.colour_evaluations += shaded_;
    shading_.samples = shaded_;
    shading_.rays = shaded_rays_;
    shading_.ray_begin = shaded_begin_.data();
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

  void finish(const PixelState& s) {
    const size_t p = static_cast<size_t>(s.pixel);
    for (int k = 0; k < 3; ++k)
      frame_->rgb[3 * p + static_cast<size_t>(k)] +=
          static_cast<Real>(s.transmittance * options_.background[k]);
    frame_->alpha[p] = static_cast<Real>(1 - s.transmittance);
    frame_->depth_z[p] =
        s.median < 0 ? 0.0_r : static_cast<Real>((s.start + s.median) * s.forward * unit_);
  }

  const GridField& field_;
  const Camera& camera_;
  const Pose& pose_;
  double near_;
  const RenderOptions& options_;
  std::optional<ObliqueBox> box_;
  GridTape tape_;
  Chunk chunk_, shading_;
  RaySampler sampler_;
  RaySamples samples_;
  AlignedArray<Real> x_, y_, z_, spread_;  // [GridOptions::cone_points][kChunkSamples]
  AlignedArray<Real> alphas_{kChunkSamples}, weights_{kChunkSamples};
  std::vector<double> geometry_sums_;  // of the ray at hand; GridOptions::colour_per_ray
  std::vector<Real> t_;
  std::vector<int32_t> ray_begin_;
  PixelState states_[kChunkRays], carried_;
  bool last_[kChunkRays];
  int rays_ = 0, samples_used_ = 0;
  std::vector<int32_t> shaded_begin_;
  int shaded_pixel_[kChunkSamples];
  Real shaded_weight_[kChunkSamples];
  int shaded_ = 0, shaded_rays_ = 0;
  Frame* frame_ = nullptr;
  double unit_ = 1;
  RenderStatistics statistics_;
};

}  // namespace nerf::internal
