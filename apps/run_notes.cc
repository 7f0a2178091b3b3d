#include "run_notes.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "app.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/spread.h"
#include "nerf/base/text.h"
#include "run_json.h"

namespace nerf::apps {
namespace {

using Json = nlohmann::ordered_json;

std::vector<std::string> texts(const Json& json, const char* key) {
  std::vector<std::string> out;
  if (!json.contains(key) || !json[key].is_array()) return out;
  for (const Json& line : json[key])
    if (line.is_string()) out.push_back(line.get<std::string>());
  return out;
}

}  // namespace

RunNotes notes_of(const Scene& scene) {
  RunNotes notes;
  std::string line;
  for (const char c : format_report(scene.report)) {
    if (c != '\n') {
      line += c;
      continue;
    }
    notes.scene.push_back(std::move(line));
    line.clear();
  }
  notes.warnings = scene.report.warnings;
  notes.points_total = static_cast<int64_t>(scene.points.size());
  for (const size_t i : spread_evenly(scene.points.size(), kMostPoints))
    notes.points.push_back(scene.to_engine.apply(scene.points[i].position) / scene.to_engine.scale);
  return notes;
}

std::string command_text(int argc, const char* const* argv) {
  std::string line;
  for (int i = 0; i < argc; ++i) {
    if (i > 0) line += ' ';
    line += shell_quoted(i > 0 ? argv[i] : std::filesystem::path(argv[i]).filename().string());
  }
  return line;
}

double shortened_number(double value, double extent) {
  if (!(extent > 0) || !std::isfinite(extent) || !std::isfinite(value)) return value;
  const int places = 4 - static_cast<int>(std::floor(std::log10(extent)));
  const double power = std::pow(10, std::min(std::abs(places), 300));
  return places >= 0 ? std::round(value * power) / power : std::round(value / power) * power;
}

void write_notes(const std::filesystem::path& path, const RunNotes& notes) {
  // Most points lie near the middle; few far ones must not take the near ones' places.
  std::vector<double> sizes;
  for (const Vec3d& p : notes.points) sizes.push_back(std::sqrt(dot(p, p)));
  std::sort(sizes.begin(), sizes.end());
  const double extent = sizes.empty() ? 1 : sizes[sizes.size() / 2];
  Json points = Json::array();
  for (const Vec3d& p : notes.points)
    for (int k = 0; k < 3; ++k) points.push_back(shortened_number(p[k], extent));
  const Json json = {{"command", notes.command},   {"repeat", notes.repeat},
                     {"scene", notes.scene},       {"warnings", notes.warnings},
                     {"printed", notes.printed},   {"points_total", notes.points_total},
                     {"points", std::move(points)}};
  write_file_atomically(path, json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

RunNotes read_notes(const std::filesystem::path& path) {
  const Json json = json_of_file(path);
  RunNotes notes;
  notes.command = text_at(json, "command");
  notes.repeat = text_at(json, "repeat");
  notes.scene = texts(json, "scene");
  notes.warnings = texts(json, "warnings");
  notes.printed = texts(json, "printed");
  notes.points_total = static_cast<int64_t>(number_at(json, "points_total").value_or(0));
  if (json.contains("points") && json["points"].is_array()) {
    const Json& p = json["points"];
    for (size_t i = 0; i + 2 < p.size() && notes.points.size() < kMostPoints; i += 3)
      if (p[i].is_number() && p[i + 1].is_number() && p[i + 2].is_number())
        notes.points.push_back(
            {p[i].get<double>(), p[i + 1].get<double>(), p[i + 2].get<double>()});
  }
  return notes;
}

}  // namespace nerf::apps
