// Curves of cost against error, to choose options by: quadrature of media of known light, training
// time against PSNR, what rendering leaves out, the networks' width, the switches of training.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdio>

#include "app.h"
#include "bench_commands.h"
#include "error_bench.h"
#include "lists.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/nearest_name.h"
#include "nerf/kernels/bf16.h"
#include "nerf/kernels/simd.h"
#include "options_cli.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

std::vector<int> integers(const std::string& list, uint64_t low, uint64_t high,
                          const std::string& flag, const std::string& example) {
  const auto values = whole_numbers(list, low, high, flag, example);
  return {values.begin(), values.end()};
}

void add(std::vector<ErrorCurve>& curves, ErrorCurve curve, const ErrorBenchOptions& options) {
  write_curve(options.out, curve);
  std::printf("%s: %zu rows in %s\n", curve.name.c_str(), curve.table.rows.size(),
              (options.out / (curve.name + ".csv")).string().c_str());
  std::fflush(stdout);
  curves.push_back(std::move(curve));
}

}  // namespace

bool ErrorBenchOptions::wants(const std::string& curve) const {
  const std::vector<std::string> parts = parts_of(curves);
  return std::find(parts.begin(), parts.end(), curve) != parts.end();
}

std::vector<int> ErrorBenchOptions::samples_list() const {
  const std::vector<int> list = integers(samples, 2, 1 << 20, "--samples", "8,16,32");
  for (const int n : list)
    if (n % 2 != 0)
      throw Error(fmt::format("{} is odd", n), "--samples",
                  "hierarchical sampling spends half of the evaluations on each pass");
  return list;
}

std::string ErrorBenchOptions::out_again() const {
  return shell_quoted((out.has_filename() ? out : out.parent_path()).string() + "_again");
}

std::vector<double> ErrorBenchOptions::minutes_list() const {
  return positive_numbers(minutes, "--minutes", "0.5,1,2");
}

std::vector<int> ErrorBenchOptions::tables_list() const {
  return integers(tables, 10, 24, "--tables", "15,17,19");
}

std::vector<int> ErrorBenchOptions::widths_list() const {
  return integers(widths, 16, 1024, "--widths", "16,32,64");
}

std::vector<std::string> ErrorBenchOptions::precisions_list() const {
  if (precisions == "auto") {
    if (bf16_unit() == Bf16Unit::kNone) return {"f32"};
    return {"f32", "bf16"};
  }
  const std::vector<std::string> list = parts_of(precisions);
  for (const std::string& p : list) {
    if (p != "f32" && p != "bf16")
      throw Error("unknown precision '" + p + "'", "--precisions", "give f32, bf16 or f32,bf16");
    if (p == "bf16") resolve_precision(Precision::kBf16);  // refuses where there is no unit
  }
  return list;
}

void ErrorBenchOptions::check_options() const {
  const std::vector<std::string> known = {"quadrature", "training", "skips", "width", "switches"};
  for (const std::string& part : parts_of(curves))
    if (std::find(known.begin(), known.end(), part) == known.end())
      throw Error("unknown curve '" + part + "'", "--curves", nearest_name_hint(part, known));
  samples_list();
  minutes_list();
  tables_list();
  widths_list();
  precisions_list();
  for (const char* curve : {"training", "width", "switches"})
    if (wants(curve) && scene.empty())
      throw Error(fmt::format("the curve '{}' needs a capture", curve), "--curves",
                  "give SCENE, or --curves quadrature");
  if (wants("skips") && run.empty() && !wants("training"))
    throw Error("the curve 'skips' needs a trained run", "--curves",
                "give --run RUN, or the curve 'training' with SCENE");
  if (wants("skips") && !run.empty() && !fs::exists(run / "model.nerf"))
    throw Error("no model.nerf is there", run.string(),
                "give the folder of a finished nerf_train as --run");
}

int bench_error(int argc, char** argv) {
  ErrorBenchOptions options;
  const ProgramText text{"nerf_bench error",
                         "Curves of cost against error, as CSV, SVG and one HTML page.",
                         "Every row carries the command that gives it again.\n\n"
                         "  nerf_bench error --curves quadrature -o runs/error\n"
                         "  nerf_bench error data/demo --downscale 2 -o runs/error\n"
                         "  nerf_bench error --curves skips --run runs/demo -o runs/error"};
  if (parse_command_line(argc, argv, text, options).exit) return kExitOk;
  // Whatever pictures lack shows before hours of training.
  if (options.wants("skips") && !options.run.empty()) skips_scene(options, options.run);
  ThreadPool pool(options.threads);
  log_machine("nerf_bench error", pool.size(), Precision::kAuto);
  make_writable_folder(options.out);

  std::vector<ErrorCurve> curves;
  if (options.wants("quadrature")) add(curves, quadrature_curve(options, pool), options);
  fs::path run = options.run, last_run;
  if (options.wants("training")) add(curves, training_curve(options, last_run), options);
  if (run.empty()) run = last_run;
  if (options.wants("skips")) add(curves, skips_curve(options, run, pool), options);
  if (options.wants("width")) add(curves, width_curve(options), options);
  if (options.wants("switches")) add(curves, switches_curve(options), options);

  const fs::path page = options.out / "report.html";
  const std::string about = fmt::format(
      "Measured by {} with {} instructions and {} thread{}. Times hold for this machine and what "
      "else ran on it.",
      version_text("nerf_bench"), simd_target(), pool.size(), pool.size() == 1 ? "" : "s");
  write_file_atomically(page, html_page(curves, about));
  std::printf("all curves: %s\n", page.string().c_str());
  return kExitOk;
}

}  // namespace nerf::apps
