// Curves over steps, timing, memory, and what was left out.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "chart.h"
#include "html_page.h"
#include "nerf/base/progress.h"
#include "report_parts.h"
#include "run_json.h"

namespace nerf::apps {
namespace {

using Json = nlohmann::ordered_json;

constexpr size_t kMostCurvePoints = 240;  // of a curve

// Means of successive steps where there are more than a chart can show.
ChartSeries series_of(const std::string& name, const std::vector<MetricsStep>& steps,
                      double (*value)(const MetricsStep&)) {
  ChartSeries s{name, {}, true, false};
  const size_t group = (steps.size() + kMostCurvePoints - 1) / kMostCurvePoints;
  for (size_t i = 0; i < steps.size(); i += group) {
    const size_t n = std::min(group, steps.size() - i);
    ChartPoint mean{};
    for (size_t k = i; k < i + n; ++k) {
      mean.x += steps[k].step / static_cast<double>(n);
      mean.y += value(steps[k]) / static_cast<double>(n);
    }
    s.points.push_back(mean);
  }
  // One point makes no line.
  s.markers = s.points.size() == 1;
  return s;
}

Chart chart(const std::string& title, const std::string& y, bool log,
            std::vector<ChartSeries> series) {
  std::erase_if(series, [](const ChartSeries& s) {
    return std::ranges::none_of(s.points, [](const ChartPoint& p) { return p.y != 0; });
  });
  return {"", title, {"step", false, {}}, {y, log, {}}, std::move(series), {}, ""};
}

// Mean of a count over the reported steps.
double mean(const std::vector<MetricsStep>& steps, double MetricsStep::* count) {
  double sum = 0;
  for (const MetricsStep& s : steps) sum += s.*count;
  return steps.empty() ? 0 : sum / static_cast<double>(steps.size());
}

double grid_option(const RunRecord& record, const char* name) {
  const auto grid = record.options.find("grid");
  return grid == record.options.end() ? 0 : number_at(*grid, name).value_or(0);
}

std::string bar_row(const std::string& stage, double seconds, double most) {
  return fmt::format(
      "<tr><td>{}</td><td>{:.1f} s</td><td><div style=\"width:{:.1f}%\"></div></td></tr>\n",
      xml_escaped(stage), seconds, most > 0 ? std::clamp(100 * seconds / most, 0.0, 100.0) : 0);
}

}  // namespace

std::string figure(std::optional<double> value, int decimals, const std::string& unit) {
  if (!value || !std::isfinite(*value)) return "–";
  return fmt::format("{:.{}f}{}{}", *value, decimals, unit.empty() ? "" : " ", unit);
}

std::string count_text(double count) {
  if (!std::isfinite(count)) return "–";
  if (std::abs(count) >= 1e9) return fmt::format("{:.2f} G", count / 1e9);
  if (std::abs(count) >= 1e6) return fmt::format("{:.1f} M", count / 1e6);
  if (std::abs(count) >= 1e4) return fmt::format("{:.1f} k", count / 1e3);
  return fmt::format("{:.4g}", count);
}

std::string curves_part(const RunRecord& record) {
  const std::vector<MetricsStep>& steps = record.steps;
  if (steps.empty() && record.evaluations.empty()) return "";
  const auto of = [&](const char* name, double (*value)(const MetricsStep&)) {
    return series_of(name, steps, value);
  };
  ChartSeries held_out{"held-out views", {}, true, true};
  for (const MetricsEvaluation& e : record.evaluations)
    if (e.views > 0) held_out.points.push_back({e.step, e.psnr, ""});
  std::string text = "<h2 id=\"curves\">Curves</h2>\n<div class=\"charts\">\n";
  const std::vector<Chart> charts = {
      chart("Loss", "loss of a step", true,
            {of("training", [](const MetricsStep& s) { return s.loss; })}),
      chart("PSNR", "PSNR (dB)", false,
            {of("training rays", [](const MetricsStep& s) { return s.psnr; }), held_out}),
      chart("Samples", "of a step", true,
            {of("samples", [](const MetricsStep& s) { return s.samples; }),
             of("colours", [](const MetricsStep& s) { return s.colours; }),
             of("learning samples", [](const MetricsStep& s) { return s.learning; }),
             of("rays", [](const MetricsStep& s) { return s.rays; })}),
      chart("Speed", "samples (millions a second)", false,
            {of("samples", [](const MetricsStep& s) { return s.samples_per_second / 1e6; })})};
  for (const Chart& c : charts) text += "<div class=\"chart\">" + svg_text(c) + "</div>\n";
  text += "</div>\n<p class=\"quiet\">From metrics.jsonl";
  if (steps.size() > kMostCurvePoints)
    text += fmt::format(": {} lines, each point the mean of {}", steps.size(),
                        (steps.size() + kMostCurvePoints - 1) / kMostCurvePoints);
  return text + ". The training's PSNR is estimated from the rays of a step.</p>\n";
}

std::string time_part(const RunRecord& record) {
  const Json& result = record.result;
  const auto training = number_at(result, "seconds");
  if (!training) return "";
  std::vector<std::pair<std::string, double>> stages;
  const auto add = [&](const char* name, const Json& json, const char* key) {
    if (const auto seconds = number_at(json, key)) stages.emplace_back(name, *seconds);
  };
  add("decoding photos", result, "decode_seconds");
  add("training steps", result, "seconds");
  const size_t first = stages.size();
  if (const auto profile = result.find("profile"); profile != result.end()) {
    add("  rays and their samples", *profile, "rays");
    add("  lookups and encodings", *profile, "encode");
    add("  networks, forward and backward", *profile, "network");
    add("  tables' gradients and rows", *profile, "scatter");
    add("  networks' update", *profile, "update");
    add("  occupancy", *profile, "occupancy");
  }
  const bool profiled = stages.size() > first;
  add("evaluations", result, "evaluation_seconds");
  add("saving", result, "saving_seconds");
  double most = 0;
  for (const auto& [name, seconds] : stages) most = std::max(most, seconds);
  std::string text =
      "<h2 id=\"time\">Time and memory</h2>\n<div class=\"table\"><table class=\"bars\">\n";
  for (const auto& [name, seconds] : stages) {
    const size_t indent = name.find_first_not_of(' ');
    text += bar_row((indent > 0 ? "↳ " : "") + name.substr(indent), seconds, most);
  }
  text += "</table></div>\n<p class=\"quiet\">Seconds of wall clock";
  text += profiled ? "; stages of the steps (↳) are those of the program's last run.</p>\n"
                   : "; this run did not record the stages of its steps.</p>\n";
  if (const auto bytes = number_at(result, "peak_memory_bytes"))
    text +=
        fmt::format("<p>Most memory in use: {:.0f} MB (resident set).</p>\n", *bytes / (1 << 20));
  return text;
}

std::string skipped_part(const RunRecord& record) {
  const std::vector<MetricsStep>& steps = record.steps;
  const double samples = mean(steps, &MetricsStep::samples), rays = mean(steps, &MetricsStep::rays);
  if (!(samples > 0) || !(rays > 0)) return "";
  const double last =
      std::max_element(steps.begin(), steps.end(), [](const auto& a, const auto& b) {
        return a.step < b.step;
      })->step;
  const double total = number_at(record.result, "samples").value_or(samples * last);
  std::vector<std::vector<std::string>> rows;
  const auto row = [&](const std::string& what, const std::string& done, double share,
                       const std::string& saved) {
    rows.push_back({what, done, fmt::format("{:.1f} %", 100 * share), saved});
  };
  const bool grid = text_at(record.options, "method") == "grid";
  const double most = grid ? grid_option(record, "max_samples") : 0;
  if (most > 0 && samples / rays < most)
    row("Samples where space is empty or hidden",
        fmt::format("{:.1f} samples a ray of at most {:.0f}", samples / rays, most),
        1 - samples / rays / most,
        count_text(total * (most * rays / samples - 1)) + " network samples");
  const double colours = mean(steps, &MetricsStep::colours);
  if (colours > 0)
    row("Colours of samples that share one",
        "a colour for each of " + fmt::format("{:.2f} samples", samples / colours),
        1 - colours / samples, count_text(total * (1 - colours / samples)) + " colour evaluations");
  const double learning = mean(steps, &MetricsStep::learning);
  if (learning > 0)
    row("Samples that learn nothing",
        fmt::format("{:.1f} % of samples went back", 100 * learning / samples),
        1 - learning / samples,
        count_text(total * (1 - learning / samples)) + " backward passes and scatters");
  const double moved = mean(steps, &MetricsStep::rows);
  const double table = grid ? grid_option(record, "levels") *
                                  std::exp2(std::min(grid_option(record, "log2_entries"), 60.0))
                            : 0;
  if (moved > 0 && table > moved)
    row("Rows of the tables without a gradient",
        fmt::format("{} of at most {} rows moved in a step", count_text(moved), count_text(table)),
        1 - moved / table, count_text((table - moved) * last) + " updates of rows");
  std::string text = "<h2 id=\"skipped\">What was left out, and what it saved</h2>\n";
  if (rows.empty())
    return text + "<p>The method " + xml_escaped(text_at(record.options, "method")) +
           " counts samples alone: " + count_text(total) + ", " +
           fmt::format("{:.1f} a ray.</p>\n", samples / rays);
  return text +
         html_table({"left out", "done", "left out", "saved in the whole run"}, rows, "words") +
         "<p class=\"quiet\">Means over the " + std::to_string(steps.size()) +
         " steps that metrics.jsonl reports, times the run's " + count_text(total) +
         " samples and " + count_text(last) + " steps.</p>\n";
}

}  // namespace nerf::apps
