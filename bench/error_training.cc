// Quality against time of training for several sizes of tables, against the networks' width, and
// with each switch of training set otherwise.
#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "app.h"
#include "child_training.h"
#include "error_bench.h"

namespace nerf::apps {
namespace {

// The work of the last reported step as well: rays, network samples, colours asked for and samples
// whose gradients went back, rows of the tables that Adam moved.
const std::vector<std::string> kWork = {"rays", "samples", "colours", "learning", "rows"};
const std::vector<std::string> kColumns = {
    "seconds",        "steps",  "psnr",    "ssim",    "samples_per_second",
    "peak_memory_mb", "rays",   "samples", "colours", "learning",
    "rows",           "command"};

// A training with options of its own behind those that all share.
ChildTraining train(const ErrorBenchOptions& options, const std::string& name,
                    const std::vector<std::string>& own) {
  std::vector<std::string> arguments = training_arguments(
      options.scene, options.split, options.downscale, options.seed, options.threads);
  arguments.insert(arguments.end(), own.begin(), own.end());
  log_info("training " + name);
  ChildTraining out = train_in_child(std::move(arguments), options.out / "runs" / name);
  if (out.result["psnr"].is_null())
    throw Error("no photo is held out, so that nothing can be measured", options.scene.string(),
                "--split test holds out others than --split dev");
  return out;
}

double number(const ChildTraining& t, const char* name) { return t.result[name].get<double>(); }

// The cells of kColumns.
std::vector<std::string> row_of(std::vector<std::string> lead, const ChildTraining& t) {
  std::vector<std::string> cells = {
      fmt::format("{:.2f}", number(t, "seconds")),
      fmt::format("{:.0f}", number(t, "steps")),
      fmt::format("{:.3f}", number(t, "psnr")),
      t.result["ssim"].is_null() ? "" : fmt::format("{:.4f}", number(t, "ssim")),
      fmt::format("{:.0f}", number(t, "samples_per_second")),
      fmt::format("{:.0f}", number(t, "peak_memory_bytes") / (1 << 20))};
  for (const std::string& name : kWork)
    cells.push_back(t.last_step.is_object() ? t.last_step.value(name, nlohmann::json(0)).dump()
                                            : "");
  cells.push_back(t.command);
  lead.insert(lead.end(), cells.begin(), cells.end());
  return lead;
}

std::vector<std::string> columns(std::vector<std::string> lead) {
  lead.insert(lead.end(), kColumns.begin(), kColumns.end());
  return lead;
}

// Whether two trainings did the same work and ended with the same views.
bool same_training(const ChildTraining& a, const ChildTraining& b) {
  const auto same = [](const nlohmann::json& x, const nlohmann::json& y, const std::string& name) {
    return x.value(name, nlohmann::json()) == y.value(name, nlohmann::json());
  };
  return same(a.result, b.result, "psnr") && same(a.result, b.result, "ssim") &&
         std::ranges::all_of(
             kWork, [&](const std::string& name) { return same(a.last_step, b.last_step, name); });
}

std::string split_text(const ErrorBenchOptions& options) {
  return options.split == SplitChoice::kDev ? "development views" : "test views";
}

}  // namespace

ErrorCurve training_curve(const ErrorBenchOptions& options, std::filesystem::path& last_run) {
  ErrorCurve curve;
  curve.name = "training";
  curve.title = "Training: PSNR against seconds, for each size of the tables and precision";
  curve.text = fmt::format(
      "Mean PSNR of the {} of {}. Every point is a training of its own, planned for its budget; "
      "seconds are those of training steps. A table has 2^N entries of 4 features at each of the "
      "grid's resolutions.",
      split_text(options), options.scene.filename().string());
  curve.table.columns = columns({"log2_entries", "precision", "minutes"});
  Chart chart;
  chart.name = "training";
  chart.title = "PSNR against time of training";
  chart.x = {"seconds of training", true, {}};
  chart.y = {"PSNR, dB", false, {}};
  std::vector<double> budgets = options.minutes_list();
  std::vector<int> tables = options.tables_list();
  std::sort(budgets.begin(), budgets.end());
  std::sort(tables.begin(), tables.end());
  for (const std::string& precision : options.precisions_list())
    for (const int table : tables) {
      ChartSeries series{fmt::format("2^{} entries, {}", table, precision), {}, true};
      for (const double minutes : budgets) {
        const std::string name = fmt::format("table{}_{}_m{}", table, precision, minutes);
        const ChildTraining t = train(options, name,
                                      {"--grid-log2-entries", std::to_string(table), "--precision",
                                       precision, "--minutes", fmt::format("{}", minutes)});
        series.points.push_back({number(t, "seconds"), number(t, "psnr"), ""});
        curve.table.rows.push_back(
            row_of({std::to_string(table), precision, fmt::format("{}", minutes)}, t));
        last_run = options.out / "runs" / name;
      }
      chart.series.push_back(std::move(series));
    }
  curve.charts.push_back(std::move(chart));
  return curve;
}

ErrorCurve width_curve(const ErrorBenchOptions& options) {
  ErrorCurve curve;
  curve.name = "width";
  curve.title = "Networks: PSNR against width at the same number of steps";
  curve.text = fmt::format(
      "Mean PSNR of the {} of {} after {} steps each; the second chart shows what the width "
      "costs.",
      split_text(options), options.scene.filename().string(), options.steps);
  curve.table.columns = columns({"width"});
  Chart against_width, against_time;
  against_width.name = "width";
  against_width.title = fmt::format("PSNR after {} steps against width", options.steps);
  against_width.x = {"width of the hidden layers", true, {}};
  against_time.name = "width_seconds";
  against_time.title = fmt::format("PSNR after {} steps against their time", options.steps);
  against_time.x = {"seconds of training", false, {}};
  against_width.y = against_time.y = {"PSNR, dB", false, {}};
  ChartSeries by_width{fmt::format("{} steps", options.steps), {}, true}, by_time = by_width;
  for (const int width : options.widths_list()) {
    const ChildTraining t =
        train(options, fmt::format("width{}", width),
              {"--grid-hidden", std::to_string(width), "--steps", std::to_string(options.steps)});
    by_width.points.push_back({static_cast<double>(width), number(t, "psnr"), ""});
    by_time.points.push_back(
        {number(t, "seconds"), number(t, "psnr"), fmt::format("width {}", width)});
    against_width.x.ticks.push_back(width);
    curve.table.rows.push_back(row_of({std::to_string(width)}, t));
  }
  against_width.series.push_back(std::move(by_width));
  against_time.series.push_back(std::move(by_time));
  curve.charts = {std::move(against_width), std::move(against_time)};
  return curve;
}

ErrorCurve switches_curve(const ErrorBenchOptions& options) {
  const struct {
    const char* name;
    std::vector<std::string> options;
  } switches[] = {
      {"as it is", {}},
      {"all samples from the start", {"--early-samples", "1"}},
      {"one sample per cell", {"--grid-samples-per-cell", "1"}},
      {"six samples per cell", {"--grid-samples-per-cell", "6"}},
      {"spread samples 0.1", {"--grid-uniform-share", "0.1"}},
      {"distortion 0", {"--distortion", "0"}},
      {"distortion 0.02", {"--distortion", "0.02"}},
      {"16 levels of 2 features", {"--grid-levels", "16", "--grid-features", "2"}},
      {"8 levels", {"--grid-levels", "8"}},
      {"finest cells 1/2048", {"--grid-finest-resolution", "2048"}},
      {"long memory", {"--beta1", "0.9", "--beta2", "0.99"}},
      {"short memory to the end", {"--final-beta1", "0.8", "--final-beta2", "0.95"}},
      {"one hidden colour layer", {"--grid-colour-layers", "1"}},
      {"a colour for each sample", {"--shared-colour", "0"}},
      {"a colour for a quarter of the light", {"--shared-colour", "0.25"}},
      {"every gradient goes back", {"--gradient-roulette", "0"}},
      {"fewer gradients go back", {"--gradient-roulette", "4"}},
      {"cells that no camera sees", {"--keep-unseen"}},
      {"cells outside the visual hull", {"--keep-transparent"}},
      {"hidden samples learn", {"--stop-transmittance", "0"}},
      {"large steps to the end", {"--final-rate", "1"}},
  };
  ErrorCurve curve;
  curve.name = "switches";
  curve.title =
      "Switches of training: PSNR and seconds of the same steps, each alone set otherwise";
  curve.text = fmt::format(
      "Mean PSNR of the {} of {} after {} steps each. The first row has every option as it stands "
      "by default. PSNR comes again to the last digit; seconds hold for the machine as it was.",
      split_text(options), options.scene.filename().string(), options.steps);
  curve.table.columns = columns({"setting"});
  Chart chart;
  chart.name = "switches";
  chart.title = fmt::format("PSNR after {} steps, one switch set otherwise", options.steps);
  chart.x = {"seconds of training", false, {}};
  chart.y = {"PSNR, dB", false, {}};
  int count = 0;
  std::optional<ChildTraining> usual;
  for (const auto& s : switches) {
    // What the others are compared with is always among them.
    if (!s.options.empty() && !options.selected(s.name)) continue;
    std::vector<std::string> own = {"--steps", std::to_string(options.steps)};
    own.insert(own.end(), s.options.begin(), s.options.end());
    const ChildTraining t = train(options, fmt::format("switch{}", count++), own);
    // Some defaults are the scene's.
    if (usual && same_training(t, *usual)) {
      curve.text += fmt::format(" The same as it is: {}.", s.name);
      continue;
    }
    if (s.options.empty()) usual = t;
    // Names would cover each other: numbers stand beside the points, both in the legend.
    const std::string place = std::to_string(chart.series.size() + 1);
    chart.series.push_back(
        {place + ": " + s.name, {{number(t, "seconds"), number(t, "psnr"), place}}, false});
    curve.table.rows.push_back(row_of({s.name}, t));
  }
  curve.charts.push_back(std::move(chart));
  return curve;
}

}  // namespace nerf::apps
