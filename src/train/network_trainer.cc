#include "train/network_trainer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "nerf/base/error.h"
#include "nerf/kernels/adam.h"
#include "nerf/math/step_function.h"
#include "nerf/train/evaluation.h"
#include "train/lap.h"

namespace nerf {

int network_accumulators(size_t weights) {
  constexpr size_t kFloats = size_t{1} << 26;
  return static_cast<int>(std::clamp<size_t>(kFloats / std::max<size_t>(weights, 1), 4, 32));
}

NetworkLosses losses_of(const NetworkRecipe& r, bool depth) {
  return {
      r.coarse,          r.interlevel,
      r.distortion,      r.charbonnier > 0 ? PixelLoss::charbonnier(r.charbonnier) : PixelLoss(),
      r.density_noise,   r.negligible,
      r.least_deviation, r.transient_density,
      r.elastic > 0,     depth};
}

namespace {

// The mean camera of the training views, as NeRF's load_llff.py averages them.
NdcFrame ndc_frame(const Scene& scene, const PhotoSet& photos) {
  Vec3d centre, forward, down;
  for (const int v : scene.train) {
    const Pose pose = scene.to_engine.apply(scene.views[static_cast<size_t>(v)].pose);
    centre = centre + pose.translation / static_cast<double>(scene.train.size());
    forward = forward + pose.rotation.column(2);
    down = down + pose.rotation.column(1);
  }
  const auto refuse = [&](const char* what) {
    throw Error(what, scene.root.string(),
                "normalised device coordinates are for cameras that all look the same way; take "
                "--network-space identity or contract");
  };
  if (!(length(forward) > 0.5 * static_cast<double>(scene.train.size())))
    refuse("the cameras look in opposite directions");
  NdcFrame frame;
  const Vec3d z = normalized(forward), x = normalized(cross(down, z));
  frame.reference.rotation.set_column(0, x);
  frame.reference.rotation.set_column(1, cross(z, x));
  frame.reference.rotation.set_column(2, z);
  frame.reference.translation = centre;
  for (const int v : scene.train) {
    const Pose pose = scene.to_engine.apply(scene.views[static_cast<size_t>(v)].pose);
    if (!(dot(pose.rotation.column(2), z) > 0.2)) refuse("a camera does not look forward");
    // A camera before the near plane would see nothing of what is between.
    if (!(dot(pose.translation - centre, z) < scene.near))
      refuse("a camera stands before the nearest content of the others");
  }
  for (const int v : scene.train)
    if (is_panorama(photos.cameras[static_cast<size_t>(v)])) refuse("a panorama sees all around");
  const Camera& camera = photos.cameras[static_cast<size_t>(scene.train.front())];
  frame.scale_x = camera.fx() / (0.5 * camera.width);
  frame.scale_y = camera.fy() / (0.5 * camera.height);
  frame.near = scene.near;
  return frame;
}

}  // namespace

uint64_t NetworkTrainer::memory_bytes(const TrainOptions& o, bool /*unbounded*/, int threads) {
  const uint64_t weights = place_networks(o.network).back().end;
  const uint64_t accumulators = static_cast<uint64_t>(network_accumulators(weights));
  const int rays = std::min(NetworkLevels::rays_per_chunk(o.network), o.recipe.rays);
  const uint64_t worker =
      NetworkLevels::memory_bytes(o.network, rays, true, losses_of(o.recipe, /*depth=*/true));
  // Besides the field's weights: again with gradient and moments while a checkpoint is read or a
  // model saved.
  const uint64_t memory = o.recipe.empty_steps > 0 ? internal::MatterMemory::memory_bytes() : 0;
  return memory + (1 + 1 + DenseParameters::kArrays) * weights * sizeof(Real) +
         DenseParameters::memory_bytes(weights, accumulators) +
         static_cast<uint64_t>(threads) * worker +
         static_cast<uint64_t>(o.recipe.rays) * sizeof(NetworkRay);
}

NetworkTrainer::NetworkTrainer(const Scene& s, const PhotoSet& p, const TrainOptions& o,
                               ThreadPool& t)
    : TrainerImpl(s, p, o, t, {Rise::kQuarterSine, Fall::kExponential, o.recipe.warmup_rate}),
      moments(s),
      ranges(ranges_of_views(s, o)),
      field(codes_for(options_for(o.network, o.method, s, masked.first > 0, moments), moments,
                      source),
            options_for(o.network, o.method, s, masked.first > 0, moments),
            range_of_field(s, o, ranges).near, range_of_field(s, o, ranges).far),
      still(s, field, o.recipe, t.size()),
      rays_per_chunk(std::min(NetworkLevels::rays_per_chunk(field.options), o.recipe.rays)),
      rays(static_cast<size_t>(o.recipe.rays)),
      drawn(rays.size()) {
  std::vector<ParameterSection> sections;
  if (field.weights.size() > field.network_size())
    sections.push_back({"the photos' codes", field.network_size(), field.weights.size()});
  const DeformNetworks& deform = field.networks.back().deform;
  if (deform.end > deform.begin)
    sections.push_back({"the warp", deform.begin, deform.end, o.recipe.clip});
  for (size_t k = 0; k < field.networks.size(); ++k)
    sections.push_back({"network " + std::to_string(k + 1), field.networks[k].begin,
                        field.networks[k].end, o.recipe.clip});
  dense =
      std::make_unique<DenseParameters>(field.weights.span(), field.layers(), std::move(sections),
                                        network_accumulators(field.weights.size()));
  sums.resize(static_cast<size_t>(dense->accumulators()));
  if (o.network.space == Space::kNdc) field.ndc = ndc_frame(s, p);
  field.initialise(seed());
  dense->pack(options.precision, pool);
  if (o.recipe.empty_steps > 0)
    memory = std::make_unique<internal::MatterMemory>(o.recipe.empty_steps);
  workers = make_workers(losses_of(o.recipe, depth_weight > 0));
  still.use_packs(&dense->packs());
  open_windows();
}

void NetworkTrainer::open_windows() {
  field.windows = windows_at(field.options, options.recipe, done);
}

NetworkTrainer::Workers NetworkTrainer::make_workers(const NetworkLosses& losses) const {
  Workers made;
  for (int i = 0; i < pool.size(); ++i) {
    made.push_back(
        std::make_unique<NetworkLevels>(field, rays_per_chunk, /*training=*/true, losses));
    made.back()->use_packs(&dense->packs());
    if (made.back()->can_skip()) made.back()->skip_empty(memory.get());
  }
  return made;
}

void NetworkTrainer::check_open() const {
  if (options.network.transient_code > 0)
    throw Error("a step whose pixels show transient matter has no loss but its own",
                "Trainer::begin_step", "train with --network-transient-code 0, or call step()");
}

Real NetworkTrainer::exponent() const {
  const NetworkRecipe& recipe = options.recipe;
  if (!recipe.anneal) return 1;
  const int64_t length =
      recipe.anneal_steps > 0 ? recipe.anneal_steps : options.plan().length_at(done);
  const double share = std::min(
      1.0, static_cast<double>(done) / static_cast<double>(std::max<int64_t>(length - 1, 1)));
  return annealing_exponent(static_cast<Real>(share));
}

void NetworkTrainer::set_gradient(size_t first_ray, size_t count, NetworkLevels& levels) const {
  constexpr Real kNone[4] = {0, 0, 0, 0};
  const size_t of_rendering = 4 * pixels.rays.size();
  for (int k = 0; k < pixels.renderings; ++k)
    for (size_t r = 0; r < count; ++r) {
      const int32_t at = listed[first_ray + r];
      const Real* gradient = at < 0
                                 ? kNone
                                 : pixel_gradient.data() + static_cast<size_t>(k) * of_rendering +
                                       4 * static_cast<size_t>(at);
      levels.set_gradient(k, static_cast<int>(r), gradient);
    }
}

void NetworkTrainer::render() {
  if (given_workers.empty()) {
    NetworkLosses losses = losses_of(options.recipe, depth_weight > 0);
    losses.pixel = {PixelLoss::Kind::kGiven};
    given_workers = make_workers(losses);
  }
  listed.assign(rays.size(), -1);
  const bool from_photos = given.empty();
  pixels.rays.clear();
  for (size_t i = 0; i < rays.size(); ++i) {
    // A given ray keeps its place, though there may be nothing to see along it.
    if (drawn[i]) listed[i] = static_cast<int32_t>(from_photos ? pixels.rays.size() : i);
    if (drawn[i] || !from_photos) pixels.rays.push_back(from_photos ? lines[i] : given[i]);
    if (!drawn[i] || !from_photos) continue;
    for (int k = 0; k < 3; ++k) pixels.target.push_back(rays[i].target[k]);
    pixels.scale.push_back(rays[i].scale);
  }
  const size_t count = pixels.rays.size();
  pixels.renderings = given_workers.front()->renderings();
  pixels.rgba.assign(4 * count * static_cast<size_t>(pixels.renderings), 0.0_r);
  for (size_t at = 0; at < pixels.rgba.size(); at += 4)
    for (size_t k = 0; k < 3; ++k)
      pixels.rgba[at + k] = pixels.rays[at / 4 % count].background[static_cast<int>(k)];
  const Real power = exponent();
  const bool skip = skipping();
  const size_t per = static_cast<size_t>(rays_per_chunk);
  pool.parallel_for_thread(
      static_cast<int64_t>((rays.size() + per - 1) / per), [&](int64_t c, int thread) {
        NetworkLevels& levels = *given_workers[static_cast<size_t>(thread)];
        const size_t begin = static_cast<size_t>(c) * per, end = std::min(rays.size(), begin + per);
        // A copy: its random numbers are drawn once more when the step is finished.
        std::vector<NetworkRay> part(rays.begin() + static_cast<std::ptrdiff_t>(begin),
                                     rays.begin() + static_cast<std::ptrdiff_t>(end));
        levels.forward(part, power, skip);
        for (size_t r = 0; r < part.size(); ++r) {
          if (listed[begin + r] < 0) continue;
          for (int k = 0; k < pixels.renderings; ++k)
            levels.rendered(k, static_cast<int>(r),
                            pixels.rgba.data() + 4 * (static_cast<size_t>(k) * count +
                                                      static_cast<size_t>(listed[begin + r])));
        }
      });
}

bool NetworkTrainer::skipping() const {
  return options.recipe.skip && workers[0]->can_skip() && dense_share < NetworkLevels::kSkipPays;
}

TrainerImpl::HeadSums NetworkTrainer::head(StepReport& report) {
  const int64_t chunks = (static_cast<int64_t>(rays.size()) + rays_per_chunk - 1) / rays_per_chunk;
  const int64_t count = dense->accumulators();
  const int64_t per = (chunks + count - 1) / count;
  const int64_t still_per = (still.chunks() + count - 1) / count;
  const Real exponent = this->exponent(), elastic = elastic_at(options.recipe, done);
  const Real depth = static_cast<Real>(depth_weight_now());
  const bool skip = skipping();
  pool.parallel_for_thread(count, [&](int64_t a, int thread) {
    NetworkLevels& levels = *(open ? given_workers : workers)[static_cast<size_t>(thread)];
    levels.weigh_elastic(elastic);
    levels.weigh_depth(depth);
    Real* const gradient = dense->begin_sum(a);
    Sums& s = sums[static_cast<size_t>(a)];
    s = {};
    for (int64_t c = a * per; c < std::min(chunks, (a + 1) * per); ++c) {
      const size_t begin = static_cast<size_t>(c * rays_per_chunk);
      const size_t end = std::min(rays.size(), begin + static_cast<size_t>(rays_per_chunk));
      const std::span<NetworkRay> part(rays.data() + begin, end - begin);
      levels.forward(part, exponent, skip);
      s.dense += levels.dense_samples();
      s.all += levels.all_samples();
      s.unasked += levels.unasked_samples();
      if (open) set_gradient(begin, part.size(), levels);
      s.loss += levels.backward(gradient);
      for (size_t r = 0; r < part.size(); ++r) {
        if (part[r].scale == 0 || !given.empty() || part[r].photo < 0) continue;
        Real rgb[3], opacity;
        levels.pixel(static_cast<int>(r), rgb, opacity);
        for (int k = 0; k < 3; ++k)
          s.squared_error += std::pow(static_cast<double>(rgb[k] - part[r].target[k]), 2);
        s.opacity += static_cast<double>(opacity);
      }
    }
    for (int64_t c = a * still_per; c < std::min(still.chunks(), (a + 1) * still_per); ++c)
      s.loss += still.backward(seed(), done, c, thread, gradient);
  });

  HeadSums out;
  int64_t skipped = 0, unasked = 0;
  for (const Sums& s : sums) {
    report.loss += s.loss;
    out.squared_error += s.squared_error;
    out.opacity += s.opacity;
    skipped += s.all - s.dense;
    unasked += s.unasked;
  }
  report.rays = std::ranges::count(drawn, uint8_t{1});
  int64_t shown = 0;  // by photos
  for (size_t i = 0; i < rays.size(); ++i)
    shown += drawn[i] && (rays[i].photo >= 0 || !given.empty());
  out.squared_error /= 3 * static_cast<double>(std::max<int64_t>(shown, 1));
  // Those that a network saw forward and backward.
  report.samples = report.rays * field.options.sampling.all_samples() - unasked;
  if (skip) report.samples -= skipped;
  return out;
}

AdamStep NetworkTrainer::dense_step() const {
  AdamStep adam;
  adam.rate = rate_at(done);
  adam.beta2 = static_cast<Real>(options.recipe.beta2);
  adam.epsilon = static_cast<Real>(options.recipe.epsilon);
  return adam;
}

void NetworkTrainer::observe(const StepReport& /*report*/, const PhaseSeconds& /*seconds*/) {
  int64_t dense_samples = 0, all = 0;
  for (const Sums& s : sums) {
    dense_samples += s.dense;
    all += s.all;
  }
  dense_share = all > 0 ? static_cast<double>(dense_samples) / static_cast<double>(all) : 1;
}

void NetworkTrainer::refresh() {
  if (memory) memory->advance(done, pool);
}

void NetworkTrainer::begin_anew() {
  if (memory) memory->forget();
  dense_share = 1;
  dense->forget();
  field.initialise(seed());
  dense->pack(options.precision, pool);
}

// With what is open by now.
RadianceField NetworkTrainer::snapshot(ModelInfo info) const {
  auto copy = std::make_shared<NetworkField>(field);
  copy->windows = windows_at(field.options, options.recipe, done);
  return RadianceField(std::move(info), std::move(copy));
}

namespace {

template <class T, class Visit>
void visit_arrays(T& t, Visit&& visit) {
  visit("networks", t.field.weights.span());
  visit("networks_m", t.dense->m.span());
  visit("networks_v", t.dense->v.span());
  if (t.memory) visit("matter_ages", t.memory->state());
}

}  // namespace

void NetworkTrainer::save_state(internal::ContainerWriter& file,
                                nlohmann::ordered_json& scalars) const {
  scalars["dense_share"] = dense_share;
  visit_arrays(*this, [&](const char* name, auto values) {
    file.add(name, std::span<const typename decltype(values)::value_type>(values));
  });
}

void NetworkTrainer::load_state(const internal::ContainerReader& file,
                                const internal::JsonFields& scalars) {
  visit_arrays(*this, [&](const char* name, auto values) { file.read(name, values); });
  dense_share = scalars.number("dense_share");
  if (memory) memory->look(pool);
  dense->pack(options.precision, pool);
}

}  // namespace nerf
