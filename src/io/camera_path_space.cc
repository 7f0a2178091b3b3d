// Whose coordinates a camera path is in.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "camera_path_formats.h"
#include "colmap.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/math/camera_paths.h"
#include "paths.h"
#include "scene_limits.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr const char* kTransformFile = "dataparser_transforms.json";
// A path whose frames are, half of them, farther from every camera than this share of the cameras'
// own spread shows what no photo stood near.
constexpr double kFar = 0.6;
constexpr uint64_t kMaxFileBytes = uint64_t{256} << 20;

// y = scale * (rotation * x + translation).
struct Normalisation {
  Mat3d rotation;
  Vec3d translation;
  double scale = 1;

  Pose undo(const Pose& p) const {
    const Mat3d back = rotation.transposed();
    return {orthonormalized(back * p.rotation), back * (p.translation / scale - translation)};
  }
};

// Rows of a matrix with 3 or 4 rows whose left part is a rotation.
void read_rows(const json& rows, const std::string& where, Mat3d& rotation, Vec3d& translation) {
  if (!rows.is_array() || rows.size() < 3 || rows.size() > 4)
    throw Error("expected 3 rows of 4 numbers", where);
  for (size_t r = 0; r < 3; ++r) {
    if (!rows[r].is_array() || rows[r].size() != 4)
      throw Error("expected 3 rows of 4 numbers", where);
    for (size_t c = 0; c < 4; ++c) {
      const double x = rows[r][c].is_number() ? rows[r][c].get<double>() : std::nan("");
      if (!(std::abs(x) <= 1e9)) throw Error("holds what is not a number", where);
      if (c < 3)
        rotation.m[r][c] = x;
      else
        translation[static_cast<int>(r)] = x;
    }
  }
  if (!(orthonormality_error(rotation) <= 1e-3))
    throw Error("does not begin with a rotation", where);
}

Normalisation read_normalisation(const fs::path& file) {
  const std::string where = file.string();
  const json document = parse_path_json(read_text_file(file, kMaxFileBytes), where);
  if (!document.is_object() || !document.contains("transform") || !document.contains("scale"))
    throw Error("there is no \"transform\" and \"scale\"", where,
                "give the dataparser_transforms.json of the nerfstudio run");
  Normalisation n;
  read_rows(document["transform"], where + ": transform", n.rotation, n.translation);
  const json& scale = document["scale"];
  n.scale = scale.is_number() ? scale.get<double>() : 0;
  if (!(n.scale > 0 && n.scale < 1e9)) throw Error("is no scale", where + ": scale");
  return n;
}

// nerfstudio's transform takes the coordinates from before "applied_transform" of transforms.json;
// a model that was trained on that file has those after it.
std::optional<Normalisation> read_applied(const fs::path& file) {
  if (!is_file(file)) return std::nullopt;
  const std::string where = file.string();
  const json document = parse_path_json(read_text_file(file, kMaxFileBytes), where);
  if (!document.is_object() || !document.contains("applied_transform")) return std::nullopt;
  Normalisation n;
  read_rows(document["applied_transform"], where + ": applied_transform", n.rotation,
            n.translation);
  return n;
}

std::vector<Vec3d> positions_of(const ModelInfo& info) {
  std::vector<Vec3d> positions;
  for (const ModelView& view : info.views) positions.push_back(view.pose.translation);
  return positions;
}

// Median distance of frames from the camera nearest to each.
double distance_from(const std::vector<Vec3d>& cameras, const CameraPath& path) {
  constexpr size_t kMostFrames = 200;
  const size_t stride = (path.frames.size() + kMostFrames - 1) / kMostFrames;
  std::vector<double> distances;
  for (size_t i = 0; i < path.frames.size(); i += stride) {
    double nearest = 1e300;
    for (const Vec3d& c : cameras)
      nearest = std::min(nearest, length(c - path.frames[i].camera_to_world.translation));
    distances.push_back(nearest);
  }
  return quantile(distances, 0.5);
}

// How far apart the cameras stand, or where that is little against what they look at, half of that
// distance.
double spread_of(const ModelInfo& info, const std::vector<Vec3d>& cameras) {
  Vec3d middle;
  for (int k = 0; k < 3; ++k) {
    std::vector<double> values;
    for (const Vec3d& c : cameras) values.push_back(c[k]);
    middle[k] = quantile(values, 0.5);
  }
  std::vector<double> out;
  for (const Vec3d& c : cameras) out.push_back(length(c - middle));
  std::vector<Pose> poses;
  for (const ModelView& view : info.views) poses.push_back(view.pose);
  const auto focus = nearest_point_to_axes(poses);
  return std::max(quantile(out, 0.5), focus ? 0.5 * length(*focus - middle) : 0);
}

}  // namespace

void place_path(CameraPath& path, const fs::path& file, const fs::path& transform,
                const ModelInfo& info, bool look_beside) {
  const std::vector<Vec3d> cameras = positions_of(info);
  if (cameras.empty() || path.frames.empty()) return;
  double distance = distance_from(cameras, path);
  const fs::path beside = file.parent_path() / kTransformFile;
  const bool found = look_beside && is_file(beside);
  const fs::path& used = transform.empty() ? beside : transform;
  if (!transform.empty() || found) {
    const Normalisation normalisation = read_normalisation(used);
    CameraPath placed = path;
    for (PathFrame& frame : placed.frames)
      frame.camera_to_world = normalisation.undo(frame.camera_to_world);
    double placed_distance = distance_from(cameras, placed);
    if (const auto applied = read_applied(file.parent_path() / "transforms.json")) {
      CameraPath after = placed;
      for (PathFrame& frame : after.frames)
        frame.camera_to_world = {
            applied->rotation * frame.camera_to_world.rotation,
            applied->rotation * frame.camera_to_world.translation + applied->translation};
      if (const double d = distance_from(cameras, after); d < placed_distance) {
        placed = std::move(after);
        placed_distance = d;
      }
    }
    if (!transform.empty() || placed_distance <= distance) {
      if (transform.empty())
        placed.notes.push_back("the path is taken out of the space that " +
                               printable(beside.string()) + " describes");
      path = std::move(placed);
      distance = placed_distance;
    } else {
      path.notes.push_back(printable(beside.string()) +
                           " is not used: the path fits the capture's cameras as it is");
    }
  }
  const double spread = spread_of(info, cameras);
  if (distance > kFar * spread)
    path.notes.push_back(fmt::format(
        "the path lies {:.3g} from the nearest camera, and the cameras {:.3g} from their middle: "
        "it may be in another tool's coordinates{}",
        distance, spread,
        transform.empty() && !found
            ? " (--path-transform takes nerfstudio's dataparser_transforms.json)"
            : ""));
}

}  // namespace nerf::internal
