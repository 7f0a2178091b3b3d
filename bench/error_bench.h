// The curves of nerf_bench error and what they are measured with.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "error_report.h"
#include "nerf/base/options.h"
#include "nerf/base/threads.h"
#include "nerf/io/scene.h"
#include "train_options.h"

namespace nerf::apps {

struct ErrorBenchOptions {
  std::filesystem::path scene;
  std::filesystem::path out;
  std::string curves = "quadrature,training,skips,width,switches";
  std::filesystem::path run;
  std::string samples = "4,8,16,32,64,128,256,512,1024";
  int rays = 2000;
  std::string minutes = "0.5,1,2";
  std::string tables = "15,17,19";
  std::string precisions = "auto";
  std::string widths = "16,32,64,128";
  int64_t steps = 1000;
  SplitChoice split = SplitChoice::kDev;
  int downscale = 0;
  int views = 4;
  int repeats = 3;
  uint64_t seed = 1;
  int threads = 0;
  std::string filter;

  template <class V>
  void visit_options(V& v) {
    v("scene", scene, "capture, as nerf_train takes it; training, width and switches need one",
      positional(), metavar("SCENE"));
    v("out", out, "folder for report.html, the curves as CSV and SVG, and the runs",
      short_name('o'), required(), metavar("DIR"));
    v("curves", curves,
      "which ones: quadrature, training, skips, width, switches, separated by commas");
    v("run", run, "folder that nerf_train wrote, for skips; without it the last run of training",
      metavar("RUN"));
    v("samples", samples, "quadrature: evaluations per ray, even, separated by commas");
    v("rays", rays, "quadrature: random rays per point", at_least(1), at_most(10000000));
    v("minutes", minutes, "training: budgets, separated by commas, each a training of its own");
    v("tables", tables, "training: log2_entries of the tables, separated by commas");
    v("precisions", precisions,
      "training: f32, bf16 or both, separated by commas; auto: f32, and bf16 where the processor "
      "has it");
    v("widths", widths, "width: widths of the networks, separated by commas");
    v("steps", steps, "width and switches: steps of each training", at_least(1));
    v("split", split, "training, width and switches: dev, or test for final figures");
    v("downscale", downscale,
      "training, width and switches: divides the photos' size; 0: as nerf_train does", at_least(0),
      at_most(64));
    v("views", views, "skips: held-out views, spread evenly; 0: all", at_least(0));
    v("repeats", repeats, "skips: renderings of each view, whose median time counts", at_least(1));
    v("seed", seed, "of every random number but skips', which draw none");
    v("threads", threads, "threads; 0 takes all processors", at_least(0), at_most(1024));
    v("filter", filter,
      "quadrature, skips and switches: only rows whose name contains this; =NAME: the one of that "
      "name",
      metavar("TEXT"));
  }
  // Throws Error for lists that cannot be read and for curves that lack what they need.
  void check_options() const;

  bool wants(const std::string& curve) const;
  bool selected(const std::string& name) const {
    if (filter.starts_with('=')) return name == filter.substr(1);
    return name.find(filter) != std::string::npos;
  }
  std::vector<int> samples_list() const;
  // For the commands of rows, as a shell reads it: the report's folder keeps what it has.
  std::string out_again() const;
  std::vector<double> minutes_list() const;
  std::vector<int> tables_list() const;
  std::vector<int> widths_list() const;
  std::vector<std::string> precisions_list() const;
};

// RMS error against evaluations per ray, for media of known light.
ErrorCurve quadrature_curve(const ErrorBenchOptions& options, ThreadPool& pool);

// Held-out PSNR against seconds of training, for each size of tables and precision. `last_run` gets
// the folder of the largest tables' longest training.
ErrorCurve training_curve(const ErrorBenchOptions& options, std::filesystem::path& last_run);

// The capture of a run with the held-out views alone that skips_curve() renders. Throws Error where
// there are none.
Scene skips_scene(const ErrorBenchOptions& options, const std::filesystem::path& run);

// Seconds of a picture against its difference from the picture with every skip off, for each
// switch of RenderOptions alone and for all together, on the held-out views of a run. A setting
// that does the same work and shows the same pictures as one before it is named in the text
// instead.
ErrorCurve skips_curve(const ErrorBenchOptions& options, const std::filesystem::path& run,
                       ThreadPool& pool);

// Held-out PSNR against the networks' width at the same number of steps.
ErrorCurve width_curve(const ErrorBenchOptions& options);

// Held-out PSNR after the same steps with each switch of training alone set otherwise.
ErrorCurve switches_curve(const ErrorBenchOptions& options);

}  // namespace nerf::apps
