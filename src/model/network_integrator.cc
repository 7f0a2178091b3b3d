#include "model/network_integrator.h"

#include <algorithm>
#include <cmath>

#include "model/matter_cells.h"

namespace nerf::internal {

NetworkIntegrator::NetworkIntegrator(const NetworkField& field, const MatterCells* occupancy,
                                     const RenderOptions& options,
                                     const std::optional<ObliqueBox>& box,
                                     const std::optional<EngineMedium>& medium, ThreadPool& pool)
    : field_(field),
      occupancy_(options.unclipped ? nullptr : occupancy),
      box_(box),
      medium_(medium),
      code_(options.appearance.code),
      // Where most samples are skipped more rays fill a chunk.
      per_chunk_(NetworkLevels::rays_per_chunk(field.options) * (occupancy_ ? 4 : 1)),
      workers_(static_cast<size_t>(pool.size())) {
  pack_layers(field.layers(), field.weights.data(), options.precision, packs_, pool);
}

const NetworkField& NetworkIntegrator::field_of(bool cut) {
  if (!cut || !field_.options.opaque_end) return field_;
  std::call_once(open_end_made_, [&] {
    open_end_ = field_;
    open_end_->options.opaque_end = false;
  });
  return *open_end_;
}

NetworkLevels& NetworkIntegrator::levels(bool cut, int thread) {
  Worker& worker = workers_[static_cast<size_t>(thread)];
  auto& made = cut ? worker.cut : worker.whole;
  if (!made) {
    made = std::make_unique<NetworkLevels>(field_of(cut), per_chunk_);
    made->skip_empty(occupancy_);
    if (!code_.empty()) made->use_code(code_);
    made->use_packs(&packs_);
    if (cut) made->cut_rays();
  }
  return *made;
}

void NetworkIntegrator::integrate(std::span<const Ray> rays, const RaySink& sink, int thread) {
  const bool cut = box_ || std::ranges::any_of(rays, [](const Ray& ray) {
                     return ray.near > 0 || ray.far < Ray().far;
                   });
  NetworkLevels& own = levels(cut, thread);
  RenderStatistics statistics;
  std::vector<NetworkRay> part;
  std::vector<size_t> places;
  const auto render = [&] {
    if (part.empty()) return;
    own.forward(part, 1);
    statistics.density_evaluations += own.dense_samples();
    statistics.colour_evaluations += own.coloured_samples();
    statistics.rays += static_cast<int64_t>(part.size());
    for (size_t r = 0; r < part.size(); ++r)
      give(own, static_cast<int>(r), rays[places[r]], places[r], sink);
    part.clear();
    places.clear();
  };
  for (size_t i = 0; i < rays.size(); ++i) {
    const Ray& line = rays[i];
    for (size_t k = 0; k < 3; ++k) sink.rgb[3 * i + k] = line.background[static_cast<int>(k)];
    if (medium_) {  // unless the ray meets the field
      const Veil veil = MediumRay(*medium_, line).behind();
      for (int k = 0; k < 3; ++k)
        sink.rgb[3 * i + static_cast<size_t>(k)] =
            static_cast<Real>(veil.over(k, line.background[k]));
      sink.opacity[i] = static_cast<Real>(1 - veil.mean_through());
    }
    auto ray = sampled_ray(field_, line);
    if (!ray) continue;
    if (cut) {
      double near = line.near, far = line.far;
      if (box_ && !box_->clip(line.origin, line.direction, near, far)) continue;
      ray->drawn_from = static_cast<Real>(ray_parameter(field_, line, near));
      ray->drawn_to = static_cast<Real>(ray_parameter(field_, line, far));
    }
    part.push_back(*ray);
    places.push_back(i);
    if (part.size() == static_cast<size_t>(per_chunk_)) render();
  }
  render();
  std::lock_guard lock(mutex_);
  statistics_ += statistics;
}

void NetworkIntegrator::give(const NetworkLevels& levels, int r, const Ray& ray, size_t place,
                             const RaySink& sink) const {
  Real opacity;
  levels.pixel(r, sink.rgb + 3 * place, opacity);
  sink.opacity[place] = std::min(opacity, 1.0_r);  // weights are rounded before they are added up
  if (medium_) see_through(levels, r, ray, place, sink);
  for (size_t k = 0; k < 3; ++k)
    sink.rgb[3 * place + k] = std::clamp(sink.rgb[3 * place + k], 0.0_r, 1.0_r);
  const auto distance = [&](double t) {
    const double d = t < 0 ? 0 : ray_distance(field_, ray, t);
    return std::isfinite(d) ? d : 0;
  };
  if (sink.median) sink.median[place] = distance(static_cast<double>(levels.median_distance(r)));
  if (sink.samples) sink.samples[place] = levels.samples(levels.levels() - 1);
  if (sink.deep) give_deep(levels, r, ray, sink.deep[place]);
  if (!sink.mean && !sink.variance && !sink.near && !sink.far) return;
  const int last = levels.levels() - 1;
  const auto weights = levels.weights(last, r);
  const auto posts = levels.posts(last, r);
  const bool intervals = levels.sampler().intervals();
  double light = 0, first = 0, second = 0, near = -1, far = -1;
  for (size_t i = 0; i < weights.size(); ++i) {
    const double w = static_cast<double>(weights[i]);
    const double t0 = static_cast<double>(levels.sampler().distance(posts[i]));
    const double t1 = intervals ? static_cast<double>(levels.sampler().distance(posts[i + 1])) : t0;
    const double d = distance(0.5 * (t0 + t1));
    const auto stopped_at = [&](double share) {
      return distance(t0 + (share - light) / w * (t1 - t0));
    };
    if (near < 0 && light + w >= kNearShare) near = stopped_at(kNearShare);
    if (far < 0 && light + w >= kFarShare) far = stopped_at(kFarShare);
    light += w;
    first += w * d;
    second += w * d * d;
  }
  if (sink.near) sink.near[place] = static_cast<Real>(std::max(near, 0.0));
  if (sink.far) sink.far[place] = static_cast<Real>(std::max(far, 0.0));
  if (!(light > 0)) return;
  const double mean = first / light;
  if (sink.mean) sink.mean[place] = static_cast<Real>(mean);
  if (sink.variance)
    sink.variance[place] = static_cast<Real>(std::max(0.0, second / light - mean * mean));
}

std::vector<Veil> NetworkIntegrator::veils(const NetworkLevels& levels, int r,
                                           const Ray& ray) const {
  const int last = levels.levels() - 1;
  const auto weights = levels.weights(last, r);
  const auto posts = levels.posts(last, r);
  const MediumRay medium(*medium_, ray);
  const auto distance = [&](size_t post) {
    const double t = static_cast<double>(levels.sampler().distance(posts[post]));
    return std::min(std::max(t < 0 ? 0.0 : ray_distance(field_, ray, t), 0.0), ray.far);
  };
  std::vector<Veil> veils;
  double left = 1;
  for (size_t i = 0; i < weights.size(); ++i) {
    const double w = static_cast<double>(weights[i]);
    const double front = distance(i), back = i + 1 < posts.size() ? distance(i + 1) : front;
    const double alpha = left > 0 ? std::clamp(w / left, 0.0, 1.0) : 0;
    veils.push_back(medium.before(front, back, -std::log1p(-alpha)));
    left -= w;
  }
  veils.push_back(medium.behind());
  return veils;
}

void NetworkIntegrator::see_through(const NetworkLevels& levels, int r, const Ray& ray,
                                    size_t place, const RaySink& sink) const {
  const auto weights = levels.weights(levels.levels() - 1, r);
  const std::vector<Veil> veils = this->veils(levels, r, ray);
  std::vector<Real> colours;
  levels.colours(r, colours);
  const double left = 1 - static_cast<double>(sink.opacity[place]);
  for (int k = 0; k < 3; ++k) {
    double sum = left * veils.back().over(k, ray.background[k]);
    for (size_t i = 0; i < weights.size(); ++i)
      if (weights[i] > 0)
        sum += static_cast<double>(weights[i]) *
               veils[i].over(k, static_cast<double>(colours[3 * i + static_cast<size_t>(k)]));
    sink.rgb[3 * place + static_cast<size_t>(k)] = static_cast<Real>(sum);
  }
  sink.opacity[place] = static_cast<Real>(1 - left * veils.back().mean_through());
}

void NetworkIntegrator::give_deep(const NetworkLevels& levels, int r, const Ray& ray,
                                  std::vector<DeepSample>& deep) const {
  const int last = levels.levels() - 1;
  const auto weights = levels.weights(last, r);
  const auto posts = levels.posts(last, r);
  const bool intervals = levels.sampler().intervals();
  const auto distance = [&](size_t post) {
    const double d =
        ray_distance(field_, ray, static_cast<double>(levels.sampler().distance(posts[post])));
    return std::isfinite(d) ? static_cast<Real>(d) : 1e30_r;
  };
  std::vector<Real> rgb;
  levels.colours(r, rgb);
  const std::vector<Veil> seen = medium_ ? veils(levels, r, ray) : std::vector<Veil>();
  for (size_t i = 0; i < weights.size(); ++i) {
    if (!(weights[i] > 0)) continue;
    for (int k = 0; medium_ && k < 3; ++k) {
      Real& c = rgb[3 * i + static_cast<size_t>(k)];
      c = static_cast<Real>(seen[i].over(k, static_cast<double>(c)));
    }
    DeepSample& s = deep.emplace_back();
    s.front = distance(i);
    s.back = intervals || i + 1 < weights.size() ? distance(i + 1) : s.front;
    s.weight = weights[i];
    for (size_t k = 0; k < 3; ++k) s.rgb[k] = weights[i] * rgb[3 * i + k];
  }
  join_deep_samples(deep);
}

}  // namespace nerf::internal
