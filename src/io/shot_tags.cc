#include "shot_tags.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "colmap.h"
#include "nerf/math/median.h"

namespace nerf::internal {

namespace {

// A number that is there, nonsense too.
std::optional<double> number_of(const OIIO::ImageSpec& spec, const char* name) {
  const OIIO::ParamValue* value = spec.find_attribute(name);
  if (!value || value->type().basevalues() != 1 || value->type().basetype == OIIO::TypeDesc::STRING)
    return {};
  return static_cast<double>(value->get_float());
}

struct Quantity {
  const char* name;
  double least, most;
};
// From the electronic shutter's shortest to a night's exposure; lenses; sensors.
constexpr Quantity kSeconds{"an exposure time of {:g} s", 1e-6, 3600};
constexpr Quantity kAperture{"an aperture of f/{:g}", 0.5, 128};
constexpr Quantity kSensitivity{"a sensitivity of ISO {:g}", 1, 1e7};

// 0 where it is none.
double sane(const Quantity& q, std::optional<double> said, std::string& nonsense) {
  if (!said) return 0;
  if (*said >= q.least && *said <= q.most) return *said;
  if (nonsense.empty()) nonsense = fmt::format(fmt::runtime(q.name), *said);
  return 0;
}

std::string camera_text(const OIIO::ImageSpec& spec) {
  const auto text = [&](const char* name) {
    std::string s{spec.get_string_attribute(name)};
    while (!s.empty() && (s.back() == ' ' || s.back() == '\0')) s.pop_back();
    return s;
  };
  const std::string make = text("Make"), model = text("Model");
  // Some models begin with their maker's name.
  std::string all = model.starts_with(make) || make.empty() ? model
                    : model.empty()                         ? make
                                                            : make + " " + model;
  if (all.empty()) return all;
  const std::string lens = text("Exif:LensModel");
  if (!lens.empty()) all += ", " + lens;
  const float focal = spec.get_float_attribute("Exif:FocalLength");
  if (focal > 0 && std::isfinite(focal)) all += fmt::format(", {:g} mm", focal);
  return printable(all);
}

}  // namespace

ShotTags shot_tags(const OIIO::ImageSpec& spec) {
  constexpr double kMoreThanFits = 65535;  // EXIF 2.3: 16 bits are too few, see another tag
  ShotTags tags;
  tags.camera = camera_text(spec);
  const auto powers = [&](const char* name, double factor) -> std::optional<double> {
    const auto apex = number_of(spec, name);
    if (!apex) return {};
    return std::exp2(factor * *apex);
  };
  tags.seconds = sane(kSeconds, number_of(spec, "ExposureTime"), tags.nonsense);
  if (tags.seconds == 0)
    tags.seconds = sane(kSeconds, powers("Exif:ShutterSpeedValue", -1), tags.nonsense);
  tags.aperture = sane(kAperture, number_of(spec, "FNumber"), tags.nonsense);
  if (tags.aperture == 0)
    tags.aperture = sane(kAperture, powers("Exif:ApertureValue", 0.5), tags.nonsense);
  auto iso = number_of(spec, "Exif:PhotographicSensitivity");
  if (!iso) iso = number_of(spec, "Exif:ISOSpeedRatings");
  if (iso && *iso >= kMoreThanFits) {
    iso = number_of(spec, "Exif:RecommendedExposureIndex");
    if (!iso) iso = number_of(spec, "Exif:ISOSpeed");
  }
  tags.sensitivity = sane(kSensitivity, iso, tags.nonsense);
  return tags;
}

void find_exposures(const std::vector<ShotTags>& tags, std::vector<View>& views,
                    SceneReport& report) {
  const bool has_aperture = std::ranges::any_of(tags, [](auto& t) { return t.aperture > 0; });
  const bool has_sensitivity = std::ranges::any_of(tags, [](auto& t) { return t.sensitivity > 0; });
  std::vector<double> known;
  int nonsense = 0;
  std::string first;
  for (size_t i = 0; i < views.size(); ++i) {
    const ShotTags& t = tags[i];
    views[i].lens = t.camera;
    views[i].exposure.reset();
    if (!t.nonsense.empty() && nonsense++ == 0)
      first = fmt::format("{} says {}", printable(views[i].name), t.nonsense);
    // What no photo of the capture names does not differ between them, as far as is known.
    if (t.seconds == 0 || (has_aperture && t.aperture == 0) ||
        (has_sensitivity && t.sensitivity == 0))
      continue;
    double stops = std::log2(t.seconds);
    if (has_aperture) stops -= 2 * std::log2(t.aperture);
    if (has_sensitivity) stops += std::log2(t.sensitivity);
    views[i].exposure = stops;
    known.push_back(stops);
  }
  if (nonsense > 0)
    report.notes.push_back(
        fmt::format("EXIF of {} of {} photos says of their exposure what cannot be, which is not "
                    "used: {}",
                    nonsense, views.size(), first));
  if (known.empty()) return;
  const double usual = median_of(known);
  for (View& view : views)
    if (view.exposure) *view.exposure -= usual;
  const auto [least, most] = std::ranges::minmax_element(known);
  report.exposure = fmt::format("EXIF of {} of {} photos, which differ by {:.1f} stops",
                                known.size(), views.size(), *most - *least);
}

}  // namespace nerf::internal
