#include "found_cameras.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <vector>

#include "io/cameras/find_cameras.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/math/camera_paths.h"
#include "paths.h"
#include "photo_conversion.h"
#include "staged_folder.h"

namespace nerf::internal {
namespace {

namespace fs = std::filesystem;

constexpr int kRounds = 30;     // of the reweighting
constexpr size_t kStarts = 50;  // cameras whose own rotation is tried first
// Of the squares of places, below which cameras stand in one: a thousandth of a millimetre in ten
// metres would be a hundred times as much.
constexpr double kRounding = 1e-16;

// The rotation nearest to a matrix in the least-squares sense (Horn, Hilden and Negahdaripour
// 1988).
Mat3d nearest_rotation(const Eigen::Matrix3d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU();
  if ((u * svd.matrixV().transpose()).determinant() < 0) u.col(2) *= -1;
  const Eigen::Matrix3d r = u * svd.matrixV().transpose();
  Mat3d out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out.m[static_cast<size_t>(i)][static_cast<size_t>(j)] = r(i, j);
  return out;
}

// Weights for the least sum of distances; one that is met counts as 1e-3 of the median away.
std::vector<double> weights_of(const std::vector<double>& distances) {
  const double least = std::max(1e-3 * quantile(distances, 0.5), 1e-12);
  std::vector<double> weights;
  for (const double d : distances) weights.push_back(1 / std::max(d, least));
  return weights;
}

struct RotationFit {
  Mat3d rotation;
  std::vector<double> angles;  // that each camera is off by

  RotationFit(const Mat3d& r, std::span<const Pose> from, std::span<const Pose> to) : rotation(r) {
    for (size_t i = 0; i < from.size(); ++i)
      angles.push_back(rotation_angle(rotation * from[i].rotation, to[i].rotation));
  }
  double sum() const { return std::accumulate(angles.begin(), angles.end(), 0.0); }
};

RotationFit rotation_between(std::span<const Pose> from, std::span<const Pose> to) {
  // Begins with what one camera says: halves that contradict each other have a mean that is
  // neither.
  std::optional<RotationFit> best;
  const size_t step = std::max<size_t>(1, from.size() / kStarts);
  for (size_t k = 0; k < from.size(); k += step) {
    RotationFit fit(to[k].rotation * from[k].rotation.transposed(), from, to);
    if (!best || fit.sum() < best->sum()) best = std::move(fit);
  }
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<double> weights = weights_of(best->angles);
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (size_t i = 0; i < from.size(); ++i) {
      const Mat3d turn = to[i].rotation * from[i].rotation.transposed();
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
          sum(r, c) += weights[i] * turn.m[static_cast<size_t>(r)][static_cast<size_t>(c)];
    }
    best.emplace(nearest_rotation(sum), from, to);
  }
  return *best;
}

// What a person wants to know of how wrong the given cameras were.
struct Apart {
  std::vector<double> degrees, distances;
  Box3 box;
  std::string text() const {
    return fmt::format("{:.2f} degrees and {:.2f} % of their extent (medians)",
                       quantile(degrees, 0.5),
                       100 * quantile(distances, 0.5) / std::max(length(box.size()), 1e-300));
  }
};

}  // namespace

void link_photos(const SceneInput& input, const std::vector<size_t>& which,
                 const fs::path& folder) {
  StagedFolder staged(folder);
  const bool together = 2 * input.cameras.size() > input.views.size();
  for (const size_t v : which) {
    const View& view = input.views[v];
    const fs::path of_camera = staged.path() / std::to_string(together ? 0 : view.camera);
    fs::create_directories(of_camera);
    link_or_copy_photo(view.image_path,
                       of_camera / fmt::format("{:06}{}", v, lower_extension(view.image_path)));
  }
  staged.commit("");
}

size_t linked_view(const std::string& name) { return std::stoul(fs::path(name).stem()); }

std::optional<Similarity> similarity_between(std::span<const Pose> from, std::span<const Pose> to) {
  NERF_CHECK_EQ(from.size(), to.size());
  if (from.size() < 3) return std::nullopt;
  const RotationFit turned = rotation_between(from, to);
  Similarity best;
  best.rotation = turned.rotation;
  // Cameras that look elsewhere stand elsewhere, too.
  std::vector<double> weights = weights_of(turned.angles);
  for (int round = 0; round < kRounds; ++round) {
    Vec3d from_middle, to_middle;
    double all = 0;
    for (size_t i = 0; i < from.size(); ++i) {
      from_middle = from_middle + from[i].translation * weights[i];
      to_middle = to_middle + to[i].translation * weights[i];
      all += weights[i];
    }
    from_middle = from_middle / all;
    to_middle = to_middle / all;
    double along = 0, squares = 0;
    for (size_t i = 0; i < from.size(); ++i) {
      const Vec3d a = best.rotation * (from[i].translation - from_middle);
      along += weights[i] * dot(a, to[i].translation - to_middle);
      squares += weights[i] * dot(a, a);
    }
    const double unit = dot(from_middle, from_middle) * all;
    if (!(squares > kRounding * unit) || !(along > 0)) return std::nullopt;
    best.scale = along / squares;
    // scale R (x - center) = scale R (x - from_middle) + to_middle
    best.center = from_middle - best.rotation.transposed() * to_middle / best.scale;
    std::vector<double> distances;
    for (size_t i = 0; i < from.size(); ++i)
      distances.push_back(length(best.apply(from[i].translation) - to[i].translation));
    weights = weights_of(distances);
  }
  return best;
}

bool take_found_cameras(const SceneInput& found, const std::vector<size_t>& view_of,
                        SceneInput& input) {
  std::vector<Pose> from, to;
  std::vector<size_t> used;  // of found's views
  for (size_t f = 0; f < found.views.size(); ++f) {
    const View& view = input.views[view_of[f]];
    const Camera& given = input.cameras[static_cast<size_t>(view.camera)];
    const Camera& now = found.cameras[static_cast<size_t>(found.views[f].camera)];
    if (given.width != now.width || given.height != now.height) continue;
    used.push_back(f);
    from.push_back(found.views[f].pose);
    to.push_back(view.pose);
  }
  const std::optional<Similarity> moved = similarity_between(from, to);
  if (2 * used.size() < input.views.size() || !moved) {
    std::string why = fmt::format("cameras of only {} of {} photos were found anew",
                                  found.views.size(), input.views.size());
    if (found.views.size() > used.size())
      why += fmt::format(
          ", {} of them of photos that are turned or of another size than their "
          "given cameras say",
          found.views.size() - used.size());
    if (2 * used.size() >= input.views.size())
      why =
          "cameras that were found anew cannot be moved to the given ones, which stand in one "
          "place or are not alike";
    input.notes.push_back(why + ": the given ones stay as they are");
    return false;
  }
  Apart apart;
  for (const Pose& pose : to) apart.box.extend(pose.translation);
  const auto first_camera = static_cast<int>(input.cameras.size());
  input.cameras.insert(input.cameras.end(), found.cameras.begin(), found.cameras.end());
  for (size_t i = 0; i < used.size(); ++i) {
    const View& of = found.views[used[i]];
    View& view = input.views[view_of[used[i]]];
    const Pose pose = moved->apply(of.pose);
    apart.degrees.push_back(rotation_angle(pose.rotation, view.pose.rotation) * 180 /
                            std::numbers::pi);
    apart.distances.push_back(length(pose.translation - view.pose.translation));
    view.pose = pose;
    view.camera = first_camera + of.camera;
  }
  // Points of the given cameras go with them; measured ones, which nothing says who saw, stay.
  if (input.points.empty() || !input.observations.empty()) {
    input.points.clear();
    input.observations.clear();
    for (ScenePoint point : found.points) {
      point.position = moved->apply(point.position);
      input.points.push_back(point);
    }
    for (const Observation& o : found.observations)
      input.observations.push_back(
          {static_cast<int32_t>(view_of[static_cast<size_t>(o.image)]), o.point});
  }
  input.notes.push_back(fmt::format(
      "cameras of {} of {} photos were found anew and moved to the given ones, {} from them",
      used.size(), input.views.size(), apart.text()));
  return true;
}

bool find_cameras_anew(SceneInput& input, const SceneOptions& options,
                       const std::function<void(const std::string&)>& progress,
                       const Cancel* cancel) {
  if (options.work_folder.empty())
    throw Error("finding cameras anew needs a folder to work in", "work_folder",
                "name a folder for the run, COLMAP's model is written there");
  bool is_fisheye = true;
  for (const View& view : input.views) {
    const Camera& camera = input.cameras[static_cast<size_t>(view.camera)];
    if (is_panorama(camera))
      throw Error("cameras of panoramas are not found anew", view.image_path.string(),
                  "leave --adjust-cameras out");
    is_fisheye =
        is_fisheye && camera_model_name(camera.model).find("FISHEYE") != std::string_view::npos;
  }
  const CaptureFolders folders{options.work_folder, options.run_folder};
  const fs::path photos = options.work_folder / "given";
  std::vector<size_t> all(input.views.size());
  std::iota(all.begin(), all.end(), size_t{0});
  link_photos(input, all, photos);
  std::vector<std::string> notes;
  check_camera_model(options.camera_model);
  CameraSearch search;
  search.camera_model = is_fisheye && options.camera_model == "auto"
                            ? camera_model_name(CameraModel::kOpenCVFisheye)
                            : options.camera_model;
  const SceneInput found =
      read_colmap_scene(find_cameras(prepared_photos(photos, folders, progress, cancel, notes),
                                     folders, search, progress, cancel));
  input.notes.insert(input.notes.end(), notes.begin(), notes.end());
  std::vector<size_t> view_of;
  for (const View& view : found.views) view_of.push_back(linked_view(view.name));
  return take_found_cameras(found, view_of, input);
}

}  // namespace nerf::internal
