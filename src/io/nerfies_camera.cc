#include "nerfies_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "lenient_json.h"
#include "nerf/base/text.h"
#include "nerf/math/camera_paths.h"
#include "paths.h"
#include "scene_limits.h"
#include "transforms_camera.h"

namespace nerf::internal {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

// `count` numbers of an entry; zeros where it is absent and need not be there.
std::vector<double> numbers(const FrameJson& file, const char* key, size_t count,
                            bool needed = true) {
  const json* list = file.find(key);
  if (list == nullptr && !needed) return std::vector<double>(count);
  if (list == nullptr) file.fail(fmt::format("there is no \"{}\"", key));
  std::vector<double> values;
  if (list->is_array())
    for (const json& value : *list)
      if (value.is_number() && std::isfinite(value.get<double>()))
        values.push_back(value.get<double>());
  if (values.size() != count || list->size() != count)
    file.fail(fmt::format("\"{}\" is not a list of {} finite numbers", key, count));
  return values;
}

double number(const FrameJson& file, const char* key, std::optional<double> otherwise = {}) {
  const auto value = file.number(key);
  if (!value && !otherwise) file.fail(fmt::format("there is no \"{}\"", key));
  return value ? *value : *otherwise;
}

Pose read_pose(const FrameJson& file) {
  const json* rows = file.find("orientation");
  if (rows == nullptr || !rows->is_array() || rows->size() != 3)
    file.fail("\"orientation\" is not 3 rows of 3 numbers");
  Mat3d world_to_camera;
  for (size_t r = 0; r < 3; ++r)
    for (size_t c = 0; c < 3; ++c) {
      const json& row = (*rows)[r];
      if (!row.is_array() || row.size() != 3 || !row[c].is_number())
        file.fail("\"orientation\" is not 3 rows of 3 numbers");
      world_to_camera.m[r][c] = row[c].get<double>();
    }
  if (!(orthonormality_error(world_to_camera) < 1e-3))
    file.fail("\"orientation\" is no rotation",
              "its rows are the camera's axes right, down, forward");
  Pose pose;
  pose.rotation = orthonormalized(world_to_camera.transposed());
  const std::vector<double> p = numbers(file, "position", 3);
  pose.translation = {p[0], p[1], p[2]};
  if (!coordinate_ok(pose.translation)) file.fail("\"position\" is absurd");
  return pose;
}

Camera read_lens(const FrameJson& file) {
  const std::vector<double> size = numbers(file, "image_size", 2);
  for (const double side : size)
    if (!(side >= 1 && side <= kMaxImageSide))
      file.fail(fmt::format("\"image_size\" is {} x {}", size[0], size[1]), kImageSizeHint);
  const double fx = number(file, "focal_length"), aspect = number(file, "pixel_aspect_ratio", 1);
  const double fy = fx * aspect, skew = number(file, "skew", 0);
  const std::vector<double> c = numbers(file, "principal_point", 2);
  const std::vector<double> k = numbers(file, "radial_distortion", 3, false);
  // The published code writes the short name, the published captures hold the long one.
  const bool short_name = file.find("tangential_distortion") == nullptr;
  const std::vector<double> p =
      numbers(file, short_name ? "tangential" : "tangential_distortion", 2, false);
  Camera camera;
  camera.width = static_cast<int>(std::lround(size[0]));
  camera.height = static_cast<int>(std::lround(size[1]));
  if (k[2] != 0) {
    camera.model = CameraModel::kFullOpenCV;
    camera.params = {fx, fy, c[0], c[1], k[0], k[1], p[0], p[1], k[2]};
  } else if (k[0] != 0 || k[1] != 0 || p[0] != 0 || p[1] != 0) {
    camera.model = CameraModel::kOpenCV;
    camera.params = {fx, fy, c[0], c[1], k[0], k[1], p[0], p[1]};
  } else {
    camera.model = CameraModel::kPinhole;
    camera.params = {fx, fy, c[0], c[1]};
  }
  if (const auto problem = camera_problem(camera))
    file.fail("the camera " + *problem, kImageSizeHint);
  // x in pixels is fx x + skew y + cx.
  constexpr double kUnseen = 0.05;  // pixels
  const double most = std::abs(skew) * std::max(c[1], size[1] - c[1]) / fy;
  if (!(most <= kUnseen))
    file.fail(fmt::format("\"skew\" is {:g}, which moves pixels by up to {:.2g}", skew, most),
              "lenses here have none: resample the photos to pixels at right angles, and write 0");
  return camera;
}

}  // namespace

NerfiesCamera read_nerfies_camera(const fs::path& file) {
  const json root = read_lenient_json(file);
  if (!root.is_object()) throw Error("is not a camera's object", file.string());
  const FrameJson entries{root, root, file.string()};
  return {read_lens(entries), read_pose(entries)};
}

std::vector<fs::path> nerfies_path_files(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code problem;
  for (fs::directory_iterator it(folder, problem), end; !problem && it != end;
       it.increment(problem)) {
    if (is_file(it->path()) && lower_extension(it->path()) == ".json") files.push_back(it->path());
  }
  std::ranges::sort(files, [](const fs::path& a, const fs::path& b) {
    return natural_less(a.filename().string(), b.filename().string());
  });
  return files;
}

}  // namespace nerf::internal
