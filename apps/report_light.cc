// How photos were exposed, and what their lenses do, as the result of a run has it.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "html_page.h"
#include "light_notes.h"
#include "report_parts.h"
#include "run_json.h"

namespace nerf::apps {
namespace {

using Json = nlohmann::ordered_json;

std::string stops(const Json& json, const char* key) {
  const auto x = number_at(json, key);
  return x ? fmt::format("{:+.2f}", *x) : "–";
}

// The objects of a list.
std::vector<Json> objects(const Json& json, const char* key) {
  std::vector<Json> out;
  if (json.contains(key) && json[key].is_array())
    for (const Json& item : json[key])
      if (item.is_object()) out.push_back(item);
  return out;
}

}  // namespace

std::string light_part(const RunRecord& record) {
  const auto light = record.result.find("light");
  if (light == record.result.end() || !light->is_object()) return "";
  std::string text = "<h2 id=\"light\">Light in the photos</h2>\n";
  std::vector<std::vector<std::string>> rows;
  for (const Json& lens : objects(*light, "lenses")) {
    const auto error = number_at(lens, "error");
    rows.push_back({text_at(lens, "name"),
                    fmt::format("{:.0f}", number_at(lens, "photos").value_or(0)),
                    text_at(lens, "words"), stops(lens, "corner_stops"),
                    error ? fmt::format("sparse points, ±{:.2f}", *error) : "learnt"});
  }
  if (!rows.empty())
    text += html_table({"lens", "photos", "vignetting", "stops", "by"}, rows, "words");
  std::vector<Json> photos = objects(*light, "photos");
  // The most unusual first.
  const auto odd = [](const Json& photo) {
    const auto shown = number_at(photo, "shown_stops"), learnt = number_at(photo, "learnt_stops");
    return -std::abs(shown.value_or(learnt.value_or(0)));
  };
  std::ranges::stable_sort(photos, {}, odd);
  if (photos.empty()) return text;
  rows.clear();
  for (const Json& photo : photos)
    rows.push_back({text_at(photo, "name"), stops(photo, "shown_stops"),
                    stops(photo, "learnt_stops"), stops(photo, "exif_stops")});
  text +=
      "<p>How much brighter than the middle one of them each photo is, in stops of linear light "
      "(+1: twice the light): as it shows sparse points, as its colour correction was learnt, and "
      "as its EXIF says that it was exposed.";
  const std::string exif =
      exif_text(number_at(*light, "exif_factor"), number_at(*light, "exif_explained").value_or(0));
  if (!exif.empty()) text += " " + exif + ".";
  return text +
         fmt::format("</p>\n<details><summary>Exposures of {} photos</summary>\n", rows.size()) +
         html_table({"photo", "shown", "learnt", "EXIF"}, rows) + "</details>\n";
}

}  // namespace nerf::apps
