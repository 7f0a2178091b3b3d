#include "nerf/model/network_levels.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "model/matter_memory.h"
#include "nerf/base/error.h"
#include "nerf/parts/losses.h"

namespace nerf {

namespace {

NetworkTape::Losses losses_of_level(const NetworkLosses& losses, bool first, bool last,
                                    bool training) {
  NetworkTape::Losses out;
  out.colour = last || losses.coarse > 0;
  out.pixel = losses.pixel;
  out.on_weights =
      (last ? losses.distortion > 0 : losses.interlevel > 0) || (losses.depth && out.colour);
  out.density_noise = training && losses.density_noise > 0;
  out.transient = last;
  out.least_deviation = losses.least_deviation;
  out.transient_density = losses.transient_density;
  out.elastic = first && losses.elastic;
  return out;
}

bool can_skip_level(const NetworkOptions& options, const NetworkLosses& losses, bool last) {
  if (last && options.transient_code > 0) return false;  // what is seen there may be transient
  if (options.density == DensityActivation::kRelu) return true;
  return losses.negligible > 0 && (last || losses.interlevel == 0);
}

}  // namespace

// Weights are read and their gradients written once per chunk, so that chunks should be long; but a
// layer's activations should stay in a second-level cache (measured: docs/benchmarks.md).
int NetworkLevels::chunk_samples(int width) { return width <= 256 ? 800 : 512; }

int NetworkLevels::rays_per_chunk(const NetworkOptions& options) {
  return std::max(1, chunk_samples(options.width) / options.sampling.most_posts());
}

NetworkLevels::NetworkLevels(const NetworkField& field, int rays, bool training,
                             const NetworkLosses& losses)
    : field_(field),
      training_(training),
      losses_(losses),
      sampler_(field.options.sampling, field.near, field.far),
      axes_(encoding_axes(field.options)),
      moments_(field) {
  for (int l = 0; l < sampler_.levels(); ++l) {
    const int samples = sampler_.samples(l);
    const auto of_level = losses_of_level(losses, l == 0, l + 1 == sampler_.levels(), training);
    levels_.push_back(std::make_unique<Level>(field, l, samples, rays, training, of_level));
    Level& level = *levels_.back();
    level.chunk.weights = field.weights.data();
    level.posts.resize(static_cast<size_t>(rays * sampler_.posts(l)));
    for (int r = 0; r <= rays; ++r) level.ray_begin.push_back(r * samples);
    if (!training || !level.tape.learns()) continue;
    if (!can_skip_level(field.options, losses, l + 1 == sampler_.levels())) continue;
    level.probe = std::make_unique<NetworkTape>(field.options, field.network_of(l), rays * samples,
                                                rays, NetworkTape::Purpose::kDensity, of_level);
    level.probe_chunk = std::make_unique<Chunk>(level.probe->tape);
    level.probe_chunk->weights = field.weights.data();
  }
}

void NetworkLevels::use_packs(const LayerPacks* packs) {
  for (const auto& level : levels_) {
    level->chunk.packs = packs;
    if (level->probe_chunk) level->probe_chunk->packs = packs;
  }
}

uint64_t NetworkLevels::memory_bytes(const NetworkOptions& options, int rays, bool training,
                                     const NetworkLosses& losses) {
  const std::vector<RadianceNetwork> networks = place_networks(options);
  uint64_t floats = 0;
  for (int l = 0; l < options.sampling.levels(); ++l) {
    const bool last = l + 1 == options.sampling.levels();
    const auto of_level = losses_of_level(losses, l == 0, last, training);
    const auto arena = [&](NetworkTape::Purpose purpose) {
      return NetworkTape(options, network_of(options, networks, l),
                         rays * options.sampling.samples(l), rays, purpose, of_level)
          .tape.arena_floats();
    };
    floats += arena(training ? NetworkTape::Purpose::kTrain : NetworkTape::Purpose::kRender);
    if (training && can_skip_level(options, losses, last))
      floats += arena(NetworkTape::Purpose::kDensity);
  }
  return floats * sizeof(Real);
}

void NetworkLevels::skip_empty(internal::MatterMemory* memory) {
  memory_ = memory;
  occupancy_ = memory ? &memory->cells() : nullptr;
}

bool NetworkLevels::can_skip() const { return levels_.back()->probe != nullptr; }

void NetworkLevels::forward(std::span<NetworkRay> rays, Real exponent, bool skip) {
  rays_ = rays;
  dense_ = all_ = unasked_ = 0;
  moments_.begin();
  for (size_t l = 0; l < levels_.size(); ++l) {
    Level& level = *levels_[l];
    const int at = static_cast<int>(l), samples = sampler_.samples(at);
    const size_t posts = static_cast<size_t>(sampler_.posts(at));
    for (size_t r = 0; r < rays.size(); ++r) {
      Random* random = training_ ? &rays[r].random : nullptr;
      aim(rays[r]);
      const std::span<Real> out(level.posts.data() + r * posts, posts);
      if (l == 0)
        sampler_.first(random, out);
      else
        sampler_.next(at, this->posts(at - 1, static_cast<int>(r)),
                      weights(at - 1, static_cast<int>(r)), exponent, random, out);
    }
    level.chunk.loss = 0;
    if (field_.options.deform.any()) level.tape.open(field_.windows);
    place_rays(level);
    level.packed = occupancy_ || cut_;
    level.probed = skip && level.probe;
    NetworkTape& asked = level.probed ? *level.probe : level.tape;
    Chunk& chunk = level.probed ? *level.probe_chunk : level.chunk;
    if (level.probed && field_.options.deform.any()) asked.open(field_.windows);
    if (level.packed)
      place_packed(level, samples, asked, chunk);
    else
      place_samples(level, samples, asked, chunk);
    if (level.probed) asked.forward_weights(chunk);
    if (level.probed) keep_dense(level);
    // A picture needs the last level's colours only, and of a level that learns nothing samples are
    // drawn from the weights.
    if (training_ ? level.tape.learns() : l + 1 == levels_.size())
      level.tape.forward(level.chunk);
    else
      level.tape.forward_weights(level.chunk);
    if (level.packed) spread_weights(level, samples, asked, chunk);
    if (memory_) mark(level, asked, chunk);
    if (!training_)
      dense_ += chunk.samples, all_ += static_cast<int64_t>(rays.size()) * samples;
    else if (level.probe)
      count_dense(asked, chunk);
    unasked_ += static_cast<int64_t>(rays.size()) * samples - chunk.samples;
  }
}

void NetworkLevels::aim(const NetworkRay& ray) {
  if (ray.far > 0)
    sampler_.set_range(ray.near, ray.far);
  else
    sampler_.set_range(static_cast<Real>(field_.near), static_cast<Real>(field_.far));
}

// In normalised distance. Positions have no posts: their bins begin at them, as their lengths do,
// and the last ends at 1.
void NetworkLevels::normalised_edges(int level, int ray, std::vector<Real>& edges) {
  edges.clear();
  aim(rays_[static_cast<size_t>(ray)]);
  for (const Real entry : posts(level, ray)) edges.push_back(sampler_.normalised(entry));
  if (!sampler_.intervals()) edges.push_back(1);
}

// In inverse distance, whose units do not depend on where a ray's samples begin and end.
double NetworkLevels::depth_loss_of(int level, int ray, Real scale, std::span<Real> d_weights) {
  const auto entries = posts(level, ray);
  middles_.clear();
  for (size_t i = 0; i < d_weights.size(); ++i) {
    Real middle = inverse_place(sampler_.distance(entries[i]));
    if (sampler_.intervals())
      middle = (middle + inverse_place(sampler_.distance(entries[i + 1]))) / 2;
    middles_.push_back(middle);
  }
  return depth_loss(middles_, weights(level, ray),
                    inverse_place(rays_[static_cast<size_t>(ray)].depth), scale, d_weights);
}

double NetworkLevels::losses_on_weights(size_t l) {
  Level& level = *levels_[l];
  if (level.tape.weight_gradient < 0) return 0;
  const int at = static_cast<int>(l), final_level = levels() - 1;
  const size_t n = static_cast<size_t>(samples(at));
  gradient_of_all_.assign(rays_.size() * n, 0.0_r);
  double loss = 0;
  for (size_t r = 0; r < rays_.size(); ++r) {
    const int ray = static_cast<int>(r);
    const std::span<Real> out(gradient_of_all_.data() + r * n, n);
    normalised_edges(at, ray, edges_);
    // A ray's scale is that of a mean over rays and three channels.
    const Real per_ray = 3 * rays_[r].scale;
    if (losses_.depth && level.tape.pixel >= 0 && rays_[r].depth > 0)
      loss += depth_loss_of(at, ray, depth_weight_ * per_ray, out);
    if (at == final_level) {
      if (losses_.distortion > 0)
        loss += distortion_loss(edges_, weights(at, ray), losses_.distortion * per_ray, out);
    } else if (losses_.interlevel > 0) {
      normalised_edges(final_level, ray, final_edges_);
      const Real share = 1 / static_cast<Real>(samples(final_level));
      loss += interlevel_loss(final_edges_, weights(final_level, ray), edges_, weights(at, ray),
                              losses_.interlevel * per_ray * share, out);
    }
  }
  Real* gradient = level.chunk.data(level.tape.weight_gradient);
  if (level.skipped())  // those without density get none
    for (size_t i = 0; i < level.kept.size(); ++i)
      gradient[i] = gradient_of_all_[static_cast<size_t>(level.kept[i])];
  else
    std::ranges::copy(gradient_of_all_, gradient);
  return loss;
}

double NetworkLevels::backward(Real* weight_gradient) {
  NERF_CHECK(training_);
  double loss = 0;
  for (size_t l = 0; l < levels_.size(); ++l) {
    Level& level = *levels_[l];
    if (!level.tape.learns()) continue;
    level.chunk.weight_gradient = weight_gradient;
    loss += losses_on_weights(l) + level.chunk.loss;
    level.tape.tape.backward(level.chunk);
  }
  return loss;
}

void NetworkLevels::pixel(int ray, Real rgb[3], Real& opacity) const {
  const Level& last = *levels_.back();
  const int64_t lr = last.chunk.stride(last.tape.pixel);
  const Real* pixel = last.chunk.data(last.tape.pixel) + ray;
  for (int k = 0; k < 3; ++k) rgb[k] = pixel[k * lr];
  opacity = pixel[3 * lr];
}

void NetworkLevels::colours(int ray, std::vector<Real>& rgb) const {
  const Level& last = *levels_.back();
  const size_t n = static_cast<size_t>(samples(levels() - 1)), r = static_cast<size_t>(ray);
  rgb.assign(3 * n, 0.0_r);
  const int64_t lc = last.chunk.stride(last.tape.colour);
  const Real* colour = last.chunk.data(last.tape.colour);
  for (int i = last.chunk.ray_begin[r]; i < last.chunk.ray_begin[r + 1]; ++i) {
    const size_t of_all = last.skipped() ? static_cast<size_t>(last.kept[static_cast<size_t>(i)])
                                         : static_cast<size_t>(i);
    for (size_t k = 0; k < 3; ++k)
      rgb[3 * (of_all - r * n) + k] = colour[static_cast<int64_t>(k) * lc + i];
  }
}

int NetworkLevels::renderings() const {
  return static_cast<int>(
      std::ranges::count_if(levels_, [](const auto& level) { return level->tape.pixel >= 0; }));
}

NetworkLevels::Level& NetworkLevels::rendering_level(int rendering) const {
  for (const auto& level : levels_)
    if (level->tape.pixel >= 0 && rendering-- == 0) return *level;
  NERF_CHECK(false);
  return *levels_.back();
}

void NetworkLevels::rendered(int rendering, int ray, Real rgba[4]) const {
  const Level& level = rendering_level(rendering);
  const int64_t lr = level.chunk.stride(level.tape.pixel);
  for (int k = 0; k < 4; ++k) rgba[k] = level.chunk.data(level.tape.pixel)[k * lr + ray];
}

void NetworkLevels::set_gradient(int rendering, int ray, const Real rgba[4]) {
  Level& level = rendering_level(rendering);
  const Value gradient = level.tape.pixel_loss.gradient;
  const int64_t lr = level.chunk.stride(gradient);
  for (int k = 0; k < 4; ++k) level.chunk.data(gradient)[k * lr + ray] = rgba[k];
}

std::span<const Real> NetworkLevels::weights(int level, int ray) const {
  const Level& l = *levels_[static_cast<size_t>(level)];
  const size_t n = static_cast<size_t>(samples(level));
  const Real* all = l.chunk.data(l.tape.weights);
  if (l.packed)
    all = l.all_weights.data();
  else if (l.probed)
    all = std::as_const(*l.probe_chunk).data(l.probe->weights);
  return {all + static_cast<size_t>(ray) * n, n};
}

std::span<const Real> NetworkLevels::posts(int level, int ray) const {
  const size_t n = static_cast<size_t>(sampler_.posts(level));
  return {levels_[static_cast<size_t>(level)]->posts.data() + static_cast<size_t>(ray) * n, n};
}

Real NetworkLevels::median_distance(int ray) const {
  const int last = levels() - 1;
  const auto w = weights(last, ray);
  const auto entries = posts(last, ray);
  double sum = 0;
  for (size_t i = 0; i < w.size(); ++i) {
    const double before = sum;
    sum += static_cast<double>(w[i]);
    if (sum < 0.5) continue;
    const Real t0 = sampler_.distance(entries[i]);
    if (!sampler_.intervals()) return t0;
    const Real share = static_cast<Real>((0.5 - before) / static_cast<double>(w[i]));
    return t0 + share * (sampler_.distance(entries[i + 1]) - t0);
  }
  return -1;
}

}  // namespace nerf
