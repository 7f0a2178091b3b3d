#include "train/capture_moments.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <utility>

#include "nerf/base/error.h"

namespace nerf {

namespace {

constexpr size_t kFirstPhotos = 3;     // of a curriculum
constexpr double kLastElastic = 1e-8;  // what the elastic loss's weight falls to

}  // namespace

CaptureMoments::CaptureMoments(const Scene& scene) {
  // Numbered by the capture, or told apart by their time alone.
  const auto key_of = [](const View& view) { return std::pair(view.time, view.ids.moment); };
  std::map<std::pair<double, int>, int> known;
  std::map<int, int> known_cameras;
  for (const int v : scene.train) {
    const View& view = scene.views[static_cast<size_t>(v)];
    known.emplace(key_of(view), 0);
    if (view.ids.camera >= 0) known_cameras.emplace(view.ids.camera, 0);
  }
  for (auto& [key, moment] : known) {
    moment = static_cast<int>(times.size());
    times.push_back(key.first);
  }
  for (auto& [id, camera] : known_cameras) {
    camera = static_cast<int>(cameras.size());
    cameras.push_back(id);
  }
  for (const int v : scene.train) {
    const View& view = scene.views[static_cast<size_t>(v)];
    of_photo.push_back(known.at(key_of(view)));
    camera_of.push_back(view.ids.camera < 0 ? -1 : known_cameras.at(view.ids.camera));
  }
  by_time.resize(of_photo.size());
  std::iota(by_time.begin(), by_time.end(), size_t{0});
  std::ranges::stable_sort(by_time, {}, [&](size_t i) { return of_photo[i]; });
}

int CaptureMoments::nearest(double time) const {
  const auto at = std::ranges::lower_bound(times, time);
  if (at == times.begin()) return 0;
  const int high = static_cast<int>(at - times.begin());
  if (at == times.end()) return high - 1;
  return *at - time < time - *std::prev(at) ? high : high - 1;
}

NetworkOptions options_for(const NetworkOptions& given, const std::string& method,
                           const Scene& scene, bool draws_masked, const CaptureMoments& moments) {
  NetworkOptions o = given;
  // Behind what is transparent is the background: nothing there must be opaque.
  o.opaque_end = o.opaque_end && !scene.alpha && !draws_masked;
  if (draws_masked) o.last_interval = 0;  // in the papers' any density is opaque
  const bool all_numbered = std::ranges::find(moments.camera_of, -1) == moments.camera_of.end();
  if (moments.cameras.size() < 2 || !all_numbered) o.camera_code = 0;
  // The authors give colours the one or the other: what differs between the cameras of a rig, or
  // what changes while one camera films.
  if (o.camera_code > 0) o.image_code = 0;
  if (o.deform.any() && (moments.times.empty() || !(moments.times.front() < moments.times.back())))
    throw Error("--method " + method + " learns what moves, and all photos are of one moment",
                scene.root.string(),
                "say when they were taken with --times frame, --times name or --times FILE.json, "
                "or take a method of scenes that stand still");
  return o;
}

CodeShape codes_for(const NetworkOptions& o, const CaptureMoments& moments,
                    const PixelSource& source) {
  CodeShape shape = code_shape(o, source.files());
  const auto of_files = [&](const std::vector<int>& of_photo) {
    std::vector<int> out(shape.photos.size(), 0);
    for (size_t i = 0; i < of_photo.size(); ++i)
      out[static_cast<size_t>(source.file_of(i))] = of_photo[i];
    return out;
  };
  if (o.deform.any()) {
    shape.moments = moments.times;
    shape.photo_moments = of_files(moments.of_photo);
  }
  if (o.camera_code > 0) {
    shape.cameras = moments.cameras;
    shape.photo_cameras = of_files(moments.camera_of);
  }
  return shape;
}

size_t photos_in_time(const NetworkRecipe& recipe, int64_t step, size_t photos) {
  if (step >= recipe.curriculum_steps) return photos;
  const double share = static_cast<double>(step) / recipe.curriculum_steps;
  const size_t open = static_cast<size_t>(share * static_cast<double>(photos));
  return std::min(std::max(open, kFirstPhotos), photos);
}

DeformWindows windows_at(const NetworkOptions& options, const NetworkRecipe& r, int64_t step) {
  const DeformOptions& d = options.deform;
  const auto open = [&](int degrees, int start, int steps) {
    if (steps == 0) return DeformWindows::kOpen;
    const double share = static_cast<double>(step - start) / steps;
    return degrees * std::clamp(share, 0.0, 1.0);
  };
  return {open(d.degrees, 0, r.window_steps),
          open(d.ambient_degrees, r.ambient_start, r.ambient_steps)};
}

Real elastic_at(const NetworkRecipe& r, int64_t step) {
  if (r.elastic_fall_steps == 0 || step < r.elastic_steps) return r.elastic;
  const double share =
      std::min(1.0, static_cast<double>(step - r.elastic_steps) / r.elastic_fall_steps);
  const double left = 0.5 * (1 + std::cos(std::numbers::pi * share));
  return static_cast<Real>(kLastElastic + (static_cast<double>(r.elastic) - kLastElastic) * left);
}

}  // namespace nerf
