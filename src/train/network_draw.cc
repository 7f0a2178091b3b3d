// Rays of a paper method's step.
#include <algorithm>
#include <optional>

#include "nerf/train/evaluation.h"
#include "train/network_trainer.h"

namespace nerf {

std::optional<Ray> NetworkTrainer::draw_ray(size_t i, Random& random, NetworkRay& out) const {
  const NetworkRecipe& recipe = options.recipe;
  const auto sampled = [&](const Ray& ray) {
    const auto cast = sampled_ray(field, ray);
    if (cast) out = *cast;
    return cast ? std::optional(ray) : std::nullopt;
  };
  if (!given.empty()) {
    const auto cast = sampled(given[i]);
    if (field.options.deform.has_moments())
      out.moment = moments.nearest(static_cast<double>(out.time));
    return cast;
  }
  // Of the photos that are open; all of them are but in a curriculum, which goes by time.
  const size_t open = photos_in_time(recipe, done, source.photos());
  const bool by_time = open < source.photos();
  const auto photo_of = [&](Random& from) {
    const size_t at = static_cast<size_t>(from.below(static_cast<uint64_t>(open)));
    return by_time ? moments.by_time[at] : at;
  };
  Random of_step(seed(), static_cast<uint64_t>(done), random_key(RandomStream::kPhotoOfStep));
  const bool from_one = recipe.one_photo || done < recipe.crop_steps;
  const size_t photo = by_time && !from_one ? photo_of(random) : photo_of(of_step);
  const double share = done < recipe.crop_steps ? recipe.crop : 1;
  PixelSource::Pixel pixel;
  constexpr int kMostTries = 64;  // of pixels that are masked out or have no ray
  bool found = false;
  for (int tries = 0; tries < kMostTries && !found; ++tries)
    found = from_one || by_time ? source.draw_from(photo, random, share, pixel)
                                : source.draw(random, pixel);
  if (!found) return std::nullopt;
  Ray& ray = pixel.ray;
  ray.radius = cast_radius(field, *pixel.camera, *pixel.pose, pixel.centre());
  ray.background = scene.alpha ? background_of(options, scene) : Vec3{0, 0, 0};
  // What is transparent over colours that are never the same twice cannot be painted.
  if (pixel.masked) ray.background = {random.uniform(), random.uniform(), random.uniform()};
  const auto cast = sampled(ray);
  out.scale = pixel.weight;
  out.depth = static_cast<Real>(pixel.distance);
  if (field.options.deform.has_moments()) out.moment = moments.of_photo[pixel.source];
  if (field.options.camera_code > 0) out.camera = moments.camera_of[pixel.source];
  if (!ranges.empty()) {
    const SampleRange& own = ranges[static_cast<size_t>(scene.train[pixel.source])];
    out.near = static_cast<Real>(own.near);
    out.far = static_cast<Real>(own.far);
  }
  for (int k = 0; k < 3; ++k)
    out.target[k] = pixel.rgb[k] * pixel.alpha + ray.background[k] * (1 - pixel.alpha);
  return cast;
}

void NetworkTrainer::draw() {
  constexpr int64_t kBlock = 64;
  constexpr size_t kWatched = 8;  // one of so many rays looks for matter in empty cells
  open_windows();
  source.draw_masked(static_cast<Real>(masked.at(progress_at(done))));
  rays.resize(given.empty() ? static_cast<size_t>(options.recipe.rays) : given.size());
  drawn.resize(rays.size());
  lines.resize(open ? rays.size() : 0);
  const int64_t n = static_cast<int64_t>(rays.size());
  pool.parallel_for((n + kBlock - 1) / kBlock, [&](int64_t block) {
    for (int64_t at = block * kBlock; at < std::min(n, (block + 1) * kBlock); ++at) {
      const size_t i = static_cast<size_t>(at);
      Random random(seed(), static_cast<uint64_t>(done), static_cast<uint64_t>(i));
      NetworkRay cast;
      cast.scale = 1;
      const auto line = draw_ray(i, random, cast);
      drawn[i] = line.has_value();
      rays[i] = line ? cast : NetworkRay{};
      rays[i].random = random;
      rays[i].everywhere = i % kWatched == 0;
      if (open && line) lines[i] = *line;
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

}  // namespace nerf
