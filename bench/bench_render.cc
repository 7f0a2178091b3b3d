// What rendering leaves out, and what that costs a picture.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "app.h"
#include "bench_commands.h"
#include "nerf/base/file.h"
#include "nerf/base/spread.h"
#include "nerf/io/photos.h"
#include "nerf/model/options_json.h"
#include "nerf/model/renderer.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/metrics.h"
#include "options_cli.h"
#include "train_options.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

struct RenderBenchOptions {
  fs::path run;
  int views = 0;
  std::optional<int> downscale;
  int threads = 0;
  bool usual_only = false;

  template <class V>
  void visit_options(V& v) {
    v("run", run, "folder that nerf_train wrote", positional(), required(), metavar("RUN"));
    v("views", views, "held-out views, spread evenly; 0: all", at_least(0));
    v("downscale", downscale, "divides the photos' size; without it as in training", at_least(1),
      at_most(64));
    v("threads", threads, "threads; 0 takes all processors", at_least(0), at_most(1024));
    v("usual_only", usual_only, "no pictures with every skip off, which take many times as long");
  }
};

}  // namespace

Scene held_out_scene(const fs::path& run, int most_views, std::optional<int> downscale) {
  TrainCommand command;
  const fs::path options = run / "options.json";
  options_from_json(command, read_text_file(options), options.string());
  command.downscale = downscale.value_or(command.downscale);
  command.out = run;  // where poses of a folder of photos already are
  Scene scene = load_scene(command.scene, command.scene_options());
  const size_t n = scene.test.size();
  std::vector<View> views;
  for (const size_t i : spread_evenly(n, most_views > 0 ? static_cast<size_t>(most_views) : n))
    views.push_back(scene.views[static_cast<size_t>(scene.test[i])]);
  scene.views = std::move(views);
  return scene;
}

double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  const size_t n = v.size();
  return n % 2 ? v[n / 2] : 0.5 * (v[n / 2 - 1] + v[n / 2]);
}

RenderOptions every_skip_off() {
  RenderOptions o;
  o.skip_nothing();
  o.precision = Precision::kF32;
  return o;
}

std::optional<double> bake(RadianceField& field, ThreadPool& pool) {
  const auto begin = std::chrono::steady_clock::now();
  if (!field.bake(~uint64_t{0} >> 20, pool)) return std::nullopt;
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

void compare_rendering(const fs::path& run, int views, int threads, std::optional<int> downscale,
                       bool usual_only) {
  RadianceField field = RadianceField::load(run / "model.nerf");
  ThreadPool pool(threads);
  const Scene scene = held_out_scene(run, views, downscale);
  if (scene.views.empty()) return;
  const PhotoSet photos = load_photos(scene, pool);
  if (const auto baking = bake(field, pool))
    std::printf("\nempty space found in %.1f s\n", *baking);
  RenderOptions skip;
  skip.background = evaluation_background(field.info());
  RenderOptions all = every_skip_off();
  all.background = skip.background;
  std::vector<double> seconds, all_seconds, psnr_skip, psnr_all;
  double alike = kHighestPsnr, difference = 0;
  for (size_t i = 0; i < scene.views.size(); ++i) {
    const Photo& photo = photos.photos[i];
    const auto timed = [&](RenderOptions o, std::vector<double>& times) {
      o.time = static_cast<Real>(scene.views[i].time);
      const auto t0 = std::chrono::steady_clock::now();
      Frame f = render(field, photos.cameras[i], scene.views[i].pose, o, pool);
      times.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - t0).count());
      return to_8bit(ImageF{f.width, f.height, 3, std::move(f.rgb)});
    };
    const Image8 truth = photo_over(photo, skip.background);
    const Image8 a = timed(skip, seconds);
    const auto with = psnr(truth, a, photo.mask);
    if (!with) continue;  // wholly masked out
    psnr_skip.push_back(*with);
    std::printf("%s: %.2f dB, %.2f s\n", scene.views[i].name.c_str(), *with, seconds.back());
    std::fflush(stdout);
    if (usual_only) continue;
    const Image8 b = timed(all, all_seconds);
    psnr_all.push_back(psnr(truth, b, photo.mask).value_or(*with));
    difference = std::max(difference, std::abs(*with - psnr_all.back()));
    alike = std::min(alike, psnr(a, b, photo.mask).value_or(kHighestPsnr));
  }
  if (psnr_skip.empty()) return;
  std::printf("\nrendering %zu held-out views of %s, %dx%d: median %.2f s", scene.views.size(),
              run.filename().string().c_str(), photos.photos[0].width, photos.photos[0].height,
              median(seconds));
  if (usual_only) {
    std::printf("\nmean PSNR %.3f dB\n", mean(psnr_skip));
    return;
  }
  std::printf(
      "; with every skip off, in f32, %.2f s\n"
      "mean PSNR %.3f dB; with every skip off %.3f dB; largest difference of PSNR of a view %.4f "
      "dB; least likeness of the two pictures %.1f dB\n",
      median(all_seconds), mean(psnr_skip), mean(psnr_all), difference, alike);
}

int bench_render(int argc, char** argv) {
  RenderBenchOptions options;
  const ProgramText text{"nerf_bench render",
                         "Held-out views of a run as usual and with every skip off, in f32.", ""};
  if (parse_command_line(argc, argv, text, options).exit) return kExitOk;
  log_machine("nerf_bench render", ThreadPool(options.threads).size(), Precision::kAuto);
  compare_rendering(options.run, options.views, options.threads, options.downscale,
                    options.usual_only);
  return kExitOk;
}

}  // namespace nerf::apps
