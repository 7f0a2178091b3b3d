// Quality over time, throughput and rendering of one capture. Every training is a separate run of
// nerf_train with no other option than this table names.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
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
#include "nerf/model/renderer.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/metrics.h"
#include "options_cli.h"

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
  std::string split = "test";
  int threads = 0;
  double scaling_minutes = 0.5;
  int views = 3;

  template <class V>
  void visit_options(V& v) {
    v("scene", scene, "capture, as nerf_train takes it", positional(), required(),
      placeholder("SCENE"));
    v("out", out, "folder for the runs and quality.csv", short_name('o'));
    v("minutes", minutes, "budgets, separated by commas: one row each");
    v("seeds", seeds, "seeds, separated by commas: a row shows the median");
    v("downscale", downscale, "divides the photos' size", at_least(1), at_most(64));
    v("split", split, "test, or dev for tuning");
    v("threads", threads, "threads; 0 takes all processors", at_least(0), at_most(1024));
    v("scaling_minutes", scaling_minutes,
      "length of the two runs that compare 1 thread with all; 0 leaves them out", at_least(0));
    v("views", views, "held-out views rendered with and without skips", at_least(0));
  }
};

std::vector<double> numbers(const std::string& text, const std::string& option) {
  std::vector<double> out;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, ',');) {
    char* end = nullptr;
    const double value = std::strtod(part.c_str(), &end);
    if (part.empty() || *end || !(value > 0))
      throw Error("'" + part + "' is not a number above 0", option, "for example 2,6,15");
    out.push_back(value);
  }
  return out;
}

double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  const size_t n = v.size();
  return n % 2 ? v[n / 2] : 0.5 * (v[n / 2 - 1] + v[n / 2]);
}

class SceneBench {
 public:
  explicit SceneBench(const SceneBenchOptions& o) : options_(o) {}

  int run() {
    make_writable_folder(options_.out);
    std::printf("| minutes | seeds | PSNR dB | SSIM | steps | M samples/s | peak memory MB |\n");
    std::printf("|---|---|---|---|---|---|---|\n");
    for (double minutes : numbers(options_.minutes, "--minutes")) quality_row(minutes);
    write_file_atomically(options_.out / "quality.csv", curve_);
    std::printf("\nquality over time of every run: %s\n",
                (options_.out / "quality.csv").string().c_str());
    if (options_.scaling_minutes > 0) scaling();
    if (options_.views > 0 && !last_run_.empty()) rendering();
    return kExitOk;
  }

 private:
  Json train(const std::string& name, double minutes, int seed, int threads) {
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
                                        options_.split,
                                        "--threads",
                                        std::to_string(threads)};
    if (options_.downscale > 1) {
      command.push_back("--downscale");
      command.push_back(std::to_string(options_.downscale));
    }
    run_process_or_throw(command);
    last_run_ = folder;
    std::istringstream lines(read_text_file(folder / "metrics.jsonl"));
    for (std::string line; std::getline(lines, line);) {
      const Json j = Json::parse(line);
      if (j.value("kind", "") == "evaluation")
        curve_ +=
            fmt::format("{},{},{:.1f},{},{:.3f},{:.4f}\n", name, seed, j["seconds"].get<double>(),
                        j["step"].get<int64_t>(), j["psnr"].get<double>(), j["ssim"].get<double>());
    }
    return Json::parse(read_text_file(folder / "result.json"));
  }

  void quality_row(double minutes) {
    std::vector<double> psnr, ssim, steps, rate, memory;
    for (double seed : numbers(options_.seeds, "--seeds")) {
      const Json r = train(fmt::format("m{}_s{}", minutes, seed), minutes, static_cast<int>(seed),
                           options_.threads);
      psnr.push_back(r["psnr"].is_null() ? 0 : r["psnr"].get<double>());
      ssim.push_back(r["ssim"].is_null() ? 0 : r["ssim"].get<double>());
      steps.push_back(r["steps"].get<double>());
      rate.push_back(r["samples_per_second"].get<double>());
      memory.push_back(r["peak_memory_bytes"].get<double>());
    }
    std::printf("| %g | %zu | %.2f | %.4f | %.0f | %.2f | %.0f |\n", minutes, psnr.size(),
                median(psnr), median(ssim), median(steps), median(rate) * 1e-6,
                median(memory) / (1 << 20));
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

  void rendering() {
    const RadianceField field = RadianceField::load(last_run_ / "model.nerf");
    ThreadPool pool(options_.threads);
    std::vector<double> seconds, all_seconds, alike;
    RenderOptions skip;
    skip.background = evaluation_background(field.info().alpha);
    RenderOptions all = skip;
    all.unclipped = true;
    int done = 0;
    Camera camera;
    for (const ModelView& view : field.info().views) {
      if (!view.held_out || done == options_.views) continue;
      ++done;
      camera = view.camera;
      const auto timed = [&](const RenderOptions& o, std::vector<double>& times) {
        const auto t0 = std::chrono::steady_clock::now();
        Frame f = render(field, view.camera, view.pose, o, pool);
        times.push_back(
            std::chrono::duration<double>(std::chrono::steady_clock::now() - t0).count());
        return to_8bit(ImageF{f.width, f.height, 3, std::move(f.rgb)});
      };
      const Image8 a = timed(skip, seconds), b = timed(all, all_seconds);
      alike.push_back(psnr(a, b).value_or(kHighestPsnr));
    }
    if (done == 0) return;
    std::printf(
        "one %dx%d view: %.2f s; with every skip off %.2f s; least likeness of the two %.1f dB "
        "(%d views)\n",
        camera.width, camera.height, median(seconds), median(all_seconds),
        *std::min_element(alike.begin(), alike.end()), done);
  }

  const SceneBenchOptions& options_;
  std::string curve_ = "run,seed,seconds,step,psnr,ssim\n";
  fs::path last_run_;
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
