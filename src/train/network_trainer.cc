#include "train/network_trainer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "nerf/kernels/adam.h"
#include "nerf/math/step_function.h"
#include "nerf/train/evaluation.h"
#include "train/lap.h"

namespace nerf {

int network_accumulators(size_t weights) {
  constexpr size_t kFloats = size_t{1} << 26;
  return static_cast<int>(std::clamp<size_t>(kFloats / std::max<size_t>(weights, 1), 4, 32));
}

NetworkLosses losses_of(const NetworkRecipe& r) {
  return {r.coarse, r.interlevel, r.distortion, r.charbonnier, r.density_noise, r.negligible};
}

namespace {

// Behind photos with alpha is the background: nothing there must be opaque.
NetworkOptions network_of(const Scene& scene, const TrainOptions& o) {
  NetworkOptions network = o.network;
  network.opaque_end = network.opaque_end && !scene.alpha;
  return network;
}

// Through the cube of normalised device coordinates t runs from 0 to 1.
double first_distance(const Scene& scene, const TrainOptions& o) {
  if (o.network.space == Space::kNdc) return 0;
  if (o.recipe.near > 0) return o.recipe.near;
  return scene.published_near > 0 ? scene.published_near : scene.near;
}
double last_distance(const Scene& scene, const TrainOptions& o) {
  if (o.network.space == Space::kNdc) return 1;
  if (o.recipe.far > 0) return o.recipe.far;
  return scene.published_far > 0 ? scene.published_far : scene.far;
}

void check_range(const Scene& scene, const TrainOptions& o) {
  const double near = first_distance(scene, o), far = last_distance(scene, o);
  if (static_cast<Real>(near) < static_cast<Real>(far)) return;
  throw Error(
      fmt::format("samples would begin at {:.4g} and end at {:.4g} engine units", near, far),
      "--recipe-near, --recipe-far",
      "give a near distance below the far one; without them they come from the capture");
}

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

NetworkTrainer::NetworkTrainer(const Scene& s, const PhotoSet& p, const TrainOptions& o,
                               ThreadPool& t)
    : TrainerImpl(s, p, o, t, {Rise::kQuarterSine, Fall::kExponential, o.recipe.warmup_rate}),
      field(network_of(s, o), first_distance(s, o), last_distance(s, o), source.files()),
      rays_per_chunk(std::min(NetworkLevels::rays_per_chunk(field.options), o.recipe.rays)),
      rays(static_cast<size_t>(o.recipe.rays)),
      drawn(rays.size()) {
  check_range(s, o);
  for (int i = 0; i < pool.size(); ++i)
    workers.push_back(std::make_unique<NetworkLevels>(field, rays_per_chunk, /*training=*/true,
                                                      losses_of(o.recipe)));
  std::vector<ParameterSection> sections;
  if (field.weights.size() > field.network_size())
    sections.push_back({"the photos' codes", field.network_size(), field.weights.size()});
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
  for (const auto& levels : workers) levels->use_packs(&dense->packs());
}

void NetworkTrainer::draw() {
  constexpr int64_t kBlock = 64;
  const NetworkRecipe& recipe = options.recipe;
  const uint64_t seed = this->seed(), step = static_cast<uint64_t>(done);
  // Of the step, not of a ray: no ray has this number.
  const size_t photo = static_cast<size_t>(
      Random(seed, step, uint64_t{1} << 62).below(static_cast<uint64_t>(source.photos())));
  const bool from_one = recipe.one_photo || done < recipe.crop_steps;
  const double share = done < recipe.crop_steps ? recipe.crop : 1;
  const Vec3 background = scene.alpha ? background_of(options, scene) : Vec3{0, 0, 0};
  const int64_t n = static_cast<int64_t>(rays.size());
  pool.parallel_for((n + kBlock - 1) / kBlock, [&](int64_t block) {
    for (int64_t i = block * kBlock; i < std::min(n, (block + 1) * kBlock); ++i) {
      NetworkRay& ray = rays[static_cast<size_t>(i)];
      Random random(seed, step, static_cast<uint64_t>(i));
      PixelSource::Pixel pixel;
      constexpr int kMostTries = 64;  // of pixels that are masked out or have no ray
      bool found = false;
      for (int tries = 0; tries < kMostTries && !found; ++tries)
        found =
            from_one ? source.draw_from(photo, random, share, pixel) : source.draw(random, pixel);
      std::optional<NetworkRay> cast;
      if (found) {
        pixel.ray.radius = cast_radius(field, *pixel.camera, *pixel.pose, pixel.centre());
        pixel.ray.background = background;
        cast = sampled_ray(field, pixel.ray);
      }
      drawn[static_cast<size_t>(i)] = cast.has_value();
      ray = cast.value_or(NetworkRay{});
      ray.random = random;
      if (!cast) continue;
      ray.scale = pixel.weight;
      for (int k = 0; k < 3; ++k)
        ray.target[k] = pixel.rgb[k] * pixel.alpha + background[k] * (1 - pixel.alpha);
    }
  });
  // Those without a pixel repeat the first that has one, at no weight.
  const auto first = std::ranges::find(drawn, uint8_t{1});
  double weight = 0;
  for (size_t i = 0; i < rays.size(); ++i)
    if (drawn[i]) weight += static_cast<double>(rays[i].scale);
  const Real scale = static_cast<Real>(1 / (3 * std::max(weight, 1.0)));
  for (size_t i = 0; i < rays.size(); ++i) {
    if (drawn[i]) {
      rays[i].scale *= scale;
    } else if (first != drawn.end()) {
      const Random random = rays[i].random;
      rays[i] = rays[static_cast<size_t>(first - drawn.begin())];
      rays[i].random = random;
      rays[i].scale = 0;
    }
  }
}

bool NetworkTrainer::skipping() const {
  return options.recipe.skip && workers[0]->can_skip() && dense_share < NetworkLevels::kSkipPays;
}

TrainerImpl::HeadSums NetworkTrainer::head(StepReport& report) {
  const int64_t chunks = (static_cast<int64_t>(rays.size()) + rays_per_chunk - 1) / rays_per_chunk;
  const int64_t count = dense->accumulators();
  const int64_t per = (chunks + count - 1) / count;
  const NetworkRecipe& recipe = options.recipe;
  const int64_t length =
      recipe.anneal_steps > 0 ? recipe.anneal_steps : options.plan().length_at(done);
  const double share = std::min(
      1.0, static_cast<double>(done) / static_cast<double>(std::max<int64_t>(length - 1, 1)));
  const Real exponent = recipe.anneal ? annealing_exponent(static_cast<Real>(share)) : 1.0_r;
  const bool skip = skipping();
  pool.parallel_for_thread(count, [&](int64_t a, int thread) {
    NetworkLevels& levels = *workers[static_cast<size_t>(thread)];
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
      s.loss += levels.backward(gradient);
      for (size_t r = 0; r < part.size(); ++r) {
        if (part[r].scale == 0) continue;
        Real rgb[3], opacity;
        levels.pixel(static_cast<int>(r), rgb, opacity);
        for (int k = 0; k < 3; ++k)
          s.squared_error += std::pow(static_cast<double>(rgb[k] - part[r].target[k]), 2);
        s.opacity += static_cast<double>(opacity);
      }
    }
  });

  HeadSums out;
  int64_t skipped = 0;
  for (const Sums& s : sums) {
    report.loss += s.loss;
    out.squared_error += s.squared_error;
    out.opacity += s.opacity;
    skipped += s.all - s.dense;
  }
  report.rays = std::ranges::count(drawn, uint8_t{1});
  out.squared_error /= 3 * static_cast<double>(std::max<int64_t>(report.rays, 1));
  // Those that a network saw forward and backward.
  report.samples = report.rays * field.options.sampling.all_samples();
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

void NetworkTrainer::begin_anew() {
  dense_share = 1;
  dense->forget();
  field.initialise(seed());
  dense->pack(options.precision, pool);
}

RadianceField NetworkTrainer::snapshot(ModelInfo info) const {
  // Without the photos' codes, which new views do not have.
  auto network = std::make_shared<NetworkField>(field.options, field.near, field.far);
  std::copy_n(field.weights.begin(), network->weights.size(), network->weights.begin());
  network->ndc = field.ndc;
  return RadianceField(std::move(info), std::move(network));
}

namespace {

template <class T, class Visit>
void visit_arrays(T& t, Visit&& visit) {
  visit("networks", t.field.weights.span());
  visit("networks_m", t.dense->m.span());
  visit("networks_v", t.dense->v.span());
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
  dense->pack(options.precision, pool);
}

}  // namespace nerf
