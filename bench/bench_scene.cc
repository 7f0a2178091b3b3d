// Quality over time and throughput of one capture. Every training is a separate run of
// nerf_train with no other option than this table names.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "app.h"
#include "bench_commands.h"
#include "nerf/base/file.h"
#include "nerf/base/process.h"
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
  int downscale = 1;
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
    v("downscale", downscale, "divides the photos' size", at_least(1), at_most(64));
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
  std::vector<double> minutes_list() const;
  std::vector<uint64_t> seeds_list() const;
};

std::vector<std::string> parts_of(const std::string& list) {
  std::vector<std::string> parts(1);
  for (const char c : list) {
    if (c == ',')
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

std::vector<double> SceneBenchOptions::minutes_list() const {
  std::vector<double> out;
  for (const std::string& part : parts_of(minutes)) {
    char* end = nullptr;
    const double value = std::strtod(part.c_str(), &end);
    if (part.empty() || *end || !(value > 0) || !std::isfinite(value))
      throw Error("'" + part + "' is not a number above 0", "--minutes", "for example 2,6,15");
    out.push_back(value);
  }
  return out;
}

std::vector<uint64_t> SceneBenchOptions::seeds_list() const {
  std::vector<uint64_t> out;
  for (const std::string& part : parts_of(seeds)) {
    uint64_t value = 0;
    const char* end = part.data() + part.size();
    const auto [stop, code] = std::from_chars(part.data(), end, value);
    if (code != std::errc() || stop != end)
      throw Error("'" + part + "' is not a whole number from 0", "--seeds", "for example 1,2,3");
    out.push_back(value);
  }
  return out;
}

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
    const fs::path folder = options_.out / name;
    const fs::path self = fs::read_symlink("/proc/self/exe").parent_path() / "nerf_train";
    const std::string program = fs::exists(self) ? self.string() : "nerf_train";
    std::vector<std::string> command = {program,
                                        options_.scene.string(),
                                        "-o",
                                        folder.string(),
                                        "--overwrite",
                                        "--minutes",
                                        fmt::format("{}", minutes),
                                        "--seed",
                                        std::to_string(seed),
                                        "--split",
                                        split_name(),
                                        "--threads",
                                        std::to_string(threads)};
    if (options_.downscale > 1) {
      command.push_back("--downscale");
      command.push_back(std::to_string(options_.downscale));
    }
    run_process_or_throw(command);
    std::istringstream lines(read_text_file(folder / "metrics.jsonl"));
    for (std::string line; std::getline(lines, line);) {
      const Json j = Json::parse(line);
      if (j.value("kind", "") == "evaluation")
        curve_ +=
            fmt::format("{},{},{:.1f},{},{:.3f},{:.4f},{}\n", name, seed,
                        j["seconds"].get<double>(), j["step"].get<int64_t>(),
                        j["psnr"].get<double>(), j["ssim"].get<double>(), j["views"].get<int>());
    }
    return Json::parse(read_text_file(folder / "result.json"));
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
  log_machine("nerf_bench scene", pool.size(), "f32");
  return SceneBench(options).run();
}

}  // namespace nerf::apps
