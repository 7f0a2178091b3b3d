#include "nerf/train/light_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "nerf/math/median.h"
#include "nerf/model/field.h"

namespace nerf {

namespace {

void centre_on_median(std::vector<double>& values) {
  const double median = median_of(values);
  for (double& v : values) v -= median;
}

// Of each photo of the books.
std::vector<double> learnt_exposures(const RadianceField& model) {
  const CodeBooks& books = model.field().codes();
  std::vector<double> stops;
  for (int p = 0; books.colours.out > 0 && p < books.rows(); ++p)
    stops.push_back(
        exposure_of_change(appearance_of(books, model.field().all_weights(), p).colours));
  centre_on_median(stops);
  return stops;
}

}  // namespace

std::string corner_text(double stops) {
  constexpr double kNone = 0.05;
  if (std::abs(stops) < kNone) return "corners as bright as the middle";
  return fmt::format("corners {:.1f} stops {} than the middle", std::max(std::abs(stops), 0.1),
                     stops > 0 ? "darker" : "brighter");
}

LightReport light_report(const RadianceField& model, const Scene& scene, const PhotoSet& photos) {
  const CodeBooks& books = model.field().codes();
  const ShownLight shown = shown_light(scene, photos);
  const std::vector<double> learnt = learnt_exposures(model);
  LightReport report;
  report.exif_factor = shown.exif_factor;
  report.exif_explained = shown.exif_explained;
  for (const int v : scene.train) {
    const View& view = scene.views[static_cast<size_t>(v)];
    if (view.scale > 1) continue;  // the same photo again
    LightReport::PhotoLight photo{
        view.name, shown.exposure[static_cast<size_t>(v)], {}, view.exposure};
    const auto known = std::ranges::find(books.photos, view.name);
    if (!learnt.empty() && known != books.photos.end())
      photo.learnt = learnt[static_cast<size_t>(known - books.photos.begin())];
    if (photo.shown || photo.learnt || photo.exif) report.photos.push_back(std::move(photo));
  }
  for (const ShownLight::Lens& lens : shown.lenses) {
    if (lens.photos == 0) continue;
    const bool known = std::ranges::find(books.lenses, lens.name) != books.lenses.end();
    if (known)
      report.lenses.push_back(
          {lens.name, lens.photos,
           corner_stops(falloff_of(books, model.field().all_weights(), lens.name))});
    else if (lens.corner_stops)
      report.lenses.push_back({lens.name, lens.photos, *lens.corner_stops, lens.error});
  }
  std::ranges::stable_sort(report.lenses,
                           [](const auto& a, const auto& b) { return a.photos > b.photos; });
  return report;
}

}  // namespace nerf
