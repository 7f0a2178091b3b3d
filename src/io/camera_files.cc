#include "nerf/io/camera_files.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "nerf/base/error.h"
#include "nerf/base/file.h"

namespace nerf {

namespace {

using Json = nlohmann::ordered_json;

bool same_camera(const Camera& a, const Camera& b) {
  return a.model == b.model && a.width == b.width && a.height == b.height && a.params == b.params;
}

std::string camera_line(size_t id, const Camera& c) {
  std::string line = fmt::format("{} {} {} {}", id, camera_model_name(c.model), c.width, c.height);
  if (is_panorama(c)) return line + fmt::format(" {} {}\n", c.width, c.height);
  for (int i = 0; i < camera_model_params(c.model); ++i)
    line += fmt::format(" {}", c.params[static_cast<size_t>(i)]);
  return line + "\n";
}

Eigen::Quaterniond quaternion(const Mat3d& r) {
  Eigen::Matrix3d m;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) m(i, j) = r.m[static_cast<size_t>(i)][static_cast<size_t>(j)];
  Eigen::Quaterniond q(m);
  if (q.w() < 0) q.coeffs() *= -1;
  return q;
}

// k1 k2 (k3 ...) p1 p2 under the names that programs read, and the model that says what they are.
void add_lens(const Camera& c, Json& frame) {
  const auto& p = c.params;
  const auto add = [&](const char* model, std::initializer_list<const char*> keys, size_t first) {
    frame["camera_model"] = model;
    for (const char* key : keys) frame[key] = p[first++];
  };
  switch (c.model) {
    case CameraModel::kSimplePinhole:
    case CameraModel::kPinhole:
      return add("PINHOLE", {}, 0);
    case CameraModel::kSimpleRadial:
      return add("OPENCV", {"k1"}, 3);
    case CameraModel::kRadial:
      return add("OPENCV", {"k1", "k2"}, 3);
    case CameraModel::kOpenCV:
      return add("OPENCV", {"k1", "k2", "p1", "p2"}, 4);
    case CameraModel::kFullOpenCV:
      return add("FULL_OPENCV", {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"}, 4);
    case CameraModel::kSimpleRadialFisheye:
      return add("OPENCV_FISHEYE", {"k1"}, 3);
    case CameraModel::kRadialFisheye:
      return add("OPENCV_FISHEYE", {"k1", "k2"}, 3);
    case CameraModel::kOpenCVFisheye:
      return add("OPENCV_FISHEYE", {"k1", "k2", "k3", "k4"}, 4);
    case CameraModel::kEquirectangular:
      return add("EQUIRECTANGULAR", {}, 0);
    default:
      throw Error(
          fmt::format("transforms.json has no name for a {} camera", camera_model_name(c.model)));
  }
}

}  // namespace

bool transforms_know(CameraModel model) {
  return model != CameraModel::kFov && model != CameraModel::kThinPrismFisheye &&
         model != CameraModel::kRadTanThinPrismFisheye;
}

void write_colmap_text(const std::filesystem::path& folder, std::span<const CameraOfPhoto> photos) {
  std::vector<Camera> cameras;
  std::string lines, images;
  for (size_t i = 0; i < photos.size(); ++i) {
    const CameraOfPhoto& photo = photos[i];
    const auto found = std::ranges::find_if(
        cameras, [&](const Camera& c) { return same_camera(c, photo.camera); });
    const size_t id = static_cast<size_t>(found - cameras.begin()) + 1;
    if (found == cameras.end()) {
      cameras.push_back(photo.camera);
      lines += camera_line(id, photo.camera);
    }
    const Pose from_world = photo.pose.inverse();
    const Eigen::Quaterniond q = quaternion(from_world.rotation);
    const Vec3d& t = from_world.translation;
    images += fmt::format("{} {} {} {} {} {} {} {} {} {}\n\n", i + 1, q.w(), q.x(), q.y(), q.z(),
                          t.x, t.y, t.z, id, photo.name);
  }
  make_writable_folder(folder);
  write_file_atomically(
      folder / "cameras.txt",
      fmt::format("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: {}\n{}",
                  cameras.size(), lines));
  write_file_atomically(
      folder / "images.txt",
      fmt::format("# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, "
                  "POINT3D_ID)\n# Number of images: {}\n{}",
                  photos.size(), images));
  write_file_atomically(folder / "points3D.txt",
                        "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, "
                        "POINT2D_IDX)\n# Number of points: 0\n");
}

void write_transforms(const std::filesystem::path& file, std::span<const CameraOfPhoto> photos) {
  Json frames = Json::array();
  for (const CameraOfPhoto& photo : photos) {
    const Camera& c = photo.camera;
    Json frame = {{"file_path", photo.file}, {"w", c.width}, {"h", c.height}};
    if (!is_panorama(c)) {
      frame["fl_x"] = c.fx();
      frame["fl_y"] = c.fy();
      frame["cx"] = c.cx();
      frame["cy"] = c.cy();
    }
    add_lens(c, frame);
    Json rows = Json::array();
    for (size_t i = 0; i < 3; ++i) {
      const auto& r = photo.pose.rotation.m[i];
      rows.push_back({r[0], -r[1], -r[2], photo.pose.translation[static_cast<int>(i)]});
    }
    rows.push_back({0.0, 0.0, 0.0, 1.0});
    frame["transform_matrix"] = rows;
    frames.push_back(std::move(frame));
  }
  write_file_atomically(
      file, Json{{"frames", frames}}.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace nerf
