// What each thing that rendering leaves out saves, and what it costs the picture.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>

#include "app.h"
#include "bench_commands.h"
#include "error_bench.h"
#include "nerf/io/photos.h"
#include "nerf/kernels/bf16.h"
#include "nerf/math/random.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/metrics.h"

namespace nerf::apps {
namespace {

struct Setting {
  std::string series, name, label;
  RenderOptions options;
  // Empty cells are sampled like the others. Minutes a picture, so that only the first view is.
  bool empty_cells = false;
};

// In falling order, the value among them that rendering has where nothing is said.
std::vector<Real> with_usual(std::vector<Real> values, Real usual) {
  if (std::ranges::find(values, usual) == values.end()) values.push_back(usual);
  std::ranges::sort(values, std::greater<>());
  return values;
}

// Each switch alone, and all together. The cache's stop and the number of samples exist only where
// samples follow the cache, so they are compared with that alone.
std::vector<Setting> settings(bool cached) {
  const RenderOptions off = every_skip_off(), usual;
  std::vector<Setting> all = {{"every skip off", "every skip off", "", off}};
  if (cached) all.push_back({"empty cells too", "every skip off, empty cells too", "", off, true});
  const auto if_cached = [&](std::vector<int> values) {
    return cached ? values : std::vector<int>();
  };
  for (const int share : if_cached({1024, 256, 64})) {
    RenderOptions o = off;
    o.unshaded = 1.0_r / static_cast<Real>(share);
    const std::string text = fmt::format("unshaded 1/{}", share);
    all.push_back({"unshaded light", text, fmt::format("1/{}", share), o});
  }
  for (const int share : if_cached({64, 32, 16, 8, 4})) {
    RenderOptions o = off;
    o.shared_colour = 1.0_r / static_cast<Real>(share);
    const std::string text = fmt::format("shared colour 1/{}", share);
    all.push_back({"shared colour", text, fmt::format("1/{}", share), o});
  }
  for (const int power : if_cached({6, 4, 3, 2})) {
    RenderOptions o = off;
    o.stop_transmittance = static_cast<Real>(std::pow(10, -power));
    const std::string text = fmt::format("network's stop 1e-{}", power);
    all.push_back({"network's stop", text, fmt::format("1e-{}", power), o});
  }
  if (bf16_unit() != Bf16Unit::kNone) {
    RenderOptions o = off;
    o.precision = Precision::kBf16;
    all.push_back({"bf16", "bf16", "", o});
  }
  RenderOptions cache = off;
  cache.unclipped = false;
  cache.sample_factor = usual.sample_factor;
  // The paper methods' samples follow their proposals, not the cache: it only says what is empty.
  if (!cached) {
    all.push_back({"cache", "cache", "", cache});
    all.push_back({"together", "together", "default", usual});
    return all;
  }
  for (const Real factor : with_usual({4, 2, 1.5_r, 1.25_r, 1, 0.5_r}, usual.sample_factor)) {
    RenderOptions o = cache;
    o.sample_factor = factor;
    all.push_back({"cache alone, factor", fmt::format("cache, factor {}", factor),
                   fmt::format("{}", factor), o});
  }
  for (const int power : {6, 4, 3}) {
    RenderOptions o = cache;
    o.min_transmittance = static_cast<Real>(std::pow(10, -power));
    all.push_back({"cache and its stop", fmt::format("cache, stop 1e-{}", power),
                   fmt::format("1e-{}", power), o});
  }
  for (const Real factor : with_usual({2, 1.5_r, 1.25_r, 1, 0.75_r, 0.5_r}, usual.sample_factor)) {
    RenderOptions o;
    o.sample_factor = factor;
    const bool is_usual = factor == usual.sample_factor;
    all.push_back({"together, factor", fmt::format("together, factor {}", factor),
                   is_usual ? fmt::format("default, {}", factor) : fmt::format("{}", factor), o});
  }
  for (const int most : {32, 64, 192}) {
    RenderOptions o;
    o.max_samples = most;
    all.push_back({"together, at most", fmt::format("together, at most {}", most),
                   fmt::format("{}", most), o});
  }
  for (const int halves : {1, 2, 8}) {
    RenderOptions o;
    o.uniform_share = static_cast<Real>(halves) / 2;
    all.push_back({"together, spread", fmt::format("together, spread {}", o.uniform_share),
                   fmt::format("{}", o.uniform_share), o});
  }
  for (const int share : {64, 32, 16, 8}) {
    RenderOptions o;
    if (1.0_r / static_cast<Real>(share) == usual.shared_colour) continue;  // is above
    o.shared_colour = 1.0_r / static_cast<Real>(share);
    all.push_back({"together, shared colour", fmt::format("together, shared colour 1/{}", share),
                   fmt::format("1/{}", share), o});
  }
  return all;
}

// A number that two frames share only if they took the same work and show the same.
uint64_t signature_of(const Frame& f) {
  const RenderStatistics& s = f.statistics;
  uint64_t h = 1;
  for (const int64_t n : {s.rays, s.segments, s.density_evaluations, s.colour_evaluations})
    h = mix64(h ^ static_cast<uint64_t>(n));
  for (const Real v : f.rgb) h = mix64(h ^ std::bit_cast<uint64_t>(static_cast<double>(v)));
  return h;
}

// What was measured of one setting, over all views.
struct Measured {
  std::vector<double> seconds, psnr;
  double square_sum = 0;  // difference from the picture with every skip off
  size_t values = 0;
  RenderStatistics work;
  std::vector<uint64_t> signatures;  // of each view

  // Of the views that both were measured on.
  bool same_as(const Measured& other) const {
    const size_t n = std::min(signatures.size(), other.signatures.size());
    return std::equal(signatures.begin(), signatures.begin() + static_cast<int64_t>(n),
                      other.signatures.begin());
  }
  double rms() const { return std::sqrt(square_sum / static_cast<double>(values)); }
  double mean_psnr() const {
    double sum = 0;
    for (const double p : psnr) sum += p;
    return sum / static_cast<double>(psnr.size());
  }
};

class Skips {
 public:
  Skips(const ErrorBenchOptions& options, const std::filesystem::path& run, ThreadPool& pool)
      : options_(options),
        run_(run),
        pool_(pool),
        field_(RadianceField::load(run / "model.nerf")),
        everywhere_(field_.without_empty_cells()),
        baking_seconds_(bake(field_, pool)) {
    for (Setting& s : settings(field_.has_density_cache()))
      if (settings_.empty() || options.selected(s.name)) settings_.push_back(std::move(s));
    measured_.resize(settings_.size());
  }

  ErrorCurve curve() {
    const Scene scene = skips_scene(options_, run_);
    const PhotoSet photos = load_photos(scene, pool_);
    const Vec3 background = evaluation_background(field_.info());
    for (Setting& s : settings_) s.options.background = background;
    // The first picture pays for memory that later ones find ready.
    render(field_, photos.cameras[0], scene.views[0].pose, settings_[0].options, pool_);
    for (size_t v = 0; v < scene.views.size(); ++v)
      measure_view(photos.photos[v], photos.cameras[v], scene.views[v].pose);
    if (measured_[0].psnr.empty())
      throw Error("every held-out photo is masked out", run_.string(), "give another run");
    return report(scene.views.size(), photos.photos[0]);
  }

 private:
  void measure_view(const Photo& photo, const Camera& camera, const Pose& pose) {
    const Image8 truth = photo_over(photo, settings_[0].options.background);
    Frame whole;
    for (size_t i = 0; i < settings_.size(); ++i) {
      Measured& m = measured_[i];
      if (settings_[i].empty_cells && !m.seconds.empty()) continue;
      Frame f = timed(camera, pose, settings_[i], m.seconds);
      m.work += f.statistics;
      m.signatures.push_back(signature_of(f));
      if (i == 0) whole = f;
      for (size_t k = 0; k < f.rgb.size(); ++k) {
        const double d = static_cast<double>(f.rgb[k]) - static_cast<double>(whole.rgb[k]);
        m.square_sum += d * d;
      }
      m.values += f.rgb.size();
      const Image8 picture = to_8bit(ImageF{f.width, f.height, 3, std::move(f.rgb)});
      if (const auto p = psnr(truth, picture, photo.mask)) m.psnr.push_back(*p);
    }
    // Again in turns, so that a slow while of the machine meets every setting.
    for (int repeat = 1; repeat < options_.repeats; ++repeat)
      for (size_t i = 0; i < settings_.size(); ++i)
        if (!settings_[i].empty_cells) timed(camera, pose, settings_[i], measured_[i].seconds);
  }

  Frame timed(const Camera& camera, const Pose& pose, const Setting& setting,
              std::vector<double>& seconds) {
    const RadianceField& field = setting.empty_cells ? everywhere_ : field_;
    const auto begin = std::chrono::steady_clock::now();
    Frame frame = render(field, camera, pose, setting.options, pool_);
    const auto end = std::chrono::steady_clock::now();
    seconds.push_back(std::chrono::duration<double>(end - begin).count());
    return frame;
  }

  ErrorCurve report(size_t views, const Photo& photo) const {
    const Measured& off = measured_[0];
    const double off_seconds = median(off.seconds);
    ErrorCurve curve;
    curve.name = "skips";
    curve.title = "Rendering: time against what the skips cost the picture";
    curve.text = fmt::format(
        "{} held-out views of {}, {}x{}, against the picture with every skip off ({}, f32: {:.2f} "
        "s, {:.2f} dB). {} Counts are sums over the views.",
        views, run_.filename().string(), photo.width, photo.height,
        field_.has_density_cache()
            ? "every occupied cell sampled four times, no stop, every sample's colour "
              "computed"
            : "the networks are asked for every sample",
        off_seconds, off.mean_psnr(), about_samples());
    curve.table.columns = {"setting",
                           "seconds",
                           "speedup",
                           "rms_difference",
                           "psnr",
                           "psnr_loss",
                           "worst_psnr_loss",
                           "rays",
                           "segments",
                           "density_evaluations",
                           "colour_evaluations",
                           "command"};
    Chart difference, loss;
    difference.name = "skips_difference";
    difference.title = "Difference from the picture with every skip off";
    difference.y = {"RMS difference of a colour (0 to 1)", true, {}};
    loss.name = "skips_psnr";
    loss.title = "Loss of PSNR against the photos";
    loss.y = {"PSNR lost against every skip off, dB", false, {}};
    for (Chart* chart : {&difference, &loss}) {
      chart->x = {"seconds per picture", true, {}};
      chart->x_mark = off_seconds;
      chart->x_mark_label = "every skip off";
    }
    std::string repeats;
    for (size_t i = 0; i < settings_.size(); ++i) {
      const Setting& s = settings_[i];
      const Measured& m = measured_[i];
      // Some switches have nothing to do in this model, or stand as another row has them.
      const auto before = measured_.begin() + static_cast<int64_t>(i);
      const auto same = std::find_if(measured_.begin(), before,
                                     [&](const Measured& other) { return m.same_as(other); });
      if (same != before) {
        const auto at = static_cast<size_t>(same - measured_.begin());
        repeats += fmt::format(" The same as {}: {}.", settings_[at].name, s.name);
        continue;
      }
      const double seconds = median(m.seconds), lost = mean_loss(m);
      curve.table.rows.push_back(
          {s.name, fmt::format("{:.4f}", seconds), fmt::format("{:.2f}", off_seconds / seconds),
           fmt::format("{:.3e}", m.rms()), fmt::format("{:.3f}", m.mean_psnr()),
           fmt::format("{:.4f}", lost), fmt::format("{:.4f}", worst_loss(m)),
           std::to_string(m.work.rays), std::to_string(m.work.segments),
           std::to_string(m.work.density_evaluations), std::to_string(m.work.colour_evaluations),
           command(s)});
      if (i == 0) continue;
      if (s.empty_cells) {  // would leave the others a corner of the charts
        curve.text += fmt::format(" With empty cells a picture takes {:.0f} s and loses {:.1f} dB.",
                                  seconds, lost);
        continue;
      }
      if (difference.series.empty() || difference.series.back().name != s.series)
        for (Chart* chart : {&difference, &loss}) chart->series.push_back({s.series, {}, true});
      difference.series.back().points.push_back({seconds, m.rms(), s.label});
      loss.series.back().points.push_back({seconds, lost, s.label});
    }
    curve.text += repeats;
    curve.charts = {std::move(difference), std::move(loss)};
    return curve;
  }

  // Which of the samples the switches are about.
  std::string about_samples() const {
    if (field_.has_density_cache())
      return "The cache's stop and the number of samples exist only where samples follow the "
             "cached densities: those points are with the default factor of samples, no stop and "
             "full shading but for what their label says. Empty cells were never trained where no "
             "photo shows matter: what they hold is not meant to be seen, and only the first view "
             "is rendered with them.";
    if (baking_seconds_)
      return fmt::format(
          "The cache says where the networks are empty: it was baked once, in {:.1f} s, which are "
          "in no row's seconds.",
          *baking_seconds_);
    return "Of such a model no cache can be baked.";
  }

  // Of the views that were measured, the first ones, against every skip off.
  double mean_loss(const Measured& m) const {
    double sum = 0;
    for (size_t v = 0; v < m.psnr.size(); ++v) sum += measured_[0].psnr[v] - m.psnr[v];
    return sum / static_cast<double>(m.psnr.size());
  }
  // Of any view, against every skip off.
  double worst_loss(const Measured& m) const {
    double worst = -1e9;
    for (size_t v = 0; v < m.psnr.size(); ++v)
      worst = std::max(worst, measured_[0].psnr[v] - m.psnr[v]);
    return worst;
  }

  std::string command(const Setting& s) const {
    return fmt::format(
        "nerf_bench error --curves skips --run {} --views {} --repeats {} --filter {}{} -o {}",
        shell_quoted(run_.string()), options_.views, options_.repeats, shell_quoted("=" + s.name),
        options_.threads > 0 ? fmt::format(" --threads {}", options_.threads) : "",
        options_.out_again());
  }

  const ErrorBenchOptions& options_;
  std::filesystem::path run_;
  ThreadPool& pool_;
  RadianceField field_, everywhere_;
  std::optional<double> baking_seconds_;
  std::vector<Setting> settings_;
  std::vector<Measured> measured_;
};

}  // namespace

Scene skips_scene(const ErrorBenchOptions& options, const std::filesystem::path& run) {
  Scene scene = held_out_scene(run, options.views);
  if (scene.views.empty())
    throw Error("no photo was held out from this run", run.string(),
                "give a run that was trained with --holdout split");
  return scene;
}

ErrorCurve skips_curve(const ErrorBenchOptions& options, const std::filesystem::path& run,
                       ThreadPool& pool) {
  return Skips(options, run, pool).curve();
}

}  // namespace nerf::apps
