#include "nerf/train/light_probe.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "nerf/io/photo_scales.h"
#include "nerf/math/ray.h"
#include "nerf/model/integrator.h"
#include "train/skyline.h"

namespace nerf {

namespace {

constexpr size_t kFewestPhotos = 8;
constexpr int kLongestSide = 160;  // pixels of a reduced photo
constexpr int kSteps = 300;
constexpr int kTile = 8, kApart = 2;  // pixels of a reduced photo: of a tile, and between its rays
constexpr size_t kPhotos = 24;        // that the short training's pictures are compared with
constexpr double kRobust = 0.3;       // of the short training

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
  // What passes by would look like light that differs.
  o.grid_recipe.light.robust = {false, kRobust};
  o.pixel_recipe.point_depth = 0;
  return o;
}

// Squared errors of pixels, and of their tiles' means, times pixels.
struct Errors {
  double all = 0, smooth = 0;

  // errors: [pixel of the tile][3].
  void add(std::span<const double> errors) {
    const double pixels = static_cast<double>(errors.size() / 3);
    for (size_t k = 0; k < 3; ++k) {
      double mean = 0;
      for (size_t i = k; i < errors.size(); i += 3) {
        all += errors[i] * errors[i];
        mean += errors[i] / pixels;
      }
      smooth += pixels * mean * mean;
    }
  }
  std::optional<double> smooth_share() const {
    if (!(all > 0)) return std::nullopt;
    return smooth / all;
  }
};

struct ErrorSums {
  Errors everywhere, elsewhere;  // elsewhere: in tiles of which no pixel was left out
};

// Adds the errors of a view's pixels. left_out: 0 where a pixel was.
void add_errors(const RadianceField& field, const Camera& camera, const Pose& pose,
                const Photo& photo, const Image8& left_out, ThreadPool& pool, ErrorSums& sums) {
  struct Tile {
    size_t end;  // of its rays
    bool whole;
  };
  std::vector<Ray> rays;
  std::vector<Real> target;
  std::vector<Tile> tiles;
  for (int v = 0; v + kTile <= photo.height; v += kTile)
    for (int u = 0; u + kTile <= photo.width; u += kTile) {
      const size_t begin = rays.size();
      bool whole = true;
      for (int y = v + kApart / 2; y < v + kTile; y += kApart)
        for (int x = u + kApart / 2; x < u + kTile; x += kApart) {
          if (photo.masked_out(x, y)) continue;
          const auto ray = camera_ray(camera, pose, {x + 0.5, y + 0.5});
          if (!ray) continue;
          whole &= left_out.pixels[static_cast<size_t>(y) * static_cast<size_t>(left_out.width) +
                                   static_cast<size_t>(x)] != 0;
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
        tiles.push_back({rays.size(), whole});
      }
    }
  if (rays.empty()) return;
  const RayResults seen = integrate(field, rays, {}, {}, pool);
  std::vector<double> errors(target.size());
  for (size_t i = 0; i < errors.size(); ++i)
    errors[i] = static_cast<double>(seen.rgb[i] - target[i]);
  size_t begin = 0;
  for (const Tile& tile : tiles) {
    const auto of_tile = std::span(errors).subspan(3 * begin, 3 * (tile.end - begin));
    sums.everywhere.add(of_tile);
    if (tile.whole) sums.elsewhere.add(of_tile);
    begin = tile.end;
  }
}

double share_of_black(const std::vector<Trainer::LeftOut>& photos) {
  double black = 0, all = 0;
  for (const Trainer::LeftOut& photo : photos) {
    const std::vector<uint8_t>& pixels = photo.picture.pixels;
    black += static_cast<double>(std::ranges::count(pixels, uint8_t{0}));
    all += static_cast<double>(pixels.size());
  }
  return black / std::max(all, 1.0);
}

void train_shortly(const Scene& given, const PhotoSet& given_photos, ThreadPool& pool,
                   const Cancel* cancel, LightProbe& probe) {
  const auto moves = [](const View& view) { return view.time != 0; };
  if (!given.unbounded || given.train.size() < kFewestPhotos ||
      std::ranges::any_of(given.views, moves))
    return;
  Scene scene = given;
  scene.test.clear();
  const PhotoSet photos = reduced_photos(scene, given_photos, kLongestSide, pool);
  Trainer trainer(scene, photos, short_training(), pool);
  trainer.run({}, cancel);
  const RadianceField field = trainer.snapshot();
  const std::vector<Trainer::LeftOut> left_out = trainer.left_out();
  ErrorSums sums;
  const size_t n = scene.train.size(), take = std::min(n, kPhotos);
  for (size_t i = 0; i < take; ++i) {
    if (cancel && cancel->requested()) throw Cancelled();
    const size_t at = i * n / take, v = static_cast<size_t>(scene.train[at]);
    add_errors(field, photos.cameras[v].in_unit(scene.to_engine.scale),
               scene.to_engine.apply(scene.views[v].pose), photos.photos[v], left_out[at].picture,
               pool, sums);
  }
  probe.smooth_share = sums.everywhere.smooth_share();
  probe.smooth_elsewhere = sums.elsewhere.smooth_share();
  probe.passing_share = share_of_black(left_out);
}

// Two decimals, as a person writes an option.
double rounded(double factor) { return std::round(100 * factor) / 100; }

}  // namespace

// The short training leaves out at most 8 % of a capture that nothing passed by (where a shadow
// walks, which tells of light; others 5 %), 10 % where things cover 5 % of the pixels, and 24 %
// where they cover 20 %.
bool LightProbe::passes() const {
  constexpr double kPassing = 0.09;
  return passing_share.value_or(0) > kPassing;
}

LightProbe probe_light(const Scene& scene, const PhotoSet& photos, ThreadPool& pool,
                       const Cancel* cancel) {
  LightProbe probe;
  probe.shown = shown_light(scene, photos);
  probe.exposure_spread = standard_deviation(probe.shown.exposure);
  if (scene.unbounded && !scene.alpha && !masks_cut_out(photos))
    probe.above_points = share_above_points(scene, photos).value_or(0);
  train_shortly(scene, photos, pool, cancel, probe);
  return probe;
}

void resolve_light(const LightProbe& probe, TrainOptions& options) {
  constexpr double kUnlikeDays = 0.5, kUnlikeLight = 0.4;
  constexpr double kUnlikeExposures = 0.2, kLeastSmooth = 0.3;  // together
  constexpr int kAppearance = 16;
  constexpr double kPointDepth = 0.1, kPointDepthLoss = 1;
  constexpr double kSky = 0.25;
  const double spread = probe.exposure_spread.value_or(0);
  const double elsewhere = probe.smooth_elsewhere.value_or(0);
  const bool unlike_days = spread > kUnlikeDays;
  const bool unlike = unlike_days || probe.smooth_by_light().value_or(0) > kUnlikeLight;
  // Points that shine show exposures too, but the short training's error is then of small areas.
  const bool unlike_exposures =
      unlike_days || (spread > kUnlikeExposures && elsewhere > kLeastSmooth);
  LightRecipe& light = options.grid_recipe.light;
  if (light.appearance.automatic) light.appearance = {false, unlike ? kAppearance : 0};
  if (light.robust.automatic) {
    const double share = probe.passes() ? rounded(*probe.passing_share) : 0;
    light.robust = {false, std::min(share, ShareLimit::kMost)};
  }
  const double exif = probe.shown.trusted_factor().value_or(0);
  if (light.colour_correction == Switch::kAuto)
    light.colour_correction = unlike_exposures ? Switch::kOn : Switch::kOff;
  if (light.exif_exposure.automatic) light.exif_exposure = {false, rounded(exif)};
  // It costs no capture that was measured; those of fixed light stay as they are.
  if (light.vignetting == Switch::kAuto) light.vignetting = light.colour_correction;
  // `liberty` without its masks has 0.55, seven others, the demo among them, 0.00 to 0.18.
  if (light.sky == Switch::kAuto)
    light.sky = unlike_days && probe.above_points > kSky ? Switch::kOn : Switch::kOff;
  if (!options.pixel_recipe.point_depth && unlike_days) {
    options.pixel_recipe.point_depth = kPointDepth;
    if (!options.pixel_recipe.depth_loss) options.pixel_recipe.depth_loss = kPointDepthLoss;
  }
}

}  // namespace nerf
