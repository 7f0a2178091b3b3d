#include "nerf/model/network_levels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "model/baked_occupancy.h"
#include "nerf/base/error.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/math/contraction.h"
#include "nerf/math/frustum.h"
#include "nerf/parts/losses.h"

namespace nerf {

namespace {

constexpr std::array<Vec3, 3> kAxes{Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}};

// Two independent normal numbers would come of two draws (Box and Muller); one is enough here.
float normal(Random& random) {
  const float u = 1 - random.uniform(), v = random.uniform();  // u in (0, 1]
  return std::sqrt(-2 * std::log(u)) * std::cos(6.28318531f * v);
}

}  // namespace

int NetworkLevels::rays_per_chunk(const NetworkField& field) {
  constexpr int kSamples = 512;  // activations of a layer stay in the second-level cache
  const IntervalSampler sampler(field.options.sampling, field.near, field.far);
  return std::max(1, kSamples / sampler.most_posts());
}

NetworkLevels::NetworkLevels(const NetworkField& field, int rays, bool training,
                             const NetworkLosses& losses)
    : field_(field),
      training_(training),
      losses_(losses),
      sampler_(field.options.sampling, field.near, field.far),
      axes_(field.options.encoding == Encoding::kOffAxis ? off_axis_directions()
                                                         : std::span<const Vec3>(kAxes)) {
  for (int l = 0; l < sampler_.levels(); ++l) {
    const bool last = l + 1 == sampler_.levels();
    NetworkTape::Losses of_level;
    of_level.colour = last || losses.coarse > 0;
    of_level.charbonnier = losses.charbonnier;
    of_level.on_weights = last ? losses.distortion > 0 : losses.interlevel > 0;
    of_level.density_noise = training && losses.density_noise > 0;
    levels_.push_back(
        std::make_unique<Level>(field, l, sampler_.samples(l), rays, training, of_level));
    levels_.back()->posts.resize(static_cast<size_t>(rays * sampler_.posts(l)));
    levels_.back()->chunk.weights = field.weights.data();
    if (can_skip()) {
      Level& level = *levels_.back();
      level.probe = std::make_unique<NetworkTape>(field, l, rays * sampler_.samples(l), rays,
                                                  NetworkTape::Purpose::kDensity, of_level);
      level.probe_chunk = std::make_unique<Chunk>(level.probe->tape);
      level.probe_chunk->weights = field.weights.data();
    }
    for (int r = 0; r <= rays; ++r) levels_.back()->ray_begin.push_back(r * sampler_.samples(l));
  }
}

bool NetworkLevels::can_skip() const {
  return training_ && field_.options.density == DensityActivation::kRelu;
}

// The Gaussian around [t0, t1] of the ray (or its middle, a point), warped and projected on the
// encoding's axes: with J the warp's Jacobian and q = J p the variance along p is
// t_var (d . q)^2 + r_var (|q|^2 - (d . q)^2 / |d|^2).
void NetworkLevels::place_sample(const NetworkRay& ray, float t0, float t1, int column,
                                 const NetworkTape& tape, Chunk& chunk) const {
  const NetworkOptions& o = field_.options;
  const bool cone = o.cast == Cast::kCone;
  RayGaussian<float> g{0.5f * (t0 + t1), 0, 0};
  if (cone && o.space == Space::kNdc)
    g = cylinder_gaussian(t0, t1, ray.radius);
  else if (cone)
    g = cone_gaussian(t0, t1, ray.radius);
  const Vec3 mean = ray.origin + ray.direction * g.t_mean;
  const bool warped = o.space == Space::kContract;
  const Vec3 at = warped ? contract(mean) : mean;
  const int64_t ld = chunk.stride(tape.position);
  float* position = chunk.data(tape.position) + column;
  if (!o.integrated()) {
    for (int k = 0; k < 3; ++k) position[k * ld] = at[k];
    return;
  }
  float* variance = chunk.data(tape.variance) + column;
  const auto jacobian =
      warped ? contraction_jacobian(mean) : ContractionJacobian<float>{1, 0, mean};
  for (size_t k = 0; k < axes_.size(); ++k) {
    const Vec3 q = jacobian(axes_[k]);
    const float along = dot(ray.direction, q);
    const float across = std::max(0.0f, dot(q, q) - along * along / (ray.length * ray.length));
    position[static_cast<int64_t>(k) * ld] = dot(axes_[k], at);
    variance[static_cast<int64_t>(k) * ld] = g.t_variance * along * along + g.r_variance * across;
  }
}

void NetworkLevels::place_rays(const Level& level, const NetworkTape& tape, Chunk& c,
                               bool training) {
  c.rays = static_cast<int>(rays_.size());
  const int64_t lr = c.stride(tape.directions);
  const bool last = &level == levels_.back().get();
  for (int r = 0; r < c.rays; ++r) {
    const NetworkRay& ray = rays_[static_cast<size_t>(r)];
    for (int k = 0; k < 3; ++k) {
      c.data(tape.directions)[k * lr + r] = ray.view[k];
      c.data(tape.background)[k * lr + r] = ray.background[k];
    }
    if (!training || tape.pixel < 0) continue;
    for (int k = 0; k < 3; ++k) c.data(tape.target)[k * lr + r] = ray.target[k];
    c.data(tape.scale)[r] = ray.scale * (last ? 1.0f : losses_.coarse);
  }
}

void NetworkLevels::place_samples(const Level& level, int samples, const NetworkTape& tape,
                                  Chunk& c) {
  const size_t posts = static_cast<size_t>(samples) + (sampler_.intervals() ? 1 : 0);
  c.rays = static_cast<int>(rays_.size());
  c.samples = c.rays * samples;
  c.ray_begin = level.ray_begin.data();
  float* delta = c.data(tape.delta);
  for (int r = 0; r < c.rays; ++r) {
    NetworkRay& ray = rays_[static_cast<size_t>(r)];
    const float* entry = level.posts.data() + static_cast<size_t>(r) * posts;
    float t0 = sampler_.distance(entry[0]);
    for (int i = 0; i < samples; ++i) {
      const int column = r * samples + i;
      if (sampler_.intervals()) {
        const float t1 = sampler_.distance(entry[i + 1]);
        place_sample(ray, t0, t1, column, tape, c);
        delta[column] = (t1 - t0) * ray.length;
        t0 = t1;
      } else {
        place_sample(ray, entry[i], entry[i], column, tape, c);
        delta[column] = i + 1 < samples ? (entry[i + 1] - entry[i]) * ray.length : kLongestInterval;
      }
      if (tape.noise >= 0) c.data(tape.noise)[column] = losses_.density_noise * normal(ray.random);
    }
  }
}

void NetworkLevels::count_dense(const NetworkTape& tape, const Chunk& c) {
  const float* density = c.data(tape.density);
  dense_ += std::count_if(density, density + c.samples, [](float d) { return d > 0; });
  all_ += c.samples;
}

// The probe's samples that have density, moved together on the level's own tape.
void NetworkLevels::keep_dense(Level& level) {
  const NetworkTape& from = *level.probe;
  const Chunk& all = *level.probe_chunk;
  const NetworkTape& to = level.tape;
  Chunk& c = level.chunk;
  const float* density = all.data(from.density);
  level.dense_begin.assign(1, 0);
  std::vector<int> columns;
  columns.reserve(static_cast<size_t>(all.samples));
  for (int r = 0; r < all.rays; ++r) {
    const int end = all.ray_begin[r + 1];
    for (int i = all.ray_begin[r]; i < end; ++i)
      if (density[i] > 0 || (field_.options.opaque_end && i + 1 == end)) columns.push_back(i);
    level.dense_begin.push_back(static_cast<int32_t>(columns.size()));
  }
  c.samples = static_cast<int>(columns.size());
  c.ray_begin = level.dense_begin.data();
  const auto move_rows = [&](Value a, Value b) {
    if (a < 0) return;
    for (int row = 0; row < from.tape.rows(a); ++row) {
      const float* x = all.data(a) + row * all.stride(a);
      float* y = c.data(b) + row * c.stride(b);
      for (size_t i = 0; i < columns.size(); ++i) y[i] = x[columns[i]];
    }
  };
  move_rows(from.position, to.position);
  if (field_.options.integrated()) move_rows(from.variance, to.variance);
  move_rows(from.delta, to.delta);
  move_rows(from.noise, to.noise);
}

// Only the samples that may meet matter, packed; `kept` says which they are.
void NetworkLevels::place_occupied(Level& level, int samples) {
  Chunk& c = level.chunk;
  const NetworkTape& tape = level.tape;
  const size_t posts = static_cast<size_t>(samples) + (sampler_.intervals() ? 1 : 0);
  const bool warped = field_.options.space == Space::kContract;
  const bool is_last = &level == levels_.back().get();
  const int64_t ld = c.stride(tape.position);
  float* position = c.data(tape.position);
  float* delta = c.data(tape.delta);
  level.kept.clear();
  level.dense_begin.assign(1, 0);
  for (size_t r = 0; r < rays_.size(); ++r) {
    const NetworkRay& ray = rays_[r];
    const float* entry = level.posts.data() + r * posts;
    for (int i = 0; i < samples; ++i) {
      const bool last = !sampler_.intervals() && i + 1 == samples;
      const float t0 = sampler_.distance(entry[i]);
      const float t1 = last ? t0 : sampler_.distance(entry[i + 1]);
      const float t = sampler_.intervals() ? 0.5f * (t0 + t1) : t0;
      const Vec3 p = ray.origin + ray.direction * t;
      const Vec3 at = warped ? contract(p) : p;
      const bool end = field_.options.opaque_end && i + 1 == samples;
      if (!end && !occupancy_->may_hold(at, is_last)) continue;
      const size_t column = level.kept.size();
      for (int k = 0; k < 3; ++k) position[k * ld + static_cast<int64_t>(column)] = at[k];
      delta[column] = last ? kLongestInterval : (t1 - t0) * ray.length;
      level.kept.push_back(static_cast<int>(r) * samples + i);
    }
    level.dense_begin.push_back(static_cast<int32_t>(level.kept.size()));
  }
  c.samples = static_cast<int>(level.kept.size());
  c.ray_begin = level.dense_begin.data();
}

void NetworkLevels::spread_weights(Level& level, int samples) {
  level.all_weights.assign(rays_.size() * static_cast<size_t>(samples), 0.0f);
  const float* w = std::as_const(level.chunk).data(level.tape.weights);
  for (size_t i = 0; i < level.kept.size(); ++i)
    level.all_weights[static_cast<size_t>(level.kept[i])] = w[i];
  dense_ += static_cast<int64_t>(level.kept.size());
  all_ += static_cast<int64_t>(level.all_weights.size());
}

void NetworkLevels::forward(std::span<NetworkRay> rays, float exponent, bool skip) {
  rays_ = rays;
  dense_ = all_ = 0;
  for (size_t l = 0; l < levels_.size(); ++l) {
    Level& level = *levels_[l];
    const int at = static_cast<int>(l), samples = sampler_.samples(at);
    const size_t posts = static_cast<size_t>(sampler_.posts(at));
    for (size_t r = 0; r < rays.size(); ++r) {
      Random* random = training_ ? &rays[r].random : nullptr;
      const std::span<float> out(level.posts.data() + r * posts, posts);
      if (l == 0)
        sampler_.first(random, out);
      else
        sampler_.next(at, this->posts(at - 1, static_cast<int>(r)),
                      weights(at - 1, static_cast<int>(r)), exponent, random, out);
    }
    level.chunk.loss = 0;
    place_rays(level, level.tape, level.chunk, training_);
    const bool in_picture = !training_ && occupancy_;
    level.skipped = in_picture || (skip && level.probe);
    if (in_picture) {
      place_occupied(level, samples);
    } else if (level.skipped) {
      place_samples(level, samples, *level.probe, *level.probe_chunk);
      level.probe->forward_weights(*level.probe_chunk);
      count_dense(*level.probe, *level.probe_chunk);
      keep_dense(level);
    } else {
      place_samples(level, samples, level.tape, level.chunk);
    }
    // A picture needs the last level's colours only.
    if (training_ || l + 1 == levels_.size())
      level.tape.forward(level.chunk);
    else
      level.tape.forward_weights(level.chunk);
    if (in_picture) spread_weights(level, samples);
    if (!training_ && !in_picture) all_ += level.chunk.samples, dense_ += level.chunk.samples;
    if (can_skip() && !level.skipped) count_dense(level.tape, level.chunk);
  }
}

double NetworkLevels::losses_on_weights(size_t l) {
  Level& level = *levels_[l];
  if (level.tape.weight_gradient < 0) return 0;
  const bool last = l + 1 == levels_.size();
  const size_t n = static_cast<size_t>(samples(static_cast<int>(l)));
  std::vector<float> of_all;
  float* gradient = level.chunk.data(level.tape.weight_gradient);
  if (level.skipped) {
    of_all.resize(rays_.size() * n);
    gradient = of_all.data();
  }
  std::fill_n(gradient, rays_.size() * n, 0.0f);
  const auto normalised = [&](int of_level, int ray, std::vector<float>& edges) {
    edges.clear();
    for (const float e : posts(of_level, ray)) edges.push_back(sampler_.normalised(e));
    // Positions have no posts: their bins begin at them, as delta does, and the last ends at 1.
    if (!sampler_.intervals()) edges.push_back(1);
  };
  std::vector<float> edges, final_edges;
  double loss = 0;
  const int final_level = levels() - 1;
  for (size_t r = 0; r < rays_.size(); ++r) {
    const int ray = static_cast<int>(r);
    const std::span<float> out(gradient + r * n, n);
    normalised(static_cast<int>(l), ray, edges);
    // A ray's scale is that of a mean over rays and three channels.
    const float per_ray = 3 * rays_[r].scale;
    if (last) {
      loss += distortion_loss(edges, weights(static_cast<int>(l), ray),
                              losses_.distortion * per_ray, out);
    } else {
      normalised(final_level, ray, final_edges);
      const float share = 1 / static_cast<float>(samples(final_level));
      loss += interlevel_loss(final_edges, weights(final_level, ray), edges,
                              weights(static_cast<int>(l), ray),
                              losses_.interlevel * per_ray * share, out);
    }
  }
  if (level.skipped) {  // those without density get none
    const float* density = std::as_const(*level.probe_chunk).data(level.probe->density);
    float* kept = level.chunk.data(level.tape.weight_gradient);
    for (size_t i = 0; i < of_all.size(); ++i) {
      const bool end = field_.options.opaque_end && (i + 1) % n == 0;
      if (density[i] > 0 || end) *kept++ = of_all[i];
    }
  }
  return loss;
}

double NetworkLevels::backward(float* weight_gradient) {
  NERF_CHECK(training_);
  double loss = 0;
  for (size_t l = 0; l < levels_.size(); ++l) {
    Level& level = *levels_[l];
    if (level.tape.pixel < 0 && level.tape.weight_gradient < 0) continue;  // learns nothing
    level.chunk.weight_gradient = weight_gradient;
    loss += losses_on_weights(l) + level.chunk.loss;
    level.tape.tape.backward(level.chunk);
  }
  return loss;
}

uint64_t NetworkLevels::arena_bytes() const {
  uint64_t sum = 0;
  for (const auto& level : levels_) {
    sum += level->tape.tape.arena_floats() * sizeof(float);
    if (level->probe) sum += level->probe->tape.arena_floats() * sizeof(float);
  }
  return sum;
}

void NetworkLevels::pixel(int ray, float rgb[3], float& opacity) const {
  const Level& last = *levels_.back();
  const int64_t lr = last.chunk.stride(last.tape.pixel);
  const float* pixel = last.chunk.data(last.tape.pixel) + ray;
  for (int k = 0; k < 3; ++k) rgb[k] = pixel[k * lr];
  opacity = pixel[3 * lr];
}

std::span<const float> NetworkLevels::weights(int level, int ray) const {
  const Level& l = *levels_[static_cast<size_t>(level)];
  const size_t n = static_cast<size_t>(samples(level));
  const float* all = l.chunk.data(l.tape.weights);
  if (l.skipped)
    all = training_ ? std::as_const(*l.probe_chunk).data(l.probe->weights) : l.all_weights.data();
  return {all + static_cast<size_t>(ray) * n, n};
}

std::span<const float> NetworkLevels::posts(int level, int ray) const {
  const size_t n = static_cast<size_t>(sampler_.posts(level));
  return {levels_[static_cast<size_t>(level)]->posts.data() + static_cast<size_t>(ray) * n, n};
}

float NetworkLevels::median_distance(int ray) const {
  const int last = levels() - 1;
  const auto w = weights(last, ray);
  const auto entries = posts(last, ray);
  double sum = 0;
  for (size_t i = 0; i < w.size(); ++i) {
    const double before = sum;
    sum += static_cast<double>(w[i]);
    if (sum < 0.5) continue;
    const float t0 = sampler_.distance(entries[i]);
    if (!sampler_.intervals()) return t0;
    const float share = static_cast<float>((0.5 - before) / static_cast<double>(w[i]));
    return t0 + share * (sampler_.distance(entries[i + 1]) - t0);
  }
  return -1;
}

}  // namespace nerf
