#include "run_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "app.h"
#include "chart.h"
#include "html_page.h"
#include "nerf/base/file.h"
#include "nerf/base/progress.h"
#include "nerf/model/options_json.h"
#include "report_assets.h"
#include "report_parts.h"
#include "run_folder.h"
#include "run_json.h"
#include "train_options.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// A folder's own name, or that of the folder it stands for.
std::string run_name(const fs::path& folder) {
  std::error_code ignored;
  const fs::path whole = fs::weakly_canonical(folder, ignored);
  const std::string name = whole.filename().string();
  return name.empty() ? folder.string() : name;
}

std::string list_of(const std::vector<std::string>& lines) {
  std::string text = "<ul class=\"notes\">\n";
  for (const std::string& line : lines) text += "<li>" + xml_escaped(line) + "</li>\n";
  return text + "</ul>\n";
}

std::string lines_of(const std::vector<std::string>& lines) {
  std::string text = "<pre>";
  for (const std::string& line : lines)
    text += LogRecord::is_warning(line)
                ? "<span class=\"warning\">" + xml_escaped(line) + "</span>\n"
                : xml_escaped(line) + "\n";
  return text + "</pre>\n";
}

std::string tiles(const RunRecord& r) {
  std::string text = "<div class=\"tiles\">\n";
  const auto tile = [&](const std::string& value, const std::string& name) {
    if (!value.empty() && value != "–")
      text += "<div class=\"tile\"><b>" + xml_escaped(value) + "</b><span>" + xml_escaped(name) +
              "</span></div>\n";
  };
  const auto number = [&](const char* key) { return number_at(r.result, key); };
  std::optional<double> psnr = number("psnr"), ssim = number("ssim");
  std::string of = "mean of the held-out views";
  if (!psnr && !r.evaluations.empty() && r.evaluations.back().views > 0) {
    psnr = r.evaluations.back().psnr;
    ssim = r.evaluations.back().ssim;
    of = fmt::format("held-out views at step {:.0f}", r.evaluations.back().step);
  }
  tile(figure(psnr, 2, "dB"), "PSNR, " + of);
  tile(figure(ssim, 4), "SSIM, " + of);
  tile(figure(number("aligned_psnr"), 2, "dB"), "PSNR from aligned cameras");
  const auto seconds = number("seconds");
  const double last = r.steps.empty() ? 0 : r.steps.back().step;
  if (seconds)
    tile(format_duration(*seconds), "of training steps");
  else if (!r.steps.empty())
    tile(format_duration(r.steps.back().seconds), "of training steps so far");
  tile(fmt::format("{:.0f}", number("steps").value_or(last)), "steps");
  if (const auto speed = number("samples_per_second")) tile(count_text(*speed) + "/s", "samples");
  if (const auto memory = number("peak_memory_bytes"))
    tile(fmt::format("{:.0f} MB", *memory / (1 << 20)), "most memory in use");
  tile(text_at(r.options, "method"), "method");
  tile(text_at(r.result, "precision"), "precision");
  if (const auto threads = number("threads"))
    tile(fmt::format("{:.0f}, {}", *threads, text_at(r.result, "simd")), "threads, SIMD target");
  if (const auto seed = number("seed")) tile(fmt::format("{:.0f}", *seed), "seed");
  return text + "</div>\n";
}

// "grid.levels" and its value as JSON text.
void flatten(const Json& json, const std::string& name, std::map<std::string, std::string>& values,
             std::vector<std::string>& order) {
  for (const auto& [key, value] : json.items()) {
    const std::string full = name.empty() ? key : name + "." + key;
    if (value.is_object()) {
      flatten(value, full, values, order);
    } else {
      order.push_back(full);
      values[full] = value.dump(-1, ' ', false, Json::error_handler_t::replace);
    }
  }
}

// What the options would be had none been given, as JSON.
Json usual_options(const Json& options) {
  TrainCommand usual;
  try {
    TrainCommand command;
    options_from_json(command, options.dump(), "options.json");
    usual.train = method_options(command.train.method, command.scale);
  } catch (const std::exception&) {
    // Of another version of the program: compared with the default method's.
  }
  return Json::parse(options_to_json(usual));
}

}  // namespace

std::string options_part(const RunRecord& record) {
  std::string text = "<h2 id=\"options\">Command and options</h2>\n";
  const auto command = [&](const char* what, const std::string& line) {
    if (!line.empty())
      text += fmt::format("<p>{}</p>\n<pre class=\"wrap\">", what) + xml_escaped(line) + "</pre>\n";
  };
  command("The command:", record.notes.command);
  command("The same result again:", record.notes.repeat);
  if (record.options.empty()) return text;
  std::map<std::string, std::string> values, usual;
  std::vector<std::string> order, ignored;
  flatten(record.options, "", values, order);
  flatten(usual_options(record.options), "", usual, ignored);
  std::vector<std::vector<std::string>> changed, all;
  for (const std::string& name : order) {
    all.push_back({name, values[name]});
    if (usual[name] != values[name]) changed.push_back({name, values[name], usual[name]});
  }
  text += "<p>Options that are not as usual:</p>\n" +
          html_table({"option", "value", "usual"}, changed, "words");
  return text + fmt::format("<details><summary>All {} options</summary>\n", all.size()) +
         html_table({"option", "value"}, all, "words") + "</details>\n";
}

std::string report_text(const RunRecord& record, ThreadPool& pool) {
  std::vector<std::string> problems = record.missing;
  const std::string views = views_part(record, pool, problems);
  if (record.views.empty())
    problems.push_back("no held-out views were scored: there are none to show");
  const std::string space = space_part(record);
  const RunNotes& notes = record.notes;
  std::string body = tiles(record);
  if (!problems.empty())
    body += "<h2 id=\"missing\">What is missing here</h2>\n" + list_of(problems);
  if (!notes.warnings.empty())
    body += "<h2 id=\"warnings\">Warnings</h2>\n" + list_of(notes.warnings);
  if (!notes.scene.empty()) body += "<h2 id=\"scene\">Scene</h2>\n" + lines_of(notes.scene);
  body += curves_part(record) + views + light_part(record) + medium_part(record) + space +
          time_part(record) + skipped_part(record) + options_part(record);
  if (!notes.printed.empty())
    body += "<details id=\"printed\"><summary>What the training printed</summary>\n" +
            lines_of(notes.printed) + "</details>\n";
  return html_document({"Run " + run_name(record.folder), body, kReportScript});
}

fs::path write_report(const fs::path& run, ThreadPool& pool) {
  const RunRecord record = read_run(run);
  const fs::path file = run / "report.html";
  write_file_atomically(file, report_text(record, pool));
  return file;
}

}  // namespace nerf::apps
