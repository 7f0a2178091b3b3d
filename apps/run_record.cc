#include "run_record.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <sstream>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/model/radiance_field.h"
#include "run_json.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

bool is_there(const fs::path& path) {
  std::error_code ignored;
  return fs::exists(path, ignored);
}

// Reads one file of the run; where that fails, says so in record.missing.
template <class Read>
void read_part(RunRecord& record, const char* file, const char* lacking, Read read) {
  const fs::path path = record.folder / file;
  if (!is_there(path)) {
    record.missing.push_back(fmt::format("{} is missing: {}", file, lacking));
    return;
  }
  try {
    read(path);
  } catch (const Error& error) {
    record.missing.push_back(
        fmt::format("{} cannot be read ({}): {}", file, error.what(), lacking));
  }
}

RecordedView view_of(const Json& json) {
  RecordedView v;
  v.name = text_at(json, "name");
  v.scale = static_cast<int>(std::clamp(number_at(json, "scale").value_or(1), 1.0, 1e6));
  v.psnr = number_at(json, "psnr");
  v.ssim = number_at(json, "ssim");
  v.aligned_psnr = number_at(json, "aligned_psnr");
  v.aligned_ssim = number_at(json, "aligned_ssim");
  v.held_out = text_at(json, "held_out");
  v.picture = text_at(json, "picture");
  if (v.picture.find('/') != std::string::npos) v.picture.clear();  // a file of another folder
  const auto depth = json.find("depth");
  if (depth != json.end() && depth->is_array() && depth->size() == 2 && (*depth)[0].is_number() &&
      (*depth)[1].is_number())
    v.depth = {(*depth)[0].get<double>(), (*depth)[1].get<double>()};
  return v;
}

std::vector<RecordedView> views_of(const Json& json, const char* key) {
  std::vector<RecordedView> views;
  if (!json.is_object() || !json.contains(key) || !json[key].is_array()) return views;
  for (const Json& view : json[key])
    if (view.is_object()) views.push_back(view_of(view));
  return views;
}

void read_metrics(RunRecord& record, const fs::path& path) {
  std::istringstream lines(read_text_file(path));
  int unreadable = 0;
  for (std::string line; std::getline(lines, line);) {
    const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
    const std::string kind = text_at(json, "kind");
    const auto number = [&](const char* key) { return number_at(json, key).value_or(0); };
    if (kind == "step") {
      record.steps.push_back({number("step"), number("seconds"), number("loss"), number("psnr"),
                              number("rays"), number("samples"), number("colours"),
                              number("learning"), number("rows"), number("samples_per_second")});
    } else if (kind == "evaluation") {
      record.evaluations.push_back(
          {number("step"), number("seconds"), number("psnr"), number("ssim"), number("views")});
      record.views = views_of(json, "per_view");  // the last one's stay
    } else {
      ++unreadable;
    }
  }
  if (unreadable > 0)
    record.missing.push_back(fmt::format("metrics.jsonl: {} line{} cannot be read and {} left out",
                                         unreadable, unreadable == 1 ? "" : "s",
                                         unreadable == 1 ? "is" : "are"));
}

std::set<std::string> pictures_in(const fs::path& folder) {
  std::set<std::string> names;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (entry.path().extension() == ".png") names.insert(entry.path().filename().string());
  return names;
}

// Views get the pictures that there are: those of their scores, or of runs that did not say, by
// name. Pictures of a run that was stopped before it scored any stand by themselves.
void find_pictures(RunRecord& record) {
  const std::set<std::string> files = pictures_in(record.folder / "eval");
  if (record.views.empty()) {
    for (const std::string& file : files) {
      record.views.emplace_back().name = fs::path(file).stem().string();
      record.views.back().picture = file;
    }
    return;
  }
  size_t without = 0;
  for (RecordedView& view : record.views) {
    std::string stem = fs::path(view.name).replace_extension().string();
    std::replace(stem.begin(), stem.end(), '/', '_');
    if (view.picture.empty() && view.scale == 1) view.picture = stem + ".png";
    if (!files.contains(view.picture)) view.picture.clear();
    without += view.picture.empty();
  }
  if (without > 0)
    record.missing.push_back(fmt::format("eval/ has no picture of {} of {} held-out views", without,
                                         record.views.size()));
}

}  // namespace

RunRecord read_run(const fs::path& folder) {
  std::error_code ignored;
  if (!is_there(folder))
    throw Error("no such folder", folder.string(), "give the folder that nerf_train wrote");
  if (!fs::is_directory(folder, ignored))
    throw Error("is a file, not the folder of a run", folder.string(),
                "give the folder that nerf_train wrote");
  RunRecord record;
  record.folder = folder;
  record.options = record.result = Json::object();
  if (!is_there(folder / "options.json") && !is_there(folder / "result.json") &&
      !is_there(folder / "metrics.jsonl"))
    throw Error("holds no run: options.json, metrics.jsonl and result.json are missing",
                folder.string(), "give the folder that nerf_train wrote");
  read_part(record, "options.json", "the options are not shown",
            [&](const fs::path& path) { record.options = json_of_file(path); });
  read_part(record, "notes.json",
            "what the training said of the scene, its warnings, its points and its command are not "
            "shown",
            [&](const fs::path& path) { record.notes = read_notes(path); });
  read_part(record, "metrics.jsonl", "there are no curves",
            [&](const fs::path& path) { read_metrics(record, path); });
  read_part(record, "result.json",
            "the training has not come to its end; scores are of the last evaluation before",
            [&](const fs::path& path) { record.result = json_of_file(path); });
  if (auto views = views_of(record.result, "views"); !views.empty())
    record.views = std::move(views);
  read_part(record, "model.nerf", "cameras are not shown",
            [&](const fs::path& path) { record.model = RadianceField::load(path).info(); });
  find_pictures(record);
  return record;
}

}  // namespace nerf::apps
