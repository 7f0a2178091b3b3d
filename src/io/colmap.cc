#include "colmap.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>

#include "nerf/math/camera_paths.h"
#include "paths.h"
#include "scene_limits.h"

namespace nerf::internal {

namespace fs = std::filesystem;

CameraModel colmap_camera_model(const Cursor& at, int64_t id) {
  if (const auto model = camera_model_from_id(id)) return *model;
  // Names of the ids that newer versions have given out, so that the message says which lens it is.
  static constexpr std::array<std::string_view, 5> kNewer{"SIMPLE_DIVISION", "DIVISION",
                                                          "SIMPLE_FISHEYE", "FISHEYE", "EUCM"};
  std::string name = fmt::format("camera model id {}", id);
  if (id >= 12 && id < 12 + static_cast<int64_t>(kNewer.size())) {
    name += fmt::format(" ({})", kNewer[static_cast<size_t>(id - 12)]);
  }
  at.fail(name + " is not supported",
          "undistort the images with `colmap image_undistorter` of the COLMAP that wrote this "
          "model, and use its output");
}

int colmap_camera_params(CameraModel model) {
  return model == CameraModel::kEquirectangular ? 2 : camera_model_params(model);
}

void ColmapBuilder::add_camera(const Cursor& at, uint32_t id, CameraModel model, uint64_t width,
                               uint64_t height,
                               const std::array<double, kMaxCameraParams>& params) {
  if (width > uint64_t{kMaxImageSide} || height > uint64_t{kMaxImageSide}) {
    at.fail(fmt::format("camera {} says {} x {} pixels", id, width, height), kImageSizeHint);
  }
  if (camera_index_.contains(id) || unusable_cameras_.contains(id)) {
    at.fail(fmt::format("camera id {} appears twice", id));
  }
  Camera camera{model, static_cast<int>(width), static_cast<int>(height), params};
  if (is_panorama(camera)) camera = panorama(camera.width, camera.height);
  if (const auto problem = camera_problem(camera)) {
    const std::string what = fmt::format("camera {} {}", id, *problem);
    if (width < 1 || height < 1) at.fail(what, kImageSizeHint);
    unusable_cameras_.emplace(id, Unusable{what, at.where()});
    return;
  }
  camera_index_.emplace(id, static_cast<int>(model_.cameras.size()));
  model_.cameras.push_back(camera);
}

void ColmapBuilder::add_image(const Cursor& at, uint32_t id,
                              const std::array<double, 7>& camera_from_world, uint32_t camera_id,
                              std::string name) {
  const auto& [qw, qx, qy, qz, tx, ty, tz] = camera_from_world;
  const std::string who = fmt::format("image {} ({})", id, printable(name));
  image_kept_ = false;
  if (clean_image_name(name).empty()) at.fail(fmt::format("image {} has no name", id));
  if (!names_.insert(clean_image_name(name)).second) at.fail(who + ": its name appears twice");
  if (!image_index_.emplace(id, static_cast<int>(model_.images.size())).second) {
    at.fail(fmt::format("image id {} appears twice", id));
  }
  const double norm = std::sqrt(qw * qw + qx * qx + qy * qy + qz * qz);
  if (!std::isfinite(norm) || !coordinate_ok({tx, ty, tz})) {
    leave_out(who + " has a pose that is not finite", at.where(), id, std::move(name));
    return;
  }
  if (const auto it = unusable_cameras_.find(camera_id); it != unusable_cameras_.end()) {
    leave_out(it->second.problem, it->second.where, id, std::move(name));
    return;
  }
  // Written with few digits a quaternion is a little off; one far off is damage.
  if (std::abs(norm - 1) > 0.1) {
    at.fail(fmt::format("{} has a rotation quaternion of length {:.3g} in place of 1", who, norm));
  }
  Pose world_to_camera;
  world_to_camera.rotation = to_rotation({qw / norm, qx / norm, qy / norm, qz / norm});
  world_to_camera.translation = {tx, ty, tz};

  const auto camera = camera_index_.find(camera_id);
  if (camera == camera_index_.end()) {
    at.fail(fmt::format("{} refers to camera {}, which the model does not have", who, camera_id));
  }
  model_.images.push_back({std::move(name), camera->second, world_to_camera.inverse()});
  keypoints_.emplace_back();
  image_kept_ = true;
}

void ColmapBuilder::leave_out(const std::string& problem, const std::string& where, uint32_t id,
                              std::string name) {
  if (left_out_.empty()) first_problem_.emplace(problem, where, kImageSizeHint);
  left_out_.push_back(std::move(name));
  image_index_.erase(id);
}

void ColmapBuilder::add_point(uint64_t id, const Vec3d& position, double error) {
  point_ = id;
  point_kept_ = coordinate_ok(position);
  if (!point_kept_) {
    ++points_dropped_;
    return;
  }
  // COLMAP writes -1 where it has no error.
  model_.points.push_back({position, std::isfinite(error) && error > 0 ? error : 0, 0});
}

void ColmapBuilder::add_track(uint32_t image_id, uint32_t keypoint) {
  if (!point_kept_) return;
  const auto image = image_index_.find(image_id);
  if (image == image_index_.end()) return;  // seen by an image that was taken out of the model
  ++model_.points.back().views;
  model_.observations.push_back({image->second, static_cast<int32_t>(model_.points.size()) - 1});
  // A track that its own keypoint does not name is not believed: some programs write any numbers.
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Keypoint>& keypoints = keypoints_[static_cast<size_t>(image->second)];
  const bool known = keypoint < keypoints.size() && keypoints[keypoint].point == point_;
  model_.keypoints.push_back(known ? keypoints[keypoint].pixel : Vec2d{kUnknown, kUnknown});
}

ColmapModel ColmapBuilder::finish() {
  if (points_dropped_ > 0) {
    warn(fmt::format("{} points with coordinates that are not finite were left out",
                     points_dropped_));
  }
  if (!left_out_.empty()) {
    if (model_.images.empty()) throw *first_problem_;
    warn(fmt::format(
        "{} of {} images are left out, their camera or pose is not finite or no "
        "lens has it: {}",
        left_out_.size(), left_out_.size() + model_.images.size(), name_list(left_out_)));
  }
  return std::move(model_);
}

namespace {

bool has(const fs::path& folder, const std::string& file) { return path_exists(folder / file); }

bool has_any(const fs::path& folder, const std::string& extension) {
  return has(folder, "cameras" + extension) || has(folder, "images" + extension) ||
         has(folder, "points3D" + extension);
}

bool complete(const fs::path& folder, const std::string& extension) {
  return has(folder, "cameras" + extension) && has(folder, "images" + extension);
}

std::string model_extension(const fs::path& folder) {
  return complete(folder, ".bin") || !complete(folder, ".txt") ? ".bin" : ".txt";
}

}  // namespace

bool is_colmap_model(const fs::path& folder) {
  return has_any(folder, ".bin") || has_any(folder, ".txt");
}

uint64_t colmap_image_count(const fs::path& folder) {
  const fs::path file = folder / ("images" + model_extension(folder));
  std::ifstream in(file, std::ios::binary);
  if (file.extension() == ".bin") {
    std::array<unsigned char, 8> raw{};
    if (!in.read(reinterpret_cast<char*>(raw.data()), raw.size())) return 0;
    uint64_t count = 0;
    for (size_t i = raw.size(); i-- > 0;) count = count << 8 | raw[i];
    // A number that the file has no room for is damage, and must not make a model the largest.
    std::error_code problem;
    const auto size = fs::file_size(file, problem);
    return problem || count > size / 73 ? 0 : count;
  }
  uint64_t lines = 0;
  std::string line;
  while (std::getline(in, line)) lines += line.empty() || line.front() != '#';
  return lines / 2;
}

ColmapModel read_colmap_model(const fs::path& folder) {
  const std::string extension = model_extension(folder);
  for (const char* part : {"cameras", "images"}) {
    if (!has(folder, part + extension)) {
      throw Error(fmt::format("the COLMAP model has no {}{} (or .txt)", part, extension),
                  folder.string(), "a model is cameras, images and points3D in one folder");
    }
  }
  ColmapBuilder builder;
  const bool binary = extension == ".bin";
  (binary ? read_colmap_cameras_binary : read_colmap_cameras_text)(folder / ("cameras" + extension),
                                                                   builder);
  (binary ? read_colmap_images_binary : read_colmap_images_text)(folder / ("images" + extension),
                                                                 builder);
  const std::string points = "points3D" + extension;
  if (has(folder, points)) {
    (binary ? read_colmap_points_binary : read_colmap_points_text)(folder / points, builder);
  } else {
    builder.warn((folder / points).string() +
                 " is missing: near, far and extent are guessed from the cameras");
  }
  ColmapModel model = builder.finish();
  const bool rigs = has(folder, "rigs" + extension) || has(folder, "frames" + extension);
  model.format =
      fmt::format("COLMAP {}{}", binary ? "binary" : "text", rigs ? ", with rigs and frames" : "");
  return model;
}

std::string clean_image_name(std::string_view name) {
  std::string forward(name);
  std::replace(forward.begin(), forward.end(), '\\', '/');
  std::string out;
  for (const fs::path& part : fs::path(forward).relative_path().lexically_normal()) {
    if (part.empty() || part == "." || part == "..") continue;
    out += out.empty() ? "" : "/";
    out += part.string();
  }
  return out;
}

std::string name_list(const std::vector<std::string>& names) {
  constexpr size_t kNamesShown = 8;
  std::string list;
  for (size_t i = 0; i < std::min(names.size(), kNamesShown); ++i)
    list += (i == 0 ? "" : ", ") + printable(names[i]);
  return list + (names.size() > kNamesShown ? ", ..." : "");
}

std::string printable(std::string_view text) {
  std::string out;
  for (const char c : text.substr(0, 120)) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte == 0x7f) {
      out += fmt::format("\\x{:02x}", byte);
    } else {
      out += c;
    }
  }
  if (text.size() > 120) out += "...";
  return out;
}

}  // namespace nerf::internal
