// Where the samples of NetworkLevels stand, and which of them the networks are asked for.
#include <algorithm>
#include <utility>

#include "model/matter_memory.h"
#include "model/sample_gaussian.h"
#include "nerf/math/contraction.h"
#include "nerf/model/network_levels.h"

namespace nerf {

template <class Body>
void NetworkLevels::each_sample(const Level& level, int samples, const Body& body) {
  const bool intervals = sampler_.intervals();
  const size_t posts = static_cast<size_t>(samples) + (intervals ? 1 : 0);
  for (size_t r = 0; r < rays_.size(); ++r) {
    aim(rays_[r]);
    const Real* entry = level.posts.data() + r * posts;
    Real t0 = sampler_.distance(entry[0]);
    for (int i = 0; i < samples; ++i) {
      const bool endless = !intervals && i + 1 == samples;
      const Real next = endless ? t0 : sampler_.distance_after(t0, entry[i + 1]);
      const Real delta = endless ? field_.options.last_interval : (next - t0) * rays_[r].length;
      const int ray = static_cast<int>(r);
      body(Sample{ray, ray * samples + i, t0, intervals ? next : t0, delta});
      t0 = next;
    }
  }
}

void NetworkLevels::place_sample(const NetworkRay& ray, const Sample& sample, int column,
                                 const NetworkTape& tape, Chunk& chunk) const {
  chunk.data(tape.delta)[column] = sample.delta;
  Real* variance = field_.options.integrated() ? chunk.data(tape.variance) + column : nullptr;
  internal::place_gaussian(field_.options, axes_, ray, sample.t0, sample.t1,
                           chunk.data(tape.position) + column, variance,
                           chunk.stride(tape.position));
}

void NetworkLevels::place_rays(Level& level) {
  const NetworkTape& tape = level.tape;
  Chunk& c = level.chunk;
  c.rays = static_cast<int>(rays_.size());
  const int64_t lr = c.stride(tape.directions);
  const bool last = &level == levels_.back().get();
  for (int r = 0; r < c.rays; ++r) {
    const NetworkRay& ray = rays_[static_cast<size_t>(r)];
    for (int k = 0; k < 3; ++k) {
      c.data(tape.directions)[k * lr + r] = ray.view[k];
      c.data(tape.background)[k * lr + r] = ray.background[k];
    }
    if (tape.photo >= 0) c.data(tape.photo)[r] = static_cast<Real>(ray.photo);
    if (tape.camera >= 0) c.data(tape.camera)[r] = static_cast<Real>(ray.camera);
    if (tape.code >= 0) {
      const std::vector<Real>& code = code_.empty() ? moments_.light(ray.time) : code_;
      for (size_t k = 0; k < code.size(); ++k)
        c.data(tape.code)[static_cast<int64_t>(k) * lr + r] = code[k];
    }
    moments_.place(tape, c, r, ray.time, training_ ? ray.moment : -1);
    if (level.probe)
      moments_.place(*level.probe, *level.probe_chunk, r, ray.time, training_ ? ray.moment : -1);
    if (tape.deform.elastic_scale >= 0)
      c.data(tape.deform.elastic_scale)[r] = 3 * ray.scale * elastic_weight_;
    if (!training_ || tape.pixel_loss.target < 0) continue;
    for (int k = 0; k < 3; ++k) c.data(tape.pixel_loss.target)[k * lr + r] = ray.target[k];
    c.data(tape.pixel_loss.scale)[r] = ray.scale * (last ? 1.0_r : losses_.coarse);
  }
}

void NetworkLevels::place_samples(const Level& level, int samples, const NetworkTape& tape,
                                  Chunk& c) {
  c.rays = static_cast<int>(rays_.size());
  c.samples = c.rays * samples;
  c.ray_begin = level.ray_begin.data();
  each_sample(level, samples, [&](const Sample& s) {
    NetworkRay& ray = rays_[static_cast<size_t>(s.ray)];
    place_sample(ray, s, s.column, tape, c);
    if (tape.noise >= 0) c.data(tape.noise)[s.column] = losses_.density_noise * ray.random.normal();
  });
  tape.place_axes(c);
}

template <class Body, class EndOfRay>
void NetworkLevels::each_needed(const NetworkTape& tape, const Chunk& c, const Body& body,
                                const EndOfRay& end_of_ray) const {
  const Real* density = c.data(tape.density);
  const Real* weight = c.data(tape.weights);
  const bool relu = field_.options.density == DensityActivation::kRelu;
  const double least = static_cast<double>(losses_.negligible);
  for (int r = 0; r < c.rays; ++r) {
    const int end = c.ray_begin[r + 1];
    double light = 1;
    for (int i = c.ray_begin[r]; i < end; ++i) {
      const double share = relu ? light : static_cast<double>(weight[i]);
      const bool needed = density[i] > 0 && share >= least;
      if (needed || (field_.options.opaque_end && i + 1 == end)) body(i);
      light -= static_cast<double>(weight[i]);
    }
    end_of_ray(r);
  }
}

void NetworkLevels::count_dense(const NetworkTape& tape, const Chunk& c) {
  each_needed(tape, c, [&](int) { ++dense_; }, [](int) {});
  all_ += c.samples;
}

// The probe's samples that are needed, moved together on the level's own tape.
void NetworkLevels::keep_dense(Level& level) {
  const NetworkTape& from = *level.probe;
  const Chunk& all = *level.probe_chunk;
  const NetworkTape& to = level.tape;
  Chunk& c = level.chunk;
  level.kept.clear();
  level.dense_begin.assign(1, 0);
  each_needed(
      from, all, [&](int column) { level.kept.push_back(column); },
      [&](int) { level.dense_begin.push_back(static_cast<int32_t>(level.kept.size())); });
  c.samples = static_cast<int>(level.kept.size());
  c.ray_begin = level.dense_begin.data();
  const auto move_rows = [&](Value a, Value b) {
    if (a < 0) return;
    for (int row = 0; row < from.tape.rows(a); ++row) {
      const Real* x = all.data(a) + row * all.stride(a);
      Real* y = c.data(b) + row * c.stride(b);
      for (size_t i = 0; i < level.kept.size(); ++i) y[i] = x[level.kept[i]];
    }
  };
  move_rows(from.position, to.position);
  if (field_.options.integrated()) move_rows(from.variance, to.variance);
  move_rows(from.delta, to.delta);
  move_rows(from.noise, to.noise);
  to.place_axes(c);
  if (!level.packed) return;
  for (int& column : level.kept) column = level.asked[static_cast<size_t>(column)];
}

// Whether a sample at a position (warped, where the field is) may meet matter in the part of the
// ray that is drawn.
bool NetworkLevels::asks_for(const NetworkRay& ray, const Sample& sample, const Vec3& at,
                             bool last) const {
  if (cut_ && !(sample.delta > 0)) return false;
  return ray.everywhere || !occupancy_ || occupancy_->may_hold(at, last);
}

// Only the samples that are asked for, side by side.
void NetworkLevels::place_packed(Level& level, int samples, const NetworkTape& tape, Chunk& c) {
  const bool warped = field_.options.space == Space::kContract;
  const bool is_last = &level == levels_.back().get();
  level.asked.clear();
  level.cells.clear();
  level.packed_begin.assign(rays_.size() + 1, 0);
  each_sample(level, samples, [&](Sample s) {
    NetworkRay& ray = rays_[static_cast<size_t>(s.ray)];
    if (cut_) {
      const Real from = std::max(s.t0, ray.drawn_from);
      const Real to = std::min(s.t0 + s.delta / ray.length, ray.drawn_to);
      s.delta = std::max(0.0_r, (to - from) * ray.length);
    }
    const Vec3 p = ray.origin + ray.direction * (0.5_r * (s.t0 + s.t1));
    const Vec3 at = warped ? contract(p) : p;
    const bool end = field_.options.opaque_end && (s.column + 1) % samples == 0;
    if (end || asks_for(ray, s, at, is_last)) {
      const int column = static_cast<int>(level.asked.size());
      place_sample(ray, s, column, tape, c);
      if (tape.noise >= 0) c.data(tape.noise)[column] = losses_.density_noise * ray.random.normal();
      if (memory_) level.cells.push_back(internal::MatterMemory::cell_of(at));
      level.asked.push_back(s.column);
    }
    level.packed_begin[static_cast<size_t>(s.ray) + 1] = static_cast<int32_t>(level.asked.size());
  });
  c.rays = static_cast<int>(rays_.size());
  c.samples = static_cast<int>(level.asked.size());
  c.ray_begin = level.packed_begin.data();
  tape.place_axes(c);
  level.kept = level.asked;
}

void NetworkLevels::spread_weights(Level& level, int samples, const NetworkTape& tape,
                                   const Chunk& c) {
  level.all_weights.assign(rays_.size() * static_cast<size_t>(samples), 0.0_r);
  const Real* w = c.data(tape.weights);
  for (size_t i = 0; i < level.asked.size(); ++i)
    level.all_weights[static_cast<size_t>(level.asked[i])] = w[i];
}

void NetworkLevels::mark(const Level& level, const NetworkTape& tape, const Chunk& c) {
  each_needed(
      tape, c, [&](int column) { memory_->mark(level.cells[static_cast<size_t>(column)]); },
      [](int) {});
}

}  // namespace nerf
