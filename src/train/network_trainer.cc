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
    : TrainerImpl(s, p, o, t),
      field(network_of(s, o), first_distance(s, o), last_distance(s, o), source.files()),
      gradient(field.weights.size()),
      m(field.weights.size()),
      v(field.weights.size()),
      rays_per_chunk(std::min(NetworkLevels::rays_per_chunk(field.options), o.recipe.rays)),
      rays(static_cast<size_t>(o.recipe.rays)),
      drawn(rays.size()) {
  check_range(s, o);
  for (int i = 0; i < pool.size(); ++i)
    workers.push_back(std::make_unique<NetworkLevels>(field, rays_per_chunk, /*training=*/true,
                                                      losses_of(o.recipe)));
  const int count = network_accumulators(field.weights.size());
  for (int i = 0; i < count; ++i) accumulators.emplace_back(field.weights.size());
  sums.resize(accumulators.size());
  if (o.network.space == Space::kNdc) field.ndc = ndc_frame(s, p);
  field.initialise(options.seed ^ salt);
  pack();
  for (const auto& levels : workers) levels->use_packs(&packs);
}

void NetworkTrainer::pack() {
  pack_layers(field.layers(), field.weights.data(), options.precision, packs, pool);
}

// Exponential fall (bmild/nerf: rate 0.1^(t / decay); mip-NeRF: log-linear), after a warm-up along
// a quarter sine (mip-NeRF's math.py).
Real NetworkTrainer::rate_at(int64_t step) const {
  double rise = 1;
  if (options.warmup_steps > 0) {
    const double share =
        std::min(1.0, static_cast<double>(step) / static_cast<double>(options.warmup_steps));
    rise = std::lerp(options.recipe.warmup_rate, 1.0, std::sin(0.5 * 3.14159265358979 * share));
  }
  return static_cast<Real>(options.rate * rate_factor * rise *
                           std::pow(options.final_rate, progress_at(step)));
}

void NetworkTrainer::draw_rays() {
  constexpr int64_t kBlock = 64;
  const NetworkRecipe& recipe = options.recipe;
  const uint64_t seed = options.seed ^ salt, step = static_cast<uint64_t>(done);
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
      if (found) cast = cast_ray(field, *pixel.camera, *pixel.pose, {pixel.x + 0.5, pixel.y + 0.5});
      drawn[static_cast<size_t>(i)] = cast.has_value();
      ray = cast.value_or(NetworkRay{});
      ray.random = random;
      ray.background = background;
      if (!cast) continue;
      ray.photo = source.file_of(pixel.source);
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

void NetworkTrainer::run_chunks() {
  const int64_t chunks = (static_cast<int64_t>(rays.size()) + rays_per_chunk - 1) / rays_per_chunk;
  const int64_t count = static_cast<int64_t>(accumulators.size());
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
    AlignedArray<Real>& sum = accumulators[static_cast<size_t>(a)];
    std::fill(sum.begin(), sum.end(), 0.0_r);
    Sums& s = sums[static_cast<size_t>(a)];
    s = {};
    for (int64_t c = a * per; c < std::min(chunks, (a + 1) * per); ++c) {
      const size_t begin = static_cast<size_t>(c * rays_per_chunk);
      const size_t end = std::min(rays.size(), begin + static_cast<size_t>(rays_per_chunk));
      const std::span<NetworkRay> part(rays.data() + begin, end - begin);
      levels.forward(part, exponent, skip);
      s.dense += levels.dense_samples();
      s.all += levels.all_samples();
      s.loss += levels.backward(sum.data());
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
}

// In the order of the accumulators, whatever thread filled them.
void NetworkTrainer::reduce_gradient() {
  constexpr int64_t kBlock = 4096;
  const int64_t n = static_cast<int64_t>(gradient.size());
  pool.parallel_for((n + kBlock - 1) / kBlock, [&](int64_t block) {
    const int64_t begin = block * kBlock, end = std::min(n, begin + kBlock);
    std::fill(gradient.data() + begin, gradient.data() + end, 0.0_r);
    for (const AlignedArray<Real>& a : accumulators)
      for (int64_t i = begin; i < end; ++i) gradient.data()[i] += a.data()[i];
  });
}

void NetworkTrainer::clip_gradient() {
  for (size_t i = field.network_size(); i < gradient.size(); ++i)
    if (!std::isfinite(gradient[i]))
      throw NonFiniteError("the gradient of the photos' codes at step " + std::to_string(done + 1) +
                           " is not finite");
  for (size_t k = 0; k < field.networks.size(); ++k) {
    const RadianceNetwork& network = field.networks[k];
    double square = 0;
    for (size_t i = network.begin; i < network.end; ++i)
      square += static_cast<double>(gradient[i]) * static_cast<double>(gradient[i]);
    if (!std::isfinite(square))
      throw NonFiniteError("the gradient of network " + std::to_string(k + 1) + " at step " +
                           std::to_string(done + 1) + " is not finite");
    const double norm = std::sqrt(square), most = options.recipe.clip;
    if (!(most > 0) || norm <= most) continue;
    const Real factor = static_cast<Real>(most / norm);
    for (size_t i = network.begin; i < network.end; ++i) gradient[i] *= factor;
  }
}

StepReport NetworkTrainer::step() {
  Lap lap;
  draw_rays();
  lap.into(profile.rays);
  run_chunks();
  lap.into(profile.network);
  StepReport report;
  double squared_error = 0;
  for (const Sums& s : sums) {
    report.loss += s.loss;
    squared_error += s.squared_error;
    report.opacity += s.opacity;
  }
  check_loss(report.loss);
  report.rays = std::ranges::count(drawn, uint8_t{1});
  const double count = static_cast<double>(std::max<int64_t>(report.rays, 1));
  report.opacity /= count;
  report.psnr = -10 * std::log10(std::max(squared_error / (3 * count), 1e-10));
  int64_t dense = 0, all = 0;
  for (const Sums& s : sums) {
    dense += s.dense;
    all += s.all;
  }
  // Those that a network saw forward and backward.
  report.samples = report.rays * field.options.sampling.all_samples();
  if (skipping()) report.samples -= all - dense;
  reduce_gradient();
  clip_gradient();
  report.rate = static_cast<double>(rate_at(done));
  AdamStep adam;
  adam.rate = rate_at(done);
  adam.beta2 = static_cast<Real>(options.recipe.beta2);
  adam.epsilon = static_cast<Real>(options.recipe.epsilon);
  constexpr int64_t kBlock = 1 << 16;
  const int64_t n = static_cast<int64_t>(gradient.size());
  pool.parallel_for((n + kBlock - 1) / kBlock, [&](int64_t block) {
    const int64_t at = block * kBlock;
    adam_dense(adam, done + 1, std::min(kBlock, n - at), gradient.data() + at, m.data() + at,
               v.data() + at, field.weights.data() + at);
  });
  pack();
  lap.into(profile.update);
  dense_share = all > 0 ? static_cast<double>(dense) / static_cast<double>(all) : 1;
  report.step = ++done;
  return report;
}

void NetworkTrainer::begin_anew() {
  dense_share = 1;
  std::fill(m.begin(), m.end(), 0.0_r);
  std::fill(v.begin(), v.end(), 0.0_r);
  field.initialise(options.seed ^ salt);
  pack();
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
  visit("networks_m", t.m.span());
  visit("networks_v", t.v.span());
}

}  // namespace

void NetworkTrainer::save_state(internal::ContainerWriter& file,
                                nlohmann::ordered_json& scalars) const {
  scalars["dense_share"] = dense_share;
  visit_arrays(*this, [&](const char* name, auto values) { file.add(name, values); });
}

void NetworkTrainer::load_state(const internal::ContainerReader& file,
                                const internal::JsonFields& scalars) {
  visit_arrays(*this, [&](const char* name, auto values) { file.read(name, values); });
  dense_share = scalars.number("dense_share");
  pack();
}

}  // namespace nerf
