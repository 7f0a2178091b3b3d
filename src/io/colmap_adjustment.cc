#include "colmap_adjustment.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "math/bundle_adjustment.h"
#include "nerf/base/memory.h"
#include "nerf/math/camera_paths.h"

namespace nerf::internal {
namespace {

// How far into a picture keypoints reach (their 99th percentile), as a share of its size: outside
// of these bounds they are of photos of another size. Keypoints beyond kFarOutside are left out.
constexpr double kLeastReach = 0.6, kMostReach = 1.2, kFarOutside = 10, kReached = 0.99;

// Unknowns that are solved for though nobody asked: 600 photos with one lens, a minute.
constexpr int64_t kMostUnasked = 3600;

struct ModelKeypoints {
  Bundle bundle;  // points as the model's; keypoints that are known
  double reach = 0;
};

ModelKeypoints keypoints_of(const ColmapModel& model) {
  ModelKeypoints out;
  Bundle& bundle = out.bundle;
  bundle.cameras = model.cameras;
  for (const ColmapImage& image : model.images) bundle.images.push_back({image.camera, image.pose});
  for (const ScenePoint& point : model.points) bundle.points.push_back(point.position);
  std::vector<double> reaches;
  for (size_t i = 0; i < model.observations.size(); ++i) {
    const Observation& o = model.observations[i];
    const Vec2d& pixel = model.keypoints[i];
    const Camera& camera =
        model.cameras[static_cast<size_t>(model.images[static_cast<size_t>(o.image)].camera)];
    const double x = pixel.x / camera.width, y = pixel.y / camera.height;
    if (!(std::abs(x) < kFarOutside && std::abs(y) < kFarOutside)) continue;
    reaches.push_back(std::max(x, y));
    bundle.keypoints.push_back({o.image, o.point, pixel});
  }
  if (!reaches.empty()) out.reach = quantile(std::move(reaches), kReached);
  return out;
}

void take_over(const Bundle& bundle, ColmapModel& model) {
  model.cameras = bundle.cameras;
  for (size_t i = 0; i < model.images.size(); ++i) {
    model.images[i].camera = bundle.images[i].camera;
    model.images[i].pose = bundle.images[i].pose;
  }
  for (size_t p = 0; p < model.points.size(); ++p) model.points[p].position = bundle.points[p];
  const std::vector<double> errors = reprojection_errors(bundle);
  std::vector<double> sums(model.points.size()), counts(model.points.size());
  for (size_t k = 0; k < errors.size(); ++k) {
    sums[static_cast<size_t>(bundle.keypoints[k].point)] += errors[k];
    ++counts[static_cast<size_t>(bundle.keypoints[k].point)];
  }
  for (size_t p = 0; p < model.points.size(); ++p)
    if (counts[p] > 0) model.points[p].error = sums[p] / counts[p];
}

bool is_too_large(const Bundle& bundle, int64_t most_unknowns) {
  const uint64_t memory = available_memory_bytes();
  return adjustment_unknowns(bundle) > most_unknowns ||
         (memory > 0 && adjustment_bytes(bundle) > memory / 2);
}

// Median error above which cameras are wrong, pixels: keypoints of large photos are found in
// smaller ones, and are off by as much more.
double wrong_from(const Bundle& bundle) {
  int longest = 0;
  for (const Camera& camera : bundle.cameras)
    longest = std::max({longest, camera.width, camera.height});
  return std::max(kWrongCameras, kWrongOfSide * longest);
}

bool is_perspective(CameraModel model) {
  return model == CameraModel::kSimplePinhole || model == CameraModel::kPinhole ||
         model == CameraModel::kSimpleRadial || model == CameraModel::kRadial ||
         model == CameraModel::kOpenCV;
}

// Leaves out cameras that no image has.
void drop_unused_cameras(Bundle& bundle) {
  std::vector<int> place(bundle.cameras.size(), -1);
  std::vector<Camera> kept;
  for (Bundle::Image& image : bundle.images) {
    int& at = place[static_cast<size_t>(image.camera)];
    if (at < 0) {
      at = static_cast<int>(kept.size());
      kept.push_back(bundle.cameras[static_cast<size_t>(image.camera)]);
    }
    image.camera = at;
  }
  bundle.cameras = std::move(kept);
}

// One RADIAL lens for the photos of each size that have a camera each, with focal lengths about the
// same; returns what they had, for a person. Empty where there are no such photos.
std::string share_lenses(Bundle& bundle) {
  constexpr size_t kFewest = 8;                // photos; fewer do not tell a lens
  constexpr double kApart = 0.1, kMost = 0.2;  // of the median; share of those farther from it
  std::vector<int> users(bundle.cameras.size());
  for (const Bundle::Image& image : bundle.images) ++users[static_cast<size_t>(image.camera)];
  std::map<std::pair<int, int>, std::vector<size_t>> alike;  // images
  for (size_t i = 0; i < bundle.images.size(); ++i) {
    const size_t c = static_cast<size_t>(bundle.images[i].camera);
    const Camera& camera = bundle.cameras[c];
    if (users[c] == 1 && is_perspective(camera.model))
      alike[{camera.width, camera.height}].push_back(i);
  }
  std::string said;
  for (const auto& [size, images] : alike) {
    if (images.size() < kFewest) continue;
    const auto camera_of = [&](size_t image) -> const Camera& {
      return bundle.cameras[static_cast<size_t>(bundle.images[image].camera)];
    };
    const auto median_of = [&](double (Camera::*of)() const) {
      std::vector<double> values;
      for (const size_t i : images) values.push_back((camera_of(i).*of)());
      return quantile(values, 0.5);
    };
    const double focal = median_of(&Camera::fx);
    const auto is_apart = [&](size_t i) {
      return std::abs(camera_of(i).fx() / focal - 1) > kApart;
    };
    if (static_cast<double>(std::ranges::count_if(images, is_apart)) >
        kMost * static_cast<double>(images.size()))
      continue;
    const auto [least, most] =
        std::ranges::minmax(images, {}, [&](size_t i) { return camera_of(i).fx(); });
    said += fmt::format(
        "{}{} photos of {} x {} pixels had a lens each, focal lengths {:.0f} to "
        "{:.0f} pixels",
        said.empty() ? "" : "; ", images.size(), size.first, size.second, camera_of(least).fx(),
        camera_of(most).fx());
    const auto shared = static_cast<int>(bundle.cameras.size());
    bundle.cameras.push_back({CameraModel::kRadial,
                              size.first,
                              size.second,
                              {focal, median_of(&Camera::cx), median_of(&Camera::cy)}});
    for (const size_t i : images) bundle.images[i].camera = shared;
  }
  drop_unused_cameras(bundle);
  return said;
}

struct Told {
  std::vector<std::string>& notes;
  const std::function<void(const std::string&)>& progress;
};

// Adjusts a bundle whose median error is `before`; whether it was changed.
bool adjust_to_keypoints(bool asked, double before, double reach, Bundle& bundle, const Told& told,
                         ThreadPool& pool, const Cancel* cancel) {
  const std::string wrong =
      fmt::format("the points lie {:.1f} pixels (median) from where the photos saw them", before);
  if (reach < kLeastReach || reach > kMostReach) {
    told.notes.push_back(wrong +
                         ": the keypoints are of photos of another size, and cameras are not "
                         "adjusted to them");
    return false;
  }
  if (is_too_large(bundle, asked ? kMostUnknowns : kMostUnasked)) {
    told.notes.push_back(wrong +
                         "; of so many photos cameras are adjusted with --adjust-cameras on, or by "
                         "colmap bundle_adjuster");
    return false;
  }
  if (told.progress)
    told.progress(
        fmt::format("adjusting {} cameras and {} points to {} keypoints, {:.1f} pixels off",
                    bundle.images.size(), bundle.points.size(), bundle.keypoints.size(), before));
  Bundle adjusted = bundle;
  const AdjustmentResult result = adjust_bundle(adjusted, pool, cancel);
  if (!(result.after < (asked ? before : before / 2)) || result.after > wrong_from(bundle)) {
    told.notes.push_back(
        fmt::format("{}, and no cameras were found that fit (median {:.1f} at best): they stay as "
                    "they are",
                    wrong, result.after));
    return false;
  }
  told.notes.push_back(
      fmt::format("{}: cameras, lenses and points were adjusted, to {:.1f} pixels; "
                  "--adjust-cameras off leaves them as they are",
                  wrong, result.after));
  bundle = std::move(adjusted);
  return true;
}

// Where a model has a lens for each photo and fewer explain its keypoints as well, those; whether
// the bundle was changed. colmap gives each photo one unless it is told that there is one camera,
// and a focal length that a single photo tells is bent to whatever its place is wrong by.
bool adjust_to_shared_lenses(Bundle& bundle, const Told& told, ThreadPool& pool,
                             const Cancel* cancel) {
  constexpr double kAsWell = 1.2;  // of the loss; lenses that differ have several times as much
  Bundle shared = bundle;
  const std::string had = share_lenses(shared);
  if (had.empty() || is_too_large(bundle, kMostUnasked)) return false;
  if (told.progress) told.progress("adjusting: " + had + "; does one for all explain them?");
  adjust_bundle(shared, pool, cancel);
  const double loss = reprojection_loss(shared);
  if (!(loss <= kAsWell * reprojection_loss(bundle))) return false;
  // Against lenses of their own that were adjusted as well.
  Bundle own = bundle;
  adjust_bundle(own, pool, cancel);
  if (!(loss <= kAsWell * reprojection_loss(own))) return false;
  told.notes.push_back(had +
                       ": one for all explains them as well, and cameras were adjusted to it; "
                       "--adjust-cameras off leaves them as they are");
  bundle = std::move(shared);
  return true;
}

}  // namespace

bool has_keypoints(const ColmapModel& model) {
  return std::ranges::any_of(
      model.keypoints, [](const Vec2d& k) { return std::isfinite(k.x) && std::isfinite(k.y); });
}

bool adjust_cameras(AdjustCameras wanted, ColmapModel& model, std::vector<std::string>& notes,
                    const std::function<void(const std::string&)>& progress, const Cancel* cancel) {
  if (wanted == AdjustCameras::kOff || std::ranges::any_of(model.cameras, is_panorama))
    return false;
  auto [bundle, reach] = keypoints_of(model);
  if (bundle.keypoints.empty()) return false;
  const Told told{notes, progress};
  ThreadPool pool;
  const bool asked = wanted == AdjustCameras::kOn;
  const double before = quantile(reprojection_errors(bundle), 0.5);
  const bool fit = before <= wrong_from(bundle);
  bool changed = false;
  if (asked || !fit)
    changed = adjust_to_keypoints(asked, before, reach, bundle, told, pool, cancel);
  // Lenses are compared by keypoints that fit.
  if (fit || changed) changed |= adjust_to_shared_lenses(bundle, told, pool, cancel);
  if (changed) take_over(bundle, model);
  return changed;
}

}  // namespace nerf::internal
