// nerfstudio's camera-path JSON.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numbers>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/text.h"
#include "nerf/io/camera_path.h"
#include "nerf/math/camera_paths.h"

namespace nerf {
namespace {

using Json = nlohmann::ordered_json;

constexpr uint64_t kMaxFileBytes = uint64_t{32} << 20;  // a frame takes 300 bytes and more
constexpr int kMaxSize = 16384;
// Rotations in files have been rounded; what is off by more was never a rotation.
constexpr double kRotationTolerance = 1e-3;
constexpr double kDegree = std::numbers::pi / 180;

Json parse(const std::string& text, const std::string& where) {
  try {
    return Json::parse(text);
  } catch (const Json::parse_error& error) {
    const size_t byte = error.byte > 0 ? error.byte - 1 : 0;
    throw Error("not valid JSON", where + ":" + line_and_column(text, byte),
                "export the camera path again, or correct the text at this line and column");
  } catch (const Json::exception&) {  // a number that no double can hold
    throw Error("holds a number that is out of range", where, "export the camera path again");
  }
}

// Reads entries of one object, naming `where` and the entry's path in every error.
class Entries {
 public:
  Entries(const Json& object, std::string where, std::string place)
      : object_(object), where_(std::move(where)), place_(std::move(place)) {
    if (!object_.is_object()) throw Error("expected an object", place_name(""));
  }

  bool has(const char* key) const {
    const auto it = object_.find(key);
    return it != object_.end() && !it->is_null();
  }

  const Json& required(const char* key) const {
    const auto it = object_.find(key);
    if (it == object_.end())
      throw Error("the entry is missing", place_name(key), "export the camera path again");
    return *it;
  }

  // A finite number within [low, high].
  double number(const char* key, double low, double high) const {
    return checked_number(required(key), place_name(key), low, high);
  }

  int size(const char* key) const {
    const double x = number(key, 1, kMaxSize);
    if (x != std::floor(x)) throw Error("expected whole pixels", place_name(key));
    return static_cast<int>(x);
  }

  std::string place_name(const std::string& key) const {
    std::string place = place_;
    if (!place.empty() && !key.empty()) place += '.';
    place += key;
    return place.empty() ? where_ : where_ + ": " + place;
  }

  static double checked_number(const Json& value, const std::string& place, double low,
                               double high) {
    if (!value.is_number()) throw Error("expected a number", place);
    const double x = value.get<double>();
    if (!std::isfinite(x) || x < low || x > high) {
      char text[120];
      std::snprintf(text, sizeof(text), "%.6g is outside the range from %.6g to %.6g", x, low,
                    high);
      throw Error(text, place);
    }
    return x;
  }

 private:
  const Json& object_;
  std::string where_, place_;
};

// Columns right, up, backward to right, down, forward and back: the same flip.
void flip_axes(Mat3d& rotation) {
  rotation.set_column(1, -rotation.column(1));
  rotation.set_column(2, -rotation.column(2));
}

Pose read_pose(const Entries& frame) {
  const Json& matrix = frame.required("camera_to_world");
  const std::string place = frame.place_name("camera_to_world");
  if (!matrix.is_array() || matrix.size() != 16)
    throw Error("expected 16 numbers, the rows of a 4x4 matrix", place);
  double m[16];
  for (size_t i = 0; i < 16; ++i)
    m[i] = Entries::checked_number(matrix[i], place + "[" + std::to_string(i) + "]", -1e9, 1e9);
  Pose pose;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) pose.rotation.m[r][c] = m[4 * r + c];
  pose.translation = {m[3], m[7], m[11]};
  if (m[12] != 0 || m[13] != 0 || m[14] != 0 || m[15] != 1)
    throw Error("the matrix's last row is not 0 0 0 1", place,
                "the matrix must be stored row by row");
  // A camera object scaled in its program scales all three axes.
  const double scale = length(pose.rotation.column(0));
  if (scale > 1e-9)
    for (int c = 0; c < 3; ++c) pose.rotation.set_column(c, pose.rotation.column(c) / scale);
  if (!(orthonormality_error(pose.rotation) <= kRotationTolerance))
    throw Error("the matrix's left 3x3 part is no rotation", place,
                "columns must be the camera's unit axes right, up and backward");
  flip_axes(pose.rotation);
  pose.rotation = orthonormalized(pose.rotation);
  return pose;
}

Camera make_camera(CameraModel model, int width, int height, double fov_degrees) {
  Camera camera;
  camera.model = model;
  camera.width = width;
  camera.height = height;
  const double focal = 0.5 * height / std::tan(0.5 * fov_degrees * kDegree);
  camera.params = {focal, focal, width * 0.5, height * 0.5};
  return camera;
}

struct CameraType {
  const char* name;  // nerfstudio's
  PictureKind picture;
  CameraModel model;
};
constexpr CameraType kCameraTypes[] = {
    {"perspective", PictureKind::kPerspective, CameraModel::kPinhole},
    {"fisheye", PictureKind::kPerspective, CameraModel::kOpenCVFisheye},
    {"equirectangular", PictureKind::kEquirectangular, CameraModel::kEquirectangular},
    {"omnidirectional", PictureKind::kOds, CameraModel::kEquirectangular},
    {"vr180", PictureKind::kVr180, CameraModel::kEquirectangular},
};

// Sets the path's kind of picture.
CameraModel read_camera_type(const Entries& root, CameraPath& path) {
  if (!root.has("camera_type")) return CameraModel::kPinhole;
  const Json& type = root.required("camera_type");
  if (!type.is_string()) throw Error("expected a text", root.place_name("camera_type"));
  for (const CameraType& known : kCameraTypes) {
    if (type != known.name) continue;
    path.picture = known.picture;
    return known.model;
  }
  path.notes.push_back("unknown camera_type '" + type.get<std::string>() +
                       "' is read as perspective");
  return CameraModel::kPinhole;
}

}  // namespace

CameraPath parse_camera_path(const std::string& json, const std::string& where,
                             const std::string& frame_prefix) {
  const Json document = parse(json, where);
  const Entries root(document, where, "");
  CameraPath path;
  const Json& frames = root.required("camera_path");
  if (!frames.is_array() || frames.empty())
    throw Error("expected a list of one frame or more", root.place_name("camera_path"),
                "add cameras to the path before exporting it");
  const int width = root.size("render_width"), height = root.size("render_height");
  const CameraModel model = read_camera_type(root, path);
  if (root.has("fps"))
    path.fps = root.number("fps", 1e-3, 1000);
  else if (root.has("seconds"))
    path.fps =
        std::min(static_cast<double>(frames.size()) / root.number("seconds", 1e-3, 1e9), 1000.0);
  if (root.has("crop")) path.notes.emplace_back("crop is not used: give the box with --bbox");

  for (size_t i = 0; i < frames.size(); ++i) {
    const Entries entry(frames[i], where, "camera_path[" + std::to_string(i) + "]");
    PathFrame frame;
    char number[32];
    std::snprintf(number, sizeof(number), "_%04zu", i);
    frame.name = frame_prefix + number;
    frame.camera_to_world = read_pose(entry);
    frame.camera = path.picture != PictureKind::kPerspective
                       ? panorama_of(path.picture, width, height)
                       : make_camera(model, width, height, entry.number("fov", 0.01, 179.9));
    if (entry.has("render_time")) frame.time = entry.number("render_time", 0, 1);
    path.frames.push_back(std::move(frame));
  }
  return path;
}

CameraPath read_camera_path(const std::filesystem::path& path) {
  return parse_camera_path(read_text_file(path, kMaxFileBytes), path.string(),
                           path.stem().string());
}

void write_camera_path(const std::filesystem::path& path, const CameraPath& camera_path) {
  if (camera_path.frames.empty()) throw Error("the camera path has no frames", path.string());
  const Camera& first = camera_path.frames.front().camera;
  Json root;
  root["camera_type"] = "perspective";
  for (const CameraType& type : kCameraTypes)
    if (type.picture == camera_path.picture && type.model == first.model)
      root["camera_type"] = type.name;
  root["render_width"] = first.width;
  root["render_height"] = first.height;
  root["fps"] = camera_path.fps;
  root["seconds"] = static_cast<double>(camera_path.frames.size()) / camera_path.fps;
  root["is_cycle"] = false;
  root["keyframes"] = Json::array();
  root["camera_path"] = Json::array();
  for (const PathFrame& frame : camera_path.frames) {
    if (frame.camera.width != first.width || frame.camera.height != first.height)
      throw Error("frames of different sizes cannot stand in one camera path", path.string());
    Mat3d rotation = frame.camera_to_world.rotation;
    flip_axes(rotation);
    const Vec3d& t = frame.camera_to_world.translation;
    Json matrix = Json::array();
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) matrix.push_back(rotation.m[r][c]);
      matrix.push_back(t[r]);
    }
    for (const double x : {0.0, 0.0, 0.0, 1.0}) matrix.push_back(x);
    Json entry;
    entry["camera_to_world"] = std::move(matrix);
    entry["fov"] = 2 * std::atan(0.5 * frame.camera.height / frame.camera.fy()) / kDegree;
    entry["aspect"] = static_cast<double>(frame.camera.width) / frame.camera.height;
    entry["render_time"] = frame.time;
    root["camera_path"].push_back(std::move(entry));
  }
  write_file_atomically(path, root.dump(1) + "\n");
}

}  // namespace nerf
