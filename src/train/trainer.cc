#include "nerf/train/trainer.h"

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"
#include "nerf/train/methods.h"
#include "train/camera_refinement.h"
#include "train/method_rows.h"
#include "train/rolling_shutter.h"
#include "train/trainer_impl.h"

namespace nerf {

template CollectedOptions collect_options(TrainOptions&);

namespace {

// A program may have filled the options in without any check; the arrays rely on their limits.
TrainOptions validated(TrainOptions options) {
  validate_options(options, "TrainOptions");
  options.precision = resolve_precision(options.precision);
  return options;
}

std::unique_ptr<TrainerImpl> make_trainer(const Scene& scene, const PhotoSet& photos,
                                          const TrainOptions& options, ThreadPool& pool) {
  return internal::family_of(options).make_trainer(scene, photos, options, pool);
}

}  // namespace

void TrainOptions::check_options() const {
  grid.check_options();
  network.check_options();
  if (!plan_changes.list.empty() && steps <= plan_changes.list.back().step)
    throw Error("the length of the training changes at a step that it does not have",
                "--plan-changes", "give --steps too, above the last STEP");
  internal::family_of(*this).check(*this);
}

Vec3 background_of(const TrainOptions& options, const Scene& scene) {
  return scene.cut_out ? to_vec3(*scene.cut_out) : colour_of(options.background);
}

double distortion_weight(const TrainOptions& options, const Scene& scene) {
  constexpr double kUnbounded = 0.02;  // docs/benchmarks.md, "What changed the quality"
  return options.grid_recipe.distortion.value_or(scene.unbounded ? kUnbounded : 0.0);
}

namespace {

// Along a ray's direction, as depth maps and points give them.
bool learns_distances(const TrainOptions& options) {
  return options.network.space != Space::kNdc || !reads_option(options.method, "network.space");
}

}  // namespace

double depth_loss_weight(const TrainOptions& options, const Scene& scene, const PhotoSet& photos) {
  constexpr double kUsual = 0.1;  // docs/benchmarks.md, "Depth maps"
  const auto has_depth = [&](int v) {
    return !photos.photos[static_cast<size_t>(v)].depth.empty();
  };
  const bool any =
      std::ranges::any_of(scene.train, has_depth) || point_depth_share(options, scene) > 0;
  if (!learns_distances(options) || !any) return 0;
  return options.pixel_recipe.depth_loss.value_or(kUsual);
}

double point_depth_share(const TrainOptions& options, const Scene& scene) {
  if (scene.observations.empty() || !learns_distances(options)) return 0;
  return options.pixel_recipe.point_depth.value_or(0.0);
}

bool learns_sky(const TrainOptions& options, const Scene& scene) {
  const GridRecipe& recipe = options.grid_recipe;
  return recipe.light.sky == Switch::kOn && !scene.alpha &&
         recipe.medium.medium == LearntMedium::kNone;
}

bool masks_cut_out(const PhotoSet& photos) { return photos.fraction_masked > 0.5; }

double MaskedShare::at(double progress) const {
  return first > 0 ? first * std::pow(last / first, progress) : 0;
}

MaskedShare masked_share(const TrainOptions& options, const PhotoSet& photos) {
  // What was emptied early stays so. Beside what stands in the way of a scene photos do show
  // something, which must not be held back for long (docs/wild.md).
  constexpr double kCutOut = 0.3, kInTheWay = 0.1, kLastInTheWay = 0.01;
  if (photos.fraction_masked == 0) return {};
  const bool cut_out = masks_cut_out(photos);
  const double drawn = cut_out ? kCutOut : kInTheWay;
  const double usual = internal::family_of(options).draws_masked ? drawn : 0;
  const double first = options.pixel_recipe.masked_share.value_or(usual);
  return {first, cut_out ? first : kLastInTheWay * first};
}

TrainingPlan TrainOptions::plan() const { return {steps, hold, plan_changes}; }

Trainer::Trainer(const Scene& scene, const PhotoSet& photos, const TrainOptions& options,
                 ThreadPool& pool)
    : impl_(make_trainer(scene, photos, validated(options), pool)) {}
Trainer::~Trainer() = default;

StepReport Trainer::step() { return impl_->step(); }
const RayPixels& Trainer::begin_step(std::span<const Ray> rays) { return impl_->begin_step(rays); }
StepReport Trainer::finish_step(std::span<const Real> gradient, double loss) {
  return impl_->finish_step(gradient, loss);
}
int64_t Trainer::most_rays() const { return impl_->most_rays(); }
TrainerImpl& internal::impl_of(Trainer& trainer) { return *trainer.impl_; }

void Trainer::run(const std::function<bool(const StepReport&)>& callback, const Cancel* cancel) {
  while (impl_->done < impl_->options.steps) {
    if (cancel && cancel->requested()) return;
    const StepReport report = impl_->step();
    if (callback && !callback(report)) return;
  }
}

int64_t Trainer::steps_done() const { return impl_->done; }
const TrainOptions& Trainer::options() const { return impl_->options; }
const TrainProfile& Trainer::profile() const { return impl_->profile; }
void Trainer::set_planned_steps(int64_t steps) {
  TrainOptions& o = impl_->options;
  o.plan_changes = o.plan().changed(impl_->done, steps, depends_on_length(o)).changes;
  o.steps = steps;
}

std::vector<Trainer::LeftOut> Trainer::left_out() const {
  std::vector<LeftOut> out;
  const RobustMask* mask = impl_->robust_mask();
  for (size_t i = 0; mask && i < impl_->scene.train.size(); ++i) {
    const size_t v = static_cast<size_t>(impl_->scene.train[i]);
    const Photo& photo = impl_->photos.photos[v];
    Image8 picture{photo.width, photo.height, 1, {}};
    for (int y = 0; y < photo.height; ++y)
      for (int x = 0; x < photo.width; ++x)
        picture.pixels.push_back(mask->is_left_out(i, x, y) ? 0 : 255);
    out.push_back({impl_->scene.views[v].name, std::move(picture)});
  }
  return out;
}

RadianceField Trainer::snapshot() const {
  ModelInfo info;
  info.method = impl_->options.method;
  info.to_engine = impl_->scene.to_engine;
  info.unbounded = impl_->scene.unbounded;
  info.alpha = impl_->scene.alpha;
  if (info.alpha) info.background = background_of(impl_->options, impl_->scene);
  info.near = impl_->scene.near;
  info.far = impl_->scene.far;
  info.times = impl_->scene.times;
  std::vector<bool> held_out(impl_->scene.views.size(), false);
  for (int v : impl_->scene.test) held_out[static_cast<size_t>(v)] = true;
  for (size_t v = 0; v < impl_->scene.views.size(); ++v) {
    const View& view = impl_->scene.views[v];
    if (view.scale > 1) continue;  // the same camera again
    info.views.push_back(
        {view.name, impl_->photos.cameras[v], view.pose, held_out[v], view.time, view.ids, {}});
    if (const CameraRefinement* const refined = impl_->refined_cameras()) {
      info.views.back().camera = refined->camera(v);
      info.views.back().pose = refined->pose(v);
    }
    if (const RollingShutter* const shutter = impl_->rolling_shutter())
      info.views.back().motion = shutter->motion(v);
  }
  return impl_->snapshot(std::move(info));
}

std::string Trainer::rolling_shutter() const {
  const RollingShutter* const shutter = impl_->rolling_shutter();
  return shutter ? shutter->description() : "";
}

std::vector<double> Trainer::readouts() const {
  const RollingShutter* const shutter = impl_->rolling_shutter();
  return shutter ? shutter->readouts() : std::vector<double>();
}

void Trainer::vary(uint64_t salt, double rate_factor) {
  impl_->salt = salt;
  impl_->rate_factor = rate_factor;
}

void Trainer::restart(uint64_t salt, double rate_factor) {
  vary(salt, rate_factor);
  impl_->done = 0;
  impl_->begin_anew();
}

}  // namespace nerf
