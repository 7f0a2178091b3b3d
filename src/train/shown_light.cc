// Notation: sighting k of point j in photo i by lens l has s = P_j + E_i - V_l x, all in stops, x
// being corner_square().
#include "nerf/train/shown_light.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "nerf/math/median.h"
#include "nerf/math/srgb.h"
#include "nerf/math/vignetting.h"
#include "train/lenses.h"
#include "train/sightings.h"

namespace nerf {

namespace {

constexpr size_t kFewestPhotos = 8;
constexpr int kFewestOfPhoto = 20, kFewestOfPoint = 3, kFewestOfLens = 1000;
constexpr int kRounds = 30;
constexpr double kOutlier = 0.25;               // stops: who is off so much counts half
constexpr double kDark = 0.03, kBright = 0.98;  // sRGB values beyond which light is not measured

struct Seen {
  size_t photo, point;  // photo: of the training photos
  int lens;
  double stops, x, weight = 1;
};

// Of linear light over the 3 x 3 pixels around a place; no value in what is black or burnt out.
std::optional<double> stops_at(const Photo& photo, int x, int y) {
  double light = 0;
  int count = 0;
  for (int v = std::max(y - 1, 0); v <= std::min(y + 1, photo.height - 1); ++v)
    for (int u = std::max(x - 1, 0); u <= std::min(x + 1, photo.width - 1); ++u) {
      if (photo.masked_out(u, v)) continue;
      Real rgba[4];
      photo.pixel(u, v, rgba);
      for (int k = 0; k < 3; ++k) {
        const double c = static_cast<double>(rgba[k]);
        if (c > kBright) return {};
        light += srgb_to_linear(c);
        ++count;
      }
    }
  if (count == 0 || light / count < srgb_to_linear(kDark)) return {};
  return std::log2(light / count);
}

std::vector<Seen> all_seen(const Scene& scene, const PhotoSet& photos, const Lenses& lenses) {
  std::vector<Seen> seen;
  std::vector<int> of_point(scene.points.size());
  for (const Sighting& s : sightings_of(scene, photos)) {
    const size_t view = static_cast<size_t>(scene.train[s.source]);
    const auto stops = stops_at(photos.photos[view], s.x, s.y);
    if (!stops) continue;
    ++of_point[static_cast<size_t>(s.point)];
    seen.push_back({s.source, static_cast<size_t>(s.point), lenses.of_view[view], *stops,
                    corner_square(photos.cameras[view], {s.x + 0.5, s.y + 0.5})});
  }
  std::erase_if(seen, [&](const Seen& s) { return of_point[s.point] < kFewestOfPoint; });
  return seen;
}

struct Sums {
  double weight = 0, y = 0, x = 0;
};

struct Fit {
  std::vector<Seen> seen;
  std::vector<double> exposure;            // of training photos
  std::vector<double> point, point_x;      // of points, and their mean x
  std::vector<double> falloff, precision;  // of lenses; precision: sum of weighted squares of x

  void run() {
    for (int round = 0; round < kRounds; ++round) {
      find_points();
      find_falloff();
      find_exposures();
      for (Seen& s : seen) s.weight = 1 / (1 + std::pow(residual(s) / kOutlier, 2));
    }
  }
  double dimmed_by(const Seen& s) const {
    return s.lens < 0 ? 0 : falloff[static_cast<size_t>(s.lens)] * s.x;
  }
  double residual(const Seen& s) const {
    return s.stops - point[s.point] - exposure[s.photo] + dimmed_by(s);
  }
  // Standard error of a lens's falloff. What is off in a photo is off together (a shadow, a
  // reflection), so that photos count as observations, not the sightings in them.
  double error_of(int lens) const {
    std::vector<double> scores(exposure.size());
    for (const Seen& s : seen)
      if (s.lens == lens) scores[s.photo] += s.weight * (s.x - point_x[s.point]) * residual(s);
    double square = 0;
    for (const double score : scores) square += score * score;
    return std::sqrt(square) / precision[static_cast<size_t>(lens)];
  }
  void find_points() {
    std::vector<Sums> sums(point.size());
    for (const Seen& s : seen) {
      Sums& of = sums[s.point];
      of.weight += s.weight;
      of.y += s.weight * (s.stops - exposure[s.photo] + dimmed_by(s));
      of.x += s.weight * s.x;
    }
    for (size_t j = 0; j < sums.size(); ++j)
      if (sums[j].weight > 0) {
        point[j] = sums[j].y / sums[j].weight;
        point_x[j] = sums[j].x / sums[j].weight;
      }
  }
  // By where a point is seen nearer to a corner than usual.
  void find_falloff() {
    std::vector<double> slope(falloff.size());
    std::ranges::fill(precision, 0.0);
    for (const Seen& s : seen) {
      if (s.lens < 0) continue;
      const size_t l = static_cast<size_t>(s.lens);
      const double x = s.x - point_x[s.point];
      slope[l] += s.weight * x * residual(s);
      precision[l] += s.weight * x * x;
    }
    for (size_t l = 0; l < falloff.size(); ++l)
      if (precision[l] > 0) falloff[l] -= slope[l] / precision[l];
  }
  void find_exposures() {
    std::vector<Sums> sums(exposure.size());
    for (const Seen& s : seen) {
      sums[s.photo].weight += s.weight;
      sums[s.photo].y += s.weight * residual(s);
    }
    for (size_t i = 0; i < sums.size(); ++i)
      if (sums[i].weight > 0) exposure[i] += sums[i].y / sums[i].weight;
  }
};

// Least squares of what photos show by what EXIF says.
void compare_with_exif(const Scene& scene, ShownLight& light) {
  constexpr double kLeastSpread = 0.05;  // stops, standard deviation of EXIF's
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  for (size_t v = 0; v < scene.views.size(); ++v) {
    if (!light.exposure[v] || !scene.views[v].exposure) continue;
    const double said = *scene.views[v].exposure, shown = *light.exposure[v];
    n += 1;
    x += said;
    y += shown;
    xx += said * said;
    xy += said * shown;
    yy += shown * shown;
  }
  if (n < static_cast<double>(kFewestPhotos)) return;
  const double of_said = xx / n - x * x / n / n, of_shown = yy / n - y * y / n / n;
  const double both = xy / n - x * y / n / n;
  if (!(of_said > kLeastSpread * kLeastSpread) || !(of_shown > 0)) return;
  light.exif_factor = both / of_said;
  light.exif_explained = both * both / of_said / of_shown;
}

}  // namespace

std::optional<double> ShownLight::trusted_factor() const {
  constexpr double kLeast = 0.25, kMost = 1.6, kExplained = 0.5;
  if (!exif_factor || exif_explained < kExplained || *exif_factor < kLeast || *exif_factor > kMost)
    return {};
  return exif_factor;
}

ShownLight shown_light(const Scene& scene, const PhotoSet& photos) {
  ShownLight light;
  light.exposure.resize(scene.views.size());
  const Lenses lenses = lenses_of(scene);
  for (const std::string& name : lenses.names) light.lenses.push_back({name});
  for (const int v : scene.train)
    if (const int l = lenses.of_view[static_cast<size_t>(v)]; l >= 0)
      ++light.lenses[static_cast<size_t>(l)].photos;
  const std::vector<double> of_points(scene.points.size()), of_lenses(lenses.names.size());
  Fit fit{all_seen(scene, photos, lenses),
          std::vector<double>(scene.train.size()),
          of_points,
          of_points,
          of_lenses,
          of_lenses};
  fit.run();
  std::vector<int> of_photo(scene.train.size()), of_lens(lenses.names.size());
  for (const Seen& s : fit.seen) {
    ++of_photo[s.photo];
    if (s.lens >= 0) ++of_lens[static_cast<size_t>(s.lens)];
  }
  std::vector<double> known;
  for (size_t i = 0; i < of_photo.size(); ++i)
    if (of_photo[i] >= kFewestOfPhoto) known.push_back(fit.exposure[i]);
  if (known.size() < kFewestPhotos) return light;
  const double usual = median_of(known);
  for (size_t i = 0; i < of_photo.size(); ++i)
    if (of_photo[i] >= kFewestOfPhoto)
      light.exposure[static_cast<size_t>(scene.train[i])] = fit.exposure[i] - usual;
  for (size_t l = 0; l < of_lens.size(); ++l) {
    // A lens's error is told by how its photos differ, which a few do not show.
    if (light.lenses[l].photos < static_cast<int>(kFewestPhotos) || of_lens[l] < kFewestOfLens ||
        !(fit.precision[l] > 0))
      continue;
    light.lenses[l].corner_stops = fit.falloff[l];
    light.lenses[l].error = fit.error_of(static_cast<int>(l));
  }
  compare_with_exif(scene, light);
  return light;
}

}  // namespace nerf
