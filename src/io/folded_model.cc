#include "folded_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <iterator>
#include <map>
#include <numbers>
#include <numeric>
#include <set>

#include "found_cameras.h"
#include "io/cameras/capture_photos.h"
#include "io/cameras/colmap_program.h"
#include "io/cameras/feature_stage.h"
#include "io/cameras/lookalikes.h"
#include "io/cameras/match_stage.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/process.h"
#include "nerf/base/text.h"
#include "nerf/base/threads.h"
#include "nerf/io/image.h"
#include "nerf/math/camera_paths.h"
#include "paths.h"

namespace nerf::internal {
namespace {

namespace fs = std::filesystem;

constexpr double kDegree = std::numbers::pi / 180;
// Turns from one photo to the next: of a jump at least, and usually at most.
constexpr double kJump = 60 * kDegree, kUsual = 20 * kDegree;
constexpr int kFewShared = 15, kManyShared = 50;  // points of a jump, and usually
constexpr size_t kMostJumps = 8, kFewestJumps = 2;

struct Step {
  size_t from = 0, to = 0;  // views
  double turn = 0;
  int shared = 0;
};

std::vector<Step> steps_by_name(const SceneInput& input) {
  std::vector<size_t> order(input.views.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::ranges::sort(order, natural_less,
                    [&](size_t v) -> std::string_view { return input.views[v].name; });
  std::vector<std::vector<int32_t>> seen(input.views.size());
  for (const Observation& o : input.observations)
    seen[static_cast<size_t>(o.image)].push_back(o.point);
  for (std::vector<int32_t>& points : seen) std::ranges::sort(points);
  std::vector<Step> steps;
  for (size_t i = 1; i < order.size(); ++i) {
    const size_t a = order[i - 1], b = order[i];
    std::vector<int32_t> shared;
    std::ranges::set_intersection(seen[a], seen[b], std::back_inserter(shared));
    steps.push_back({a, b,
                     rotation_angle(input.views[a].pose.rotation, input.views[b].pose.rotation),
                     static_cast<int>(shared.size())});
  }
  return steps;
}

template <class T>
T median_of(const std::vector<Step>& steps, T Step::* value) {
  std::vector<T> values;
  for (const Step& step : steps) values.push_back(step.*value);
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Which photos, and where they stand.
std::string key_of(const SceneInput& input, const std::vector<ViewPair>& jumps) {
  std::string key;
  for (const auto& [a, b] : jumps)
    for (const size_t v : {a, b}) {
      const View& view = input.views[v];
      key += view.image_path.string();
      for (int c = 0; c < 3; ++c) {
        const Vec3d axis = view.pose.rotation.column(c);
        key += fmt::format(" {} {} {} {}", axis.x, axis.y, axis.z, view.pose.translation[c]);
      }
      key += "\n";
    }
  return key;
}

// Jumps whose photos' matches contradict the cameras.
size_t contradicted_jumps(const SceneInput& input, const std::vector<ViewPair>& jumps,
                          const SceneOptions& options, const fs::path& folder,
                          const std::function<void(const std::string&)>& progress,
                          const Cancel* cancel) {
  std::set<size_t> views;
  for (const auto& [a, b] : jumps) views.insert({a, b});
  link_photos(input, {views.begin(), views.end()}, folder / "photos");
  const CapturePhotos photos = look_at_photos(folder / "photos", {folder, options.run_folder});
  const fs::path database = folder / "database.db";
  const ColmapProgram colmap(cancel);
  ThreadPool pool;
  find_features(colmap, photos, database, kAutoCameraModel, {}, progress);
  match_features(photos, database, {}, pool, progress, cancel);
  verify_matches(colmap, database, progress);
  FeatureDatabase features(database);
  std::vector<PlacedPhoto> placed;
  std::map<int64_t, size_t> view_of;  // by id in the database
  for (const FeatureDatabase::Image& image : features.images()) {
    const size_t v = linked_view(image.name);
    const View& view = input.views[v];
    const Camera& camera = input.cameras[static_cast<size_t>(view.camera)];
    // Features are where they are in the file; of a photo that is turned to fit its camera not.
    const ImageInfo info = read_image_info(view.image_path);
    if (info.width != camera.width || info.height != camera.height) continue;
    placed.push_back({image.name, static_cast<int>(v), camera, view.pose});
    view_of[image.id] = v;
  }
  size_t count = 0;
  for (const auto& [a, b] : check_photos(placed, features).against) {
    const ViewPair pair{view_of.at(a), view_of.at(b)};
    count += std::ranges::count_if(jumps, [&](const ViewPair& jump) {
               return jump == pair || jump == ViewPair(pair.second, pair.first);
             }) > 0;
  }
  return count;
}

bool is_folded(const SceneInput& input, const std::vector<ViewPair>& jumps,
               const SceneOptions& options, const std::function<void(const std::string&)>& progress,
               const Cancel* cancel) {
  const fs::path answer = options.work_folder / "jumps.txt";
  const std::string key = key_of(input, jumps);
  if (is_file(answer)) {
    const std::string said = read_text_file(answer);
    if (said == "folded\n" + key) return true;
    if (said == "not folded\n" + key) return false;
  }
  if (progress) {
    progress(
        fmt::format("{} times the next photo shows another side of things: comparing these "
                    "photos",
                    jumps.size()));
  }
  const fs::path folder = options.work_folder / "jumps";
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  make_writable_folder(folder);
  const bool folded =
      contradicted_jumps(input, jumps, options, folder, progress, cancel) >= kFewestJumps;
  fs::remove_all(folder, ignored);
  write_file_atomically(answer, (folded ? "folded\n" : "not folded\n") + key);
  return folded;
}

}  // namespace

std::vector<ViewPair> find_jumps(const SceneInput& input) {
  std::vector<Step> steps = steps_by_name(input);
  if (steps.empty() || median_of(steps, &Step::turn) > kUsual ||
      median_of(steps, &Step::shared) < kManyShared)
    return {};
  std::erase_if(steps, [](const Step& s) { return s.turn < kJump || s.shared >= kFewShared; });
  if (steps.size() < kFewestJumps) return {};
  std::ranges::stable_sort(steps, std::greater(), &Step::turn);
  steps.resize(std::min(steps.size(), kMostJumps));
  std::vector<ViewPair> jumps;
  for (const Step& step : steps) jumps.emplace_back(step.from, step.to);
  return jumps;
}

bool unfold(SceneInput& input, const SceneOptions& options,
            const std::function<void(const std::string&)>& progress, const Cancel* cancel) {
  if (options.work_folder.empty()) return false;
  const std::vector<ViewPair> jumps = find_jumps(input);
  if (jumps.empty() || !find_program("colmap")) return false;
  try {
    if (!is_folded(input, jumps, options, progress, cancel)) return false;
    input.notes.push_back(fmt::format(
        "the model puts photos of one side of something on another side that looks alike ({} and "
        "{}, which match, stand apart; --adjust-cameras off leaves it so)",
        input.views[jumps[0].first].name, input.views[jumps[0].second].name));
    return find_cameras_anew(input, options, progress, cancel);
  } catch (const Error& e) {
    input.notes.push_back(std::string("cameras were not found anew: ") + e.what());
    return false;
  }
}

}  // namespace nerf::internal
