// Quality over time and throughput of one capture. Every training is a separate run of
// nerf_train with no other option than this table names.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "app.h"
#include "bench_commands.h"
#include "child_training.h"
#include "lists.h"
#include "nerf/base/file.h"
#include "options_cli.h"
#include "train_options.h"

namespace nerf::apps {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

struct SceneBenchOptions {
  fs::path scene;
  fs::path out = "runs/bench";
  std::string minutes = "2,6,15";
  std::string seeds = "1,2,3";
  int downscale = 0;
  SplitChoice split = SplitChoice::kTest;
  int threads = 0;
  double scaling_minutes = 0.5;
  int views = 0;

  template <class V>
  void visit_options(V& v) {
    v("scene", scene, "capture, as nerf_train takes it", positional(), required(),
      metavar("SCENE"));
    v("out", out, "folder for the runs and quality.csv", short_name('o'));
    v("minutes", minutes, "budgets, separated by commas: one row each");
    v("seeds", seeds, "seeds, separated by commas: a row shows the median");
    v("downscale", downscale, "divides the photos' size; 0: as nerf_train does", at_least(0),
      at_most(64));
    v("split", split, "test, or dev for tuning");
    v("threads", threads, "threads; 0 takes all processors", at_least(0), at_most(1024));
    v("scaling_minutes", scaling_minutes,
      "length of the two runs that compare 1 thread with all; 0 leaves them out", at_least(0));
    v("views", views, "held-out views rendered with and without skips, spread evenly; 0: all",
      at_least(0));
  }
  // Throws Error for lists that cannot be read.
  void check_options() const {
    minutes_list();
    seeds_list();
  }
  std::vector<double> minutes_list() const {
    return positive_numbers(minutes, "--minutes", "2,6,15");
  }
  std::vector<uint64_t> seeds_list() const {
    return whole_numbers(seeds, 0, std::numeric_limits<uint64_t>::max(), "--seeds", "1,2,3");
  }
};

class SceneBench {
 public:
  explicit SceneBench(const SceneBenchOptions& o) : options_(o) {}

  int run() {
    make_writable_folder(options_.out);
    std::printf(
        "| minutes | seeds | PSNR dB | SSIM | steps | M samples/s | training s | decoding s | "
        "evaluation s | peak memory MB |\n");
    std::printf("|---|---|---|---|---|---|---|---|---|---|\n");
    const std::vector<double> budgets = options_.minutes_list();
    for (const double minutes : budgets) quality_row(minutes);
    write_file_atomically(options_.out / "quality.csv", curve_);
    std::printf("\nquality over time of every run: %s\n",
                (options_.out / "quality.csv").string().c_str());
    if (options_.scaling_minutes > 0) scaling();
    compare_rendering(options_.out / quality_run(*std::max_element(budgets.begin(), budgets.end()),
                                                 options_.seeds_list().front()),
                      options_.views, options_.threads);
    return kExitOk;
  }

 private:
  static std::string quality_run(double minutes, uint64_t seed) {
    return fmt::format("m{}_s{}", minutes, seed);
  }

  Json train(const std::string& name, double minutes, uint64_t seed, int threads) {
    std::vector<std::string> arguments = {options_.scene.string(),
                                          "--minutes",
                                          fmt::format("{}", minutes),
                                          "--seed",
                                          std::to_string(seed),
                                          "--split",
                                          split_name(),
                                          "--threads",
                                          std::to_string(threads)};
    if (options_.downscale > 0)
      arguments.insert(arguments.end(), {"--downscale", std::to_string(options_.downscale)});
    const ChildTraining child = train_in_child(std::move(arguments), options_.out / name);
    for (const Json& j : child.evaluations)
      curve_ +=
          fmt::format("{},{},{:.1f},{},{:.3f},{:.4f},{}\n", name, seed, j["seconds"].get<double>(),
                      j["step"].get<int64_t>(), j["psnr"].get<double>(), j["ssim"].get<double>(),
                      j["views"].get<int>());
    return child.result;
  }

  void quality_row(double minutes) {
    const std::vector<uint64_t> seeds = options_.seeds_list();
    std::vector<Json> results;
    for (const uint64_t seed : seeds)
      results.push_back(train(quality_run(minutes, seed), minutes, seed, options_.threads));
    const auto median_of = [&](const char* name) {
      std::vector<double> values;
      for (const Json& r : results) values.push_back(r[name].is_null() ? 0 : r[name].get<double>());
      return median(values);
    };
    std::printf("| %g | %zu | %.2f | %.4f | %.0f | %.2f | %.1f | %.1f | %.1f | %.0f |\n", minutes,
                seeds.size(), median_of("psnr"), median_of("ssim"), median_of("steps"),
                median_of("samples_per_second") * 1e-6, median_of("seconds"),
                median_of("decode_seconds"), median_of("evaluation_seconds"),
                median_of("peak_memory_bytes") / (1 << 20));
    std::fflush(stdout);
  }

  void scaling() {
    const int all = options_.threads > 0 ? options_.threads : available_processors();
    const double one = train("threads_1", options_.scaling_minutes, 1, 1)["samples_per_second"];
    const double many =
        train("threads_all", options_.scaling_minutes, 1, all)["samples_per_second"];
    std::printf("\nthreads 1 -> %d: %.2f -> %.2f M samples/s, %.2fx\n", all, one * 1e-6,
                many * 1e-6, many / one);
  }

  std::string split_name() const { return options_.split == SplitChoice::kDev ? "dev" : "test"; }

  const SceneBenchOptions& options_;
  std::string curve_ = "run,seed,seconds,step,psnr,ssim,views\n";
};

}  // namespace

int bench_scene(int argc, char** argv) {
  SceneBenchOptions options;
  const ProgramText text{"nerf_bench scene",
                         "Quality over training time, throughput and rendering of one capture.",
                         "The clock is that of training steps; evaluation and decoding are not in "
                         "it."};
  if (parse_command_line(argc, argv, text, options).exit) return kExitOk;
  ThreadPool pool(options.threads);
  log_machine("nerf_bench scene", pool.size(), Precision::kAuto);
  return SceneBench(options).run();
}

}  // namespace nerf::apps
