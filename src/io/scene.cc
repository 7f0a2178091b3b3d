// load_scene: from what a format's reader found to a scene that can be trained on.
#include "nerf/io/scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <numeric>

#include "cut_out.h"
#include "depth_file.h"
#include "folded_model.h"
#include "found_cameras.h"
#include "moving_film.h"
#include "nerf/base/file.h"
#include "nerf/base/memory.h"
#include "point_cloud.h"
#include "scene_detect.h"
#include "scene_frame.h"
#include "scene_outliers.h"
#include "scene_times.h"

namespace nerf {
namespace {

using internal::SceneInput;

constexpr int kHoldoutStride = 8;

// Sorts views bytewise by name, with what runs parallel to them.
void sort_views(SceneInput& input) {
  std::vector<int> order(input.views.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    return input.views[static_cast<size_t>(a)].name < input.views[static_cast<size_t>(b)].name;
  });
  std::vector<View> views;
  std::vector<char> is_test;
  std::vector<int32_t> new_index(order.size());
  for (const int old : order) {
    new_index[static_cast<size_t>(old)] = static_cast<int32_t>(views.size());
    views.push_back(std::move(input.views[static_cast<size_t>(old)]));
    if (!input.is_test.empty()) is_test.push_back(input.is_test[static_cast<size_t>(old)]);
  }
  input.views = std::move(views);
  input.is_test = std::move(is_test);
  for (Observation& o : input.observations) o.image = new_index[static_cast<size_t>(o.image)];
}

void split_views(const std::vector<char>& is_test, Scene& scene) {
  const auto held_out = [&](size_t i) {
    return is_test.empty() ? i % kHoldoutStride == 0 : is_test[i] != 0;
  };
  if (scene.options.split == Split::kNone) {
    scene.train.resize(scene.views.size());
    std::iota(scene.train.begin(), scene.train.end(), 0);
    return;
  }
  if (scene.options.split == Split::kDev) {
    // Test views leave the scene altogether, so that nothing can be tuned on them.
    std::vector<View> views;
    std::vector<int32_t> kept(scene.views.size(), -1);
    for (size_t i = 0; i < scene.views.size(); ++i) {
      if (held_out(i)) continue;
      kept[i] = static_cast<int32_t>(views.size());
      views.push_back(std::move(scene.views[i]));
    }
    scene.views = std::move(views);
    for (Observation& o : scene.observations) o.image = kept[static_cast<size_t>(o.image)];
    std::erase_if(scene.observations, [](const Observation& o) { return o.image < 0; });
    for (size_t i = 0; i < scene.views.size(); ++i) {
      (i % kHoldoutStride == 0 ? scene.test : scene.train).push_back(static_cast<int>(i));
    }
  } else {
    for (size_t i = 0; i < scene.views.size(); ++i) {
      (held_out(i) ? scene.test : scene.train).push_back(static_cast<int>(i));
    }
  }
  if (scene.train.empty()) {
    throw Error("no image is left to train on", scene.root.string(),
                "more images are needed, or --holdout none");
  }
}

void describe_cameras(const Scene& scene, SceneReport& report) {
  constexpr size_t kShown = 8;
  std::map<std::string, int> count;
  for (const View& view : scene.views) {
    const Camera& c = scene.cameras[static_cast<size_t>(view.camera)];
    ++count[fmt::format("{} {}x{}", camera_model_name(c.model), c.width, c.height)];
  }
  for (const auto& [name, images] : count) {
    if (report.camera_models.size() == kShown) {
      report.camera_models.push_back(fmt::format("and {} more", count.size() - kShown));
      break;
    }
    report.camera_models.push_back(count.size() == 1 ? name
                                                     : fmt::format("{} ({} images)", name, images));
  }
}

void check_memory(const Scene& scene, SceneReport& report) {
  report.memory_limit_bytes = available_memory_bytes();
  if (report.memory_limit_bytes > 0 && report.memory_estimate_bytes > report.memory_limit_bytes) {
    report.warnings.push_back(
        fmt::format("the photos may not fit into memory: --downscale {} "
                    "takes a quarter of it",
                    2 * int64_t{scene.options.downscale}));
  }
}

// First of the warnings: no other explains as much of a bad picture.
void warn_of_few(SceneReport& report) {
  if (report.images_total < 2 * report.images_registered + 1) return;
  report.warnings.insert(
      report.warnings.begin(),
      fmt::format("ONLY {} OF {} PHOTOS HAVE A PLACE IN SPACE. The others are not used, and what "
                  "only they show will be missing or fog. Take more photos with much overlap "
                  "between those that are placed and those that are not, sharp and of things that "
                  "do not move; or match every pair (colmap exhaustive_matcher) and map again",
                  report.images_registered, report.images_total));
}

void warn_of_no_points(const Scene& scene, SceneReport& report) {
  const auto has_depth = [](const View& view) { return !view.depth_path.empty(); };
  if (std::ranges::any_of(scene.views, has_depth)) return;  // which says where content is
  if (!scene.points.empty() || !scene.unbounded || scene.states_depths ||
      (scene.options.near && scene.options.far))
    return;
  report.warnings.push_back(
      "there are no 3D points: where content begins and ends is guessed from the cameras, and "
      "points "
      "are looked for in the photos (a COLMAP model's points or a point cloud as .ply beside the "
      "capture are better; --near, --far and --bbox set it)");
}

double mean_error(const std::vector<ScenePoint>& points) {
  double sum = 0;
  int64_t count = 0;
  for (const ScenePoint& p : points) {
    sum += p.error;
    count += p.error > 0;
  }
  return count > 0 ? sum / static_cast<double>(count) : 0;
}

}  // namespace

Scene load_scene(const std::filesystem::path& given, const SceneOptions& options,
                 const std::function<void(const std::string&)>& progress, const Cancel* cancel) {
  if (options.downscale < 0) {
    throw Error(fmt::format("--downscale {} makes no sense", options.downscale), "",
                "give a whole number from 0");
  }
  check_times_option(options.times);
  Scene scene;
  scene.options = options;
  const std::filesystem::path path =
      options.format == SceneFormat::kAuto ? internal::unwrapped(given, options.run_folder) : given;
  const SceneFormat format =
      options.format == SceneFormat::kAuto ? internal::detect_format(path) : options.format;
  scene.options.format = format;
  SceneInput input = internal::read_scene_input(path, format, {options, progress, cancel});
  scene.root = std::filesystem::is_directory(path) ? path : path / "..";
  scene.root = scene.root.lexically_normal();
  SceneReport& report = scene.report;
  report.format = input.format;
  report.ignored = internal::inputs_beside(path, format);
  report.ignored.insert(report.ignored.end(), input.ignored.begin(), input.ignored.end());
  report.warnings = std::move(input.warnings);

  report.notes = std::move(input.notes);
  if (path != given) report.notes.insert(report.notes.begin(), "the scene is in " + path.string());

  internal::resolve_images(input, scene.options.downscale, report, &scene.alpha);
  scene.cut_out = internal::resolve_cut_out(input, options.cut_out, scene.alpha,
                                            scene.options.downscale, report);
  scene.alpha = scene.alpha || scene.cut_out;
  internal::resolve_depths(input, report);
  internal::add_points_from_files(input, scene.root, report);
  const bool found = format == SceneFormat::kPhotos || format == SceneFormat::kVideo;
  if (options.adjust_cameras != AdjustCameras::kOff && !found) {
    input.notes.clear();
    if (input.keypoints)
      input.cameras_adjusted |= internal::unfold(input, options, progress, cancel);
    else if (options.adjust_cameras == AdjustCameras::kOn)
      input.cameras_adjusted = internal::find_cameras_anew(input, options, progress, cancel);
    report.notes.insert(report.notes.end(), input.notes.begin(), input.notes.end());
  }
  internal::drop_far_cameras(input, report);
  if (input.views.size() < 2) {
    throw Error(fmt::format("there is {} registered image with a file",
                            input.views.empty() ? "no" : "only one"),
                path.string(), "a scene needs images from several places, some 20 or more");
  }
  sort_views(input);
  SceneOptions asked = scene.options;
  const bool is_film = input.times && input.times->on_request;
  if (is_film && asked.times.empty() && internal::film_moves(input, report, progress, cancel))
    asked.times = "frame";
  scene.times = internal::settle_times(input, asked, report);
  if (input.times &&
      (asked.times.empty() || asked.times == "none" || (asked.times == "frame" && is_film)))
    scene.frame_interval = input.times->interval;
  scene.cameras = input.cameras;
  scene.cameras_adjusted = input.cameras_adjusted;
  scene.views = input.views;
  scene.points = std::move(input.points);
  scene.states_depths = !input.depths.empty();
  internal::choose_frame(input, scene);
  scene.observations = std::move(input.observations);
  warn_of_no_points(scene, report);
  warn_of_few(report);

  report.points = static_cast<int>(scene.points.size());
  report.mean_reprojection_error = mean_error(scene.points);
  report.mask_convention =
      "masks: values of 128 and more keep a pixel; masked pixels count neither in training nor in "
      "metrics";
  describe_cameras(scene, report);
  check_memory(scene, report);
  split_views(input.is_test, scene);
  internal::describe_held_out(scene, report);
  return scene;
}

}  // namespace nerf
