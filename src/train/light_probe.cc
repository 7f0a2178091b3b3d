#include "nerf/train/light_probe.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "nerf/io/photo_scales.h"
#include "nerf/math/ray.h"
#include "nerf/model/integrator.h"

namespace nerf {

namespace {

constexpr size_t kFewestPhotos = 8;
constexpr int kLongestSide = 160;  // pixels of a reduced photo
constexpr int kSteps = 300;
constexpr int kTile = 8, kApart = 2;  // pixels of a reduced photo: of a tile, and between its rays
constexpr size_t kPhotos = 24;        // that the short training's pictures are compared with

std::optional<double> standard_deviation(const std::vector<std::optional<double>>& values) {
  double count = 0, sum = 0, square = 0;
  for (const auto& v : values) {
    if (!v) continue;
    count += 1;
    sum += *v;
    square += *v * *v;
  }
  if (count < 2) return std::nullopt;
  return std::sqrt(std::max(0.0, square / count - sum * sum / count / count));
}

TrainOptions short_training() {
  TrainOptions o;
  o.steps = kSteps;
  o.warmup_steps = 16;
  o.grid.levels = 8;
  o.grid.log2_entries = 16;
  o.grid.finest_resolution = 512;
  o.grid.occupancy_side = 64;
  o.grid_recipe.batch_samples = 1 << 14;
  o.grid_recipe.light.appearance = {false, 0};
  o.grid_recipe.light.colour_correction = Switch::kOff;
  o.grid_recipe.point_depth = 0;
  return o;
}

// Errors of a view's pixels by tiles.
struct Errors {
  double all = 0, smooth = 0;  // squared, of the pixels, and of the tiles' means, times pixels
};

Errors errors_of(const RadianceField& field, const Camera& camera, const Pose& pose,
                 const Photo& photo, ThreadPool& pool) {
  std::vector<Ray> rays;
  std::vector<Real> target;
  std::vector<size_t> tile_end;
  for (int v = 0; v + kTile <= photo.height; v += kTile)
    for (int u = 0; u + kTile <= photo.width; u += kTile) {
      const size_t begin = rays.size();
      for (int y = v + kApart / 2; y < v + kTile; y += kApart)
        for (int x = u + kApart / 2; x < u + kTile; x += kApart) {
          if (photo.masked_out(x, y)) continue;
          const auto ray = camera_ray(camera, pose, {x + 0.5, y + 0.5});
          if (!ray) continue;
          rays.push_back(*ray);
          rays.back().near = field.info().near;
          rays.back().background = {0.5_r, 0.5_r, 0.5_r};
          Real rgba[4];
          photo.pixel(x, y, rgba);
          target.insert(target.end(), rgba, rgba + 3);
        }
      // Of a tile that masks cut, errors may well have a mean.
      if (rays.size() - begin < static_cast<size_t>(kTile * kTile / kApart / kApart)) {
        rays.resize(begin);
        target.resize(3 * begin);
      } else {
        tile_end.push_back(rays.size());
      }
    }
  Errors out;
  if (rays.empty()) return out;
  const RayResults seen = integrate(field, rays, {}, {}, pool);
  size_t i = 0;
  for (const size_t end : tile_end) {
    const double pixels = static_cast<double>(end - i);
    double mean[3] = {};
    for (; i < end; ++i)
      for (size_t k = 0; k < 3; ++k) {
        const double e = static_cast<double>(seen.rgb[3 * i + k] - target[3 * i + k]);
        out.all += e * e;
        mean[k] += e / pixels;
      }
    for (const double e : mean) out.smooth += pixels * e * e;
  }
  return out;
}

std::optional<double> smooth_share(const Scene& given, const PhotoSet& given_photos,
                                   ThreadPool& pool, const Cancel* cancel) {
  const auto moves = [](const View& view) { return view.time != 0; };
  if (!given.unbounded || given.train.size() < kFewestPhotos ||
      std::ranges::any_of(given.views, moves))
    return std::nullopt;
  Scene scene = given;
  scene.test.clear();
  const PhotoSet photos = reduced_photos(scene, given_photos, kLongestSide, pool);
  Trainer trainer(scene, photos, short_training(), pool);
  trainer.run({}, cancel);
  const RadianceField field = trainer.snapshot();
  Errors sum;
  const size_t n = scene.train.size(), take = std::min(n, kPhotos);
  for (size_t i = 0; i < take; ++i) {
    if (cancel && cancel->requested()) throw Cancelled();
    const size_t v = static_cast<size_t>(scene.train[i * n / take]);
    const Errors e = errors_of(field, photos.cameras[v].in_unit(scene.to_engine.scale),
                               scene.to_engine.apply(scene.views[v].pose), photos.photos[v], pool);
    sum.all += e.all;
    sum.smooth += e.smooth;
  }
  if (!(sum.all > 0)) return std::nullopt;
  return sum.smooth / sum.all;
}

// Two decimals, as a person writes an option.
double rounded(double factor) { return std::round(100 * factor) / 100; }

}  // namespace

LightProbe probe_light(const Scene& scene, const PhotoSet& photos, ThreadPool& pool,
                       const Cancel* cancel) {
  LightProbe probe;
  probe.shown = shown_light(scene, photos);
  probe.exposure_spread = standard_deviation(probe.shown.exposure);
  probe.smooth_share = smooth_share(scene, photos, pool, cancel);
  return probe;
}

void resolve_light(const LightProbe& probe, TrainOptions& options) {
  constexpr double kUnlikeDays = 0.5, kUnlikeLight = 0.4;
  constexpr double kUnlikeExposures = 0.2, kLeastSmooth = 0.3;  // together
  constexpr int kAppearance = 16;
  constexpr double kPointDepth = 0.1, kPointDepthLoss = 1;
  const double spread = probe.exposure_spread.value_or(0);
  const double smooth = probe.smooth_share.value_or(0);
  const bool unlike_days = spread > kUnlikeDays;
  const bool unlike = unlike_days || smooth > kUnlikeLight;
  // Points that shine show exposures too, but the short training's error is then of small areas.
  const bool unlike_exposures = unlike_days || (spread > kUnlikeExposures && smooth > kLeastSmooth);
  LightRecipe& light = options.grid_recipe.light;
  if (light.appearance.automatic) light.appearance = {false, unlike ? kAppearance : 0};
  // A share that is left out costs a capture that does not need it: only what is asked for.
  if (light.robust.automatic) light.robust = {false, 0};
  const double exif = probe.shown.trusted_factor().value_or(0);
  if (light.colour_correction == Switch::kAuto)
    light.colour_correction = unlike_exposures ? Switch::kOn : Switch::kOff;
  if (light.exif_exposure.automatic) light.exif_exposure = {false, rounded(exif)};
  // It costs no capture that was measured; those of fixed light stay as they are.
  if (light.vignetting == Switch::kAuto) light.vignetting = light.colour_correction;
  if (!options.grid_recipe.point_depth && unlike_days) {
    options.grid_recipe.point_depth = kPointDepth;
    if (!options.grid_recipe.depth_loss) options.grid_recipe.depth_loss = kPointDepthLoss;
  }
}

}  // namespace nerf
