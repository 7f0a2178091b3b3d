// What each part of a paper's method is worth: trainings of the method with one part taken out.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <set>
#include <sstream>

#include "app.h"
#include "bench_commands.h"
#include "child_training.h"
#include "error_report.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/kernels/simd.h"
#include "options_cli.h"
#include "train_options.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

struct AblationOptions {
  fs::path scene;
  fs::path out;
  std::string method = "nerf";
  Scale scale = Scale::kTiny;
  double minutes = 4;
  int64_t steps = 0;
  SplitChoice split = SplitChoice::kDev;
  int downscale = 0;
  uint64_t seed = 1;
  int threads = 0;
  std::string with;
  std::string filter;

  template <class V>
  void visit_options(V& v) {
    v("scene", scene, "capture, as nerf_train takes it", positional(), required(),
      metavar("SCENE"));
    v("out", out, "folder for report.html, ablation.csv, the chart and the runs", short_name('o'),
      required(), metavar("DIR"));
    v("method", method, "whose parts are taken out");
    v("scale", scale, "preset of the method");
    v("minutes", minutes, "length of each training", above(0));
    v("steps", steps, "length in steps instead; 0: --minutes", at_least(0));
    v("split", split, "dev, or test for final figures");
    v("downscale", downscale, "divides the photos' size; 0: as nerf_train does", at_least(0),
      at_most(64));
    v("seed", seed, "of every random number");
    v("threads", threads, "threads; 0 takes all processors", at_least(0), at_most(1024));
    v("with", with,
      "further options of nerf_train for every training, as in --with=\"--network-space ndc\"",
      metavar("OPTIONS"));
    v("filter", filter, "only variants whose name contains this; the whole method always",
      metavar("TEXT"));
  }
  // Throws Error for a training that nerf_train would refuse.
  void check_options() const;

  struct Variant {
    std::string name;
    std::vector<std::string> arguments;
  };
  // The method itself, then one part less each. Throws Error for a method without such parts.
  std::vector<Variant> variants() const;
  std::vector<std::string> arguments(const Variant& variant) const;  // of nerf_train
};

std::vector<AblationOptions::Variant> AblationOptions::variants() const {
  if (!reads_option(method, "network.encoding"))
    throw Error("this method has no parts that can be taken out", "--method",
                "give a paper's method, for example nerf");
  const TrainOptions whole = training_command(arguments({"whole", {}})).train;
  const NetworkOptions& n = whole.network;
  const IntervalOptions& s = n.sampling;
  std::vector<Variant> out{{"whole", {}}};
  const auto add = [&](std::string name, std::vector<std::string> arguments) {
    if (name.find(filter) != name.npos) out.push_back({std::move(name), std::move(arguments)});
  };
  if (n.encoding == Encoding::kFrequency)
    add("without positional encoding", {"--network-position-degrees", "0"});
  else
    add("without integrated encoding",
        {"--network-encoding", "frequency", "--network-cast", "point"});
  if (n.encoding == Encoding::kOffAxis)
    add("without off-axis directions", {"--network-encoding", "integrated"});
  if (s.resampling == Resampling::kProposal)
    add("without proposals",
        {"--network-sampling-resampling", "blurred", "--network-shared",
         "--network-proposal-colour", "--network-sampling-padding", "0.01", "--recipe-interlevel",
         "0", "--recipe-coarse", "0.1", "--no-recipe-anneal"});
  // As many evaluations, all of them even.
  const int all = s.all_samples();
  add("without hierarchical sampling",
      {"--network-sampling-rounds", "0", "--network-sampling-fine", std::to_string(all)});
  add("without view dependence", {"--no-network-view-dependence"});
  if (n.space == Space::kContract) add("without contraction", {"--network-space", "identity"});
  if (whole.recipe.distortion > 0) add("without distortion loss", {"--recipe-distortion", "0"});
  if (s.spacing == Spacing::kUniform && n.space != Space::kNdc)  // even in inverse depth already
    add("with inverse depth", {"--network-sampling-spacing", "inverse"});
  return out;
}

std::vector<std::string> AblationOptions::arguments(const Variant& variant) const {
  std::vector<std::string> out = training_arguments(scene, split, downscale, seed, threads);
  out.insert(out.end(), {"--method", method, "--scale",
                         std::get<std::string>(OptionTraits<Scale>::to_value(scale))});
  if (steps > 0)
    out.insert(out.end(), {"--steps", std::to_string(steps)});
  else
    out.insert(out.end(), {"--minutes", fmt::format("{}", minutes)});
  // The variant's options stand in place of the same ones given for all.
  const std::set<std::string> replaced(variant.arguments.begin(), variant.arguments.end());
  std::istringstream further(with);
  bool left_out = false;
  for (std::string word; further >> word;) {
    if (word.rfind("--", 0) == 0) left_out = replaced.contains(word.substr(0, word.find('=')));
    if (!left_out) out.push_back(word);
  }
  out.insert(out.end(), variant.arguments.begin(), variant.arguments.end());
  return out;
}

void AblationOptions::check_options() const {
  for (const Variant& variant : variants()) training_command(arguments(variant));
}

ErrorCurve measure(const AblationOptions& options) {
  ErrorCurve curve;
  curve.name = "ablation";
  curve.title = fmt::format("What the parts of {} are worth", options.method);
  curve.text = fmt::format(
      "Mean PSNR of the held-out views of {} for {} at scale {} with one part taken out at a time, "
      "and its difference from the whole method.",
      options.scene.filename().string(), options.method,
      std::get<std::string>(OptionTraits<Scale>::to_value(options.scale)));
  curve.table.columns = {"variant", "psnr",  "difference_db",      "ssim",
                         "seconds", "steps", "samples_per_second", "command"};
  Chart chart;
  chart.name = "ablation";
  chart.title = curve.title;
  chart.x = {"difference from the whole method, dB", false, {}};
  chart.y = {"place: what is missed most first", false, {}};
  chart.x_mark = 0;
  ChartSeries series{options.method, {}, false};
  double whole = 0;
  for (const AblationOptions::Variant& variant : options.variants()) {
    log_info("training " + variant.name);
    std::string folder = variant.name;
    std::replace(folder.begin(), folder.end(), ' ', '_');
    const ChildTraining t =
        train_in_child(options.arguments(variant), options.out / "runs" / folder);
    if (t.result["psnr"].is_null())
      throw Error("no photo is held out, so that nothing can be measured", options.scene.string(),
                  "--split test holds out others than --split dev");
    const auto number = [&](const char* name) { return t.result[name].get<double>(); };
    const double psnr = number("psnr"), seconds = number("seconds");
    if (curve.table.rows.empty()) whole = psnr;
    curve.table.rows.push_back(
        {variant.name, fmt::format("{:.3f}", psnr), fmt::format("{:+.3f}", psnr - whole),
         t.result["ssim"].is_null() ? "" : fmt::format("{:.4f}", number("ssim")),
         fmt::format("{:.1f}", seconds), fmt::format("{:.0f}", number("steps")),
         fmt::format("{:.0f}", number("samples_per_second")), t.command});
    series.points.push_back({psnr - whole, 0, variant.name});
    std::printf("%-32s %7.3f dB  %+.3f\n", variant.name.c_str(), psnr, psnr - whole);
    std::fflush(stdout);
  }
  std::sort(series.points.begin(), series.points.end(),
            [](const ChartPoint& a, const ChartPoint& b) { return a.x < b.x; });
  for (size_t i = 0; i < series.points.size(); ++i) {
    series.points[i].y = static_cast<double>(i + 1);
    chart.y.ticks.push_back(series.points[i].y);
  }
  chart.series.push_back(std::move(series));
  curve.charts.push_back(std::move(chart));
  return curve;
}

}  // namespace

int bench_ablation(int argc, char** argv) {
  AblationOptions options;
  const ProgramText text{"nerf_bench ablation",
                         "Trains a paper's method with one part taken out at a time.",
                         "Each row carries the command that gives it again.\n\n"
                         "  nerf_bench ablation photos/lego --method nerf --downscale 4 -o "
                         "runs/ablation"};
  if (parse_command_line(argc, argv, text, options).exit) return kExitOk;
  log_machine("nerf_bench ablation", ThreadPool(options.threads).size(), Precision::kAuto);
  make_writable_folder(options.out);
  const ErrorCurve curve = measure(options);
  write_curve(options.out, curve);
  const std::string about = fmt::format("Measured by {} with {} instructions.",
                                        version_text("nerf_bench"), simd_target());
  write_file_atomically(options.out / "report.html", html_page({curve}, about));
  std::printf("table and chart: %s\n", (options.out / "report.html").string().c_str());
  return kExitOk;
}

}  // namespace nerf::apps
