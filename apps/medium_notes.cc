#include "medium_notes.h"

#include <fmt/format.h>

#include <cmath>

#include "app.h"
#include "html_page.h"
#include "medium_option.h"
#include "report_parts.h"
#include "run_json.h"

namespace nerf::apps {

namespace {

std::string three(const Vec3d& v) { return fmt::format("{:.4g}, {:.4g}, {:.4g}", v.x, v.y, v.z); }

nlohmann::ordered_json numbers(const Vec3d& v) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (int k = 0; k < 3; ++k) list.push_back(v[k]);
  return list;
}

}  // namespace

std::vector<std::string> medium_lines(const std::optional<Medium>& medium) {
  if (!medium) return {};
  return {fmt::format("medium      attenuation {}, backscatter {} per input unit, colour {}",
                      three(medium->attenuation), three(medium->backscatter),
                      three(medium->colour.cast<double>())),
          "            a clear scene through it: nerf_render RUN --medium " + medium_text(*medium)};
}

nlohmann::ordered_json medium_json(const Medium& medium) {
  return {{"attenuation", numbers(medium.attenuation)},
          {"backscatter", numbers(medium.backscatter)},
          {"colour", numbers(medium.colour.cast<double>())},
          {"option", medium_text(medium)}};
}

std::string medium_part(const RunRecord& record) {
  const auto medium = record.result.find("medium");
  if (medium == record.result.end() || !medium->is_object()) return "";
  std::vector<std::vector<std::string>> rows;
  for (const auto& [key, name] : {std::pair{"attenuation", "attenuation, per input unit"},
                                  {"backscatter", "backscatter, per input unit"},
                                  {"colour", "colour"}}) {
    std::vector<std::string> row{name};
    const auto list = medium->find(key);
    for (size_t k = 0; k < 3; ++k) {
      const bool there =
          list != medium->end() && list->is_array() && k < list->size() && (*list)[k].is_number();
      row.push_back(there ? fmt::format("{:.4g}", (*list)[k].get<double>()) : "–");
    }
    rows.push_back(std::move(row));
  }
  const std::string text = "<h2 id=\"medium\">What the photos were taken through</h2>\n" +
                           html_table({"", "red", "green", "blue"}, rows);
  const std::string option = text_at(*medium, "option");
  if (option.empty()) return text;
  const std::vector<std::string> row{"--medium " + shell_quoted(option)};
  return text + "<p>A clear scene is seen through it with:</p>\n" +
         html_table({"nerf_render"}, {row}, "words");
}

}  // namespace nerf::apps
