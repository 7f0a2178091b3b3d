#include "read_capture.h"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

#include "nerf/base/memory.h"
#include "nerf/base/progress.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/run.h"

namespace nerf::apps {
namespace {

// Code, libraries and what they keep.
constexpr uint64_t kProgramBytes = uint64_t{32} << 20;

// Of a held-out photo after --downscale.
uint64_t most_pixels(const Scene& scene) {
  uint64_t most = 0;
  for (const int v : scene.test) {
    const size_t camera = static_cast<size_t>(scene.views[static_cast<size_t>(v)].camera);
    const Camera& c = scene.cameras[camera];
    most = std::max(most, static_cast<uint64_t>(c.width) * static_cast<uint64_t>(c.height));
  }
  const uint64_t divided = static_cast<uint64_t>(scene.options.downscale);
  return most / (divided * divided);
}

}  // namespace

void log_lines(const std::string& text) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) log_info(line);
}

void throw_if_stopped(const SignalCancel& stop) {
  if (stop.cancel().requested()) throw Cancelled();
}

Scene read_scene(const TrainCommand& command, const ThreadPool& pool, const SignalCancel& stop) {
  const auto progress = [&](const std::string& line) {
    throw_if_stopped(stop);
    log_info(line);
  };
  Scene scene = load_scene(command.scene, command.scene_options(), progress, &stop.cancel());
  throw_if_stopped(stop);
  // Smaller sizes of a photo add up to a third of it.
  if (command.scales > 1)
    scene.report.memory_estimate_bytes += scene.report.memory_estimate_bytes / 3;
  scene.report.memory_estimate_bytes +=
      kProgramBytes + training_memory_bytes(command.train, scene.unbounded, pool.size()) +
      evaluation_memory_bytes(most_pixels(scene));
  log_lines(format_report(scene.report));
  const uint64_t needed = scene.report.memory_estimate_bytes;
  const uint64_t limit = available_memory_bytes();
  if (needed > limit)
    throw Error(fmt::format("training needs about {} MB, but this process may use {} MB",
                            needed >> 20, limit >> 20),
                command.scene.string(),
                fmt::format("use --downscale {}, a smaller --grid-log2-entries, or more memory",
                            2 * scene.options.downscale));
  return scene;
}

PhotoSet decode(const Scene& scene, ThreadPool& pool, const SignalCancel& stop) {
  Progress progress("decoding");
  PhotoSet photos = load_photos(scene, pool, [&](int done, int total) {
    throw_if_stopped(stop);
    progress.update(static_cast<double>(done) / total, fmt::format("{}/{} photos", done, total));
  });
  progress.finish();
  if (scene.report.masks > 0)
    log_info(fmt::format("{:.1f} % of all pixels are masked out{}", 100 * photos.fraction_masked,
                         masks_cut_out(photos) ? ", around what is cut out" : ""));
  return photos;
}

void say_depth(const DepthPoints& depth, const Scene& scene) {
  if (depth.maps == 0) return;
  const auto percent = [](double share) { return fmt::format("{:.0f} %", 100 * share); };
  if (depth.rejected)
    log_warning(fmt::format(
        "the depth maps are not used, since they do not fit the cameras: of places that two "
        "photos show, {} are at the same depth in both, and one looks through {}; is "
        "depth_unit_scale_factor their unit, and do they show the same as the photos?",
        percent(depth.agreed), percent(depth.opposed)));
  else
    log_info(fmt::format(
        "depth maps of {} training photos: {} of places that two show are at the same depth in "
        "both; {} points; near, far {:.4g}, {:.4g}",
        depth.maps, percent(depth.agreed), depth.points, scene.near / scene.to_engine.scale,
        scene.far / scene.to_engine.scale));
}

}  // namespace nerf::apps
