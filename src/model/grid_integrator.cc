#include "model/grid_integrator.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "nerf/kernels/elementwise.h"

namespace nerf::internal {

namespace {

SamplerOptions sampler_options(const GridField& field, const RenderOptions& options) {
  SamplerOptions s = field.sampler();
  if (!field.moves()) s.min_transmittance = options.min_transmittance;
  s.samples_per_cell *= options.sample_factor;
  s.max_samples = std::min(std::max(s.max_samples, options.max_samples), kChunkSamples);
  s.uniform_share = std::clamp(options.uniform_share, 0.0_r, 1e6_r);
  return s;
}

constexpr Real kFaint = 1e-4_r;  // so little light says nothing of where matter begins and ends

// Adds n features of a sample of weight w to its ray's.
inline void add_weighted(size_t n, Real w, const Real* __restrict x, Real* __restrict sums) {
  constexpr size_t kUsual = 16;
  if (n == kUsual)
    for (size_t f = 0; f < kUsual; ++f) sums[f] += w * x[f];
  else
    for (size_t f = 0; f < n; ++f) sums[f] += w * x[f];
}

}  // namespace

GridIntegrator::GridIntegrator(const GridField& field, const GridMoment& moment,
                               const LayerPacks& packs, const RenderOptions& options,
                               const std::optional<ObliqueBox>& box,
                               const std::optional<EngineMedium>& medium)
    : field_(field),
      options_(options),
      box_(box),
      medium_(medium),
      tape_(field, /*training=*/false),
      chunk_(tape_.tape),
      shading_(tape_.tape),
      sampler_(moment.occupancy, sampler_options(field, options), field.clip) {
  if (tape_.code >= 0)
    code_ = options.appearance.code.empty() ? field.default_code(0) : options.appearance.code;
  if (shows_sky(field, options)) {
    sky_.emplace(field, packs);
    sky_->set_code(code_);
  }
  chunk_.weights = shading_.weights = field.weights.data();
  chunk_.packs = shading_.packs = &packs;
  if (moment.lattice)
    lattice_motion_ = std::make_unique<LatticeMotion>(*moment.lattice, field, &packs);
  else if (field.moves())
    motion_ = std::make_unique<MotionChunk>(field, &packs);
  delta_row_ = chunk_.data(tape_.delta);
  direction_rows_ = chunk_.data(tape_.directions);
  for (auto* a : {&x_, &y_, &z_}) *a = AlignedArray<Real>(kChunkSamples);
  for (auto* a : {&geometry_, &shaded_geometry_})
    *a = AlignedArray<Real>(kChunkSamples * geometry_features());
  ray_begin_.resize(kChunkRays + 1);
  shaded_begin_.resize(kChunkRays + 1);
}

void GridIntegrator::begin(const RaySink& sink) {
  sink_ = sink;
  has_moments_ = sink.mean || sink.variance;
  has_percentiles_ = sink.near || sink.far;
  has_deep_ = sink.deep != nullptr;
  ways_.clear();
  seen_.clear();
  t_.clear();
  delta_.clear();
  front_.clear();
  samples_.with_fronts = medium_.has_value();
}

// Places the samples of a ray.
void GridIntegrator::add(const Ray& given, int place) {
  Way way;
  way.place = place;
  way.background = given.background;
  way.direction = given.direction.cast<Real>();
  way.ends = given.ends;
  way.time = given.time;
  std::optional<SeenLight> seen;
  if (medium_) seen.emplace(SeenLight{MediumRay(*medium_, given), {}, {}, {}});
  const SeenLight* const through = seen ? &*seen : nullptr;
  Ray ray = given;
  if (box_ && !box_->clip(ray.origin, ray.direction, ray.near, ray.far)) return close(way, through);
  ++statistics_.rays;
  if (std::isinf(ray.clear)) return close(way, through);
  const int count = options_.unclipped ? sampler_.sample_all(ray, 4, samples_)
                                       : sampler_.sample(ray, nullptr, true, samples_);
  statistics_.segments += static_cast<int64_t>(sampler_.segments().size());
  if (count == 0) return close(way, through);
  way.entry = sampler_.entry();
  way.start = sampler_.start();
  way.begin = way.next = t_.size();
  t_.insert(t_.end(), samples_.t.begin(), samples_.t.end());
  delta_.insert(delta_.end(), samples_.delta.begin(), samples_.delta.end());
  way.end = t_.size();
  ways_.push_back(way);
  if (!seen) return;
  seen_.push_back(*seen);
  front_.insert(front_.end(), samples_.front.begin(), samples_.front.end());
}

void GridIntegrator::finish() {
  ask();
  shade();
  if (sky_) sky_->finish();
}

void GridIntegrator::ask() {
  geometry_sums_.assign(ways_.size() * geometry_features(), 0.0_r);
  waiting_.resize(ways_.size());
  std::iota(waiting_.begin(), waiting_.end(), size_t{0});
  while (!waiting_.empty()) {
    for (const size_t w : waiting_) {
      const size_t until = std::min(ways_[w].next + kStretch, ways_[w].end);
      while (!ways_[w].finished && ways_[w].next < until) {
        if (samples_used_ == kChunkSamples || parts_ == kChunkRays)
          flush();
        else
          add_part(w, until);
      }
    }
    flush();
    std::erase_if(waiting_, [&](size_t w) { return ways_[w].finished; });
  }
}

void GridIntegrator::add_part(size_t w, size_t until) {
  constexpr int64_t lr = kChunkRays;
  Way& way = ways_[w];
  part_way_[parts_] = w;
  part_first_[parts_] = way.next;
  ray_begin_[static_cast<size_t>(parts_)] = samples_used_;
  const size_t n = std::min(until - way.next, static_cast<size_t>(kChunkSamples - samples_used_));
  const size_t at = static_cast<size_t>(samples_used_);
  const Real* const delta = delta_.data() + way.next;
  if (n == kStretch)
    std::copy_n(delta, kStretch, delta_row_ + at);  // without a call
  else
    std::copy_n(delta, n, delta_row_ + at);
  place_samples(field_, way.entry, way.direction, t_.data() + way.next, static_cast<int64_t>(n),
                x_.data() + at, y_.data() + at, z_.data() + at);
  way.next += n;
  samples_used_ += static_cast<int>(n);
  for (int k = 0; k < 3; ++k) direction_rows_[k * lr + parts_] = way.direction[k];
  if (field_.moves()) chunk_.data(tape_.time)[parts_] = way.time;
  ++parts_;
  ray_begin_[static_cast<size_t>(parts_)] = samples_used_;
}

void GridIntegrator::flush() {
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
  encode(field_, looked_up(), samples_used_, chunk_.data(tape_.features),
         chunk_.stride(tape_.features));
  tape_.forward_density(chunk_);
  opacity(samples_used_, chunk_.data(tape_.density), delta_row_, alphas_.data());
  const size_t features = geometry_features();
  transpose(samples_used_, static_cast<int64_t>(features), chunk_.data(tape_.geometry),
            chunk_.stride(tape_.geometry), geometry_.data(), static_cast<int64_t>(features));
  statistics_.density_evaluations += samples_used_;
  for (int part = 0; part < parts_; ++part) composite(part);
  parts_ = samples_used_ = 0;
}

GridPoints GridIntegrator::looked_up() {
  if (!field_.moves()) return {x_.data(), y_.data(), z_.data()};
  const int64_t padded = round_up(samples_used_, kLane), ld = chunk_.stride(tape_.position);
  Real* to = chunk_.data(tape_.position);
  for (const auto* a : {&x_, &y_, &z_}) {
    std::copy_n(a->data(), padded, to);
    to += ld;
  }
  if (lattice_motion_) {
    lattice_motion_->forward(x_.data(), y_.data(), z_.data(), samples_used_);
    return {lattice_motion_->canonical(0), lattice_motion_->canonical(1),
            lattice_motion_->canonical(2)};
  }
  motion_->forward(x_.data(), y_.data(), z_.data(), samples_used_, parts_, ray_begin_.data(),
                   chunk_.data(tape_.time));
  return {motion_->canonical(0), motion_->canonical(1), motion_->canonical(2)};
}

void GridIntegrator::composite(int part) {
  const size_t features = geometry_features(), w = part_way_[part];
  Way& way = ways_[w];
  Real* const sums = geometry_sums_.data() + w * features;
  const int begin = ray_begin_[static_cast<size_t>(part)];
  const int end = ray_begin_[static_cast<size_t>(part) + 1];
  const size_t first = part_first_[part] - static_cast<size_t>(begin);  // of sample 0 of the chunk
  const Real* const t = t_.data() + first;
  const Real* const density = chunk_.data(tape_.density);
  // In registers: a store to the sums might change what lies in memory.
  double transmittance = way.transmittance;
  Real unshaded = way.unshaded, shared = way.shared;
  for (int i = begin; i < end; ++i) {
    const double alpha = alphas_[static_cast<size_t>(i)];
    const Real weight = static_cast<Real>(transmittance * alpha);
    if (has_deep_ && alpha > 0 && is_apart(way, t[i], delta_row_[i], weight)) {
      add_shaded(w, shared, transmittance);
      shared = 0;
      begin_stretch(way, t[i], delta_row_[i], transmittance);
    }
    const bool coloured = !(unshaded + weight <= options_.unshaded);
    if (!coloured) {
      unshaded += weight;
    } else {
      if (shared + weight > options_.shared_colour) {
        add_shaded(w, shared, transmittance);
        shared = 0;
        if (has_deep_) begin_stretch(way, t[i], delta_row_[i], transmittance);
      }
      shared += weight;
      add_weighted(features, weight, geometry_.data() + static_cast<size_t>(i) * features, sums);
    }
    if (medium_ && weight > 0) {
      const auto [front, back] = stretch_of(way, first + static_cast<size_t>(i));
      seen_[w].add(front, back, double{density[i]} * double{delta_row_[i]}, double{weight},
                   coloured);
    }
    if (has_moments_) {
      const double light = transmittance * alpha, distance = way.start + t[i];
      way.light += light;
      way.first_moment += light * distance;
      way.second_moment += light * distance * distance;
    }
    if (has_deep_ && weight > kFaint) way.back = std::max(way.back, t[i] + 0.5_r * delta_row_[i]);
    const double before = transmittance;
    transmittance *= 1 - alpha;
    if (way.median < 0 && transmittance <= 0.5)
      way.median = stopped_at(way, first + static_cast<size_t>(i), before, transmittance, 0.5);
    if (has_percentiles_) {
      if (way.near < 0 && transmittance <= 1 - kNearShare)
        way.near =
            stopped_at(way, first + static_cast<size_t>(i), before, transmittance, 1 - kNearShare);
      if (way.far < 0 && transmittance <= 1 - kFarShare)
        way.far =
            stopped_at(way, first + static_cast<size_t>(i), before, transmittance, 1 - kFarShare);
    }
    // Whatever of the ray was asked for with the others': a pixel is that of its ray alone.
    if (transmittance < options_.stop_transmittance) break;
  }
  way.transmittance = transmittance;
  way.unshaded = unshaded;
  way.shared = shared;
  if (way.next < way.end && !(transmittance < options_.stop_transmittance)) return;
  add_shaded(w, shared, transmittance);
  close(way, seen_of(w));
}

Real GridIntegrator::stopped_at(const Way& way, size_t sample, double before, double after,
                                double left) const {
  const auto [begin, end] = interval_of(way, sample);
  const double share = std::log(left / before) / std::log(after / before);
  return begin + static_cast<Real>(std::isfinite(share) ? share : 0.0) * (end - begin);
}

std::pair<Real, Real> GridIntegrator::interval_of(const Way& way, size_t sample) const {
  const Real t = t_[sample];
  const Real half = 0.5_r * delta_[sample];
  Real begin = t - half, end = t + half;
  if (sample > way.begin) begin = std::max(begin, 0.5_r * (t_[sample - 1] + t));
  if (sample + 1 < way.end) end = std::min(end, 0.5_r * (t + t_[sample + 1]));
  return {begin, end};
}

std::pair<double, double> GridIntegrator::stretch_of(const Way& way, size_t sample) const {
  const Real front = front_[sample], back = front + delta_[sample];
  const Real next = sample + 1 < way.end ? front_[sample + 1] : back;
  const bool whole = std::fabs(next - back) <= 1e-3_r * delta_[sample];
  const auto [begin, end] = whole ? std::pair{front, back} : interval_of(way, sample);
  return {way.start + static_cast<double>(begin), way.start + static_cast<double>(end)};
}

bool GridIntegrator::is_apart(const Way& way, Real t, Real delta, Real weight) {
  return way.front < 0 || (weight > kFaint && t - 1.5_r * delta > way.back);
}

void GridIntegrator::begin_stretch(Way& way, Real t, Real delta, double transmittance) {
  way.front = std::max(t - 0.5_r * delta, way.back);
  way.back = std::max(t + 0.5_r * delta, way.front);
  way.before = transmittance;
}

void GridIntegrator::close_stretch(Way& way, double transmittance) {
  if (way.front < 0) return;
  DeepSample& sample = sink_.deep[way.place].emplace_back();
  sample.front = static_cast<Real>(way.start + way.front);
  sample.back = static_cast<Real>(way.start + way.back);
  sample.weight = static_cast<Real>(way.before - transmittance);
  way.front = -1;
}

}  // namespace nerf::internal
