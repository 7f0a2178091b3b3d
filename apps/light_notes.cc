#include "light_notes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace nerf::apps {

namespace {

using Json = nlohmann::ordered_json;
using Photo = LightReport::PhotoLight;

// Standard deviation, and both ends with their photos' names.
std::string spread_text(const LightReport& report, std::optional<double> Photo::* of) {
  const Photo *least = nullptr, *most = nullptr;
  double sum = 0, square = 0, n = 0;
  for (const Photo& photo : report.photos) {
    if (!(photo.*of)) continue;
    const double stops = *(photo.*of);
    if (!least || stops < *(least->*of)) least = &photo;
    if (!most || stops > *(most->*of)) most = &photo;
    sum += stops;
    square += stops * stops;
    n += 1;
  }
  if (n < 2) return "";
  return fmt::format("{:.2f} stops of standard deviation, from {:+.2f} ({}) to {:+.2f} ({})",
                     std::sqrt(std::max(0.0, square / n - sum * sum / n / n)), *(least->*of),
                     least->name, *(most->*of), most->name);
}

// JSON has no numbers that are none.
Json number(const std::optional<double>& x) {
  if (!x || !std::isfinite(*x)) return nullptr;
  return std::round(1000 * *x) / 1000;
}

}  // namespace

std::string exif_text(std::optional<double> factor, double explained) {
  if (!factor) return "";
  return fmt::format(
      "{:.2f} stops are shown for each that EXIF says, which explains {:.0f} % of "
      "the differences",
      *factor, 100 * explained);
}

std::vector<std::string> light_lines(const LightReport& report) {
  constexpr size_t kMostLenses = 3;
  std::vector<std::string> lines;
  if (const std::string text = spread_text(report, &Photo::shown); !text.empty())
    lines.push_back("exposure    shown at sparse points: " + text);
  if (const std::string text = spread_text(report, &Photo::learnt); !text.empty())
    lines.push_back("            colour corrections: " + text);
  if (const std::string text = exif_text(report.exif_factor, report.exif_explained); !text.empty())
    lines.push_back("            " + text);
  for (size_t i = 0; i < std::min(kMostLenses, report.lenses.size()); ++i) {
    const LightReport::LensLight& lens = report.lenses[i];
    lines.push_back(
        fmt::format("{}{}, {} photo{}: {}{}", i == 0 ? "vignetting  " : "            ", lens.name,
                    lens.photos, lens.photos == 1 ? "" : "s", corner_text(lens.corner_stops),
                    lens.error ? fmt::format(" (shown at sparse points, +-{:.2f})", *lens.error)
                               : " (learnt)"));
  }
  if (report.lenses.size() > kMostLenses)
    lines.push_back(
        fmt::format("            and {} lenses more", report.lenses.size() - kMostLenses));
  return lines;
}

nlohmann::ordered_json light_json(const LightReport& report) {
  if (report.empty()) return nullptr;
  Json photos = Json::array(), lenses = Json::array();
  for (const Photo& photo : report.photos)
    photos.push_back({{"name", photo.name},
                      {"shown_stops", number(photo.shown)},
                      {"learnt_stops", number(photo.learnt)},
                      {"exif_stops", number(photo.exif)}});
  for (const LightReport::LensLight& lens : report.lenses)
    lenses.push_back({{"name", lens.name},
                      {"photos", lens.photos},
                      {"corner_stops", number(lens.corner_stops)},
                      {"error", number(lens.error)},
                      {"words", corner_text(lens.corner_stops)}});
  return {{"photos", std::move(photos)},
          {"lenses", std::move(lenses)},
          {"exif_factor", number(report.exif_factor)},
          {"exif_explained", number(report.exif_explained)}};
}

}  // namespace nerf::apps
