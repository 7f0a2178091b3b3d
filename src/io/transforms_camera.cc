// Conventions: nerfstudio's data format (docs, "Data conventions") and instant-ngp's nerf_loader:
// pixel coordinates and distortion as OpenCV's, the principal point with pixel centres at 0.5. An
// equirectangular picture is nerfstudio's EQUIRECTANGULAR and instant-ngp's "latlong" (its
// "equirectangular" is a cylindrical equal-area projection).
#include "transforms_camera.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "colmap.h"
#include "lenient_json.h"
#include "scene_limits.h"

namespace nerf::internal {

using nlohmann::json;

const json* FrameJson::find(const char* key) const {
  for (const json* object : {&frame, &common}) {
    const auto it = object->find(key);
    if (it != object->end() && !it->is_null()) return &*it;
  }
  return nullptr;
}

std::optional<double> FrameJson::number(const char* key) const {
  const json* value = find(key);
  if (value == nullptr) return std::nullopt;
  if (is_not_finite(*value)) {
    // A frame's own number is wrong for that frame alone, the file's for all.
    const std::string what = fmt::format("\"{}\" is not finite", key);
    if (frame.contains(key) && !frame[key].is_null()) throw NotFinite(what, where);
    fail(what);
  }
  if (!value->is_number()) fail(fmt::format("\"{}\" is not a number", key));
  return value->get<double>();
}

std::string FrameJson::text(const char* key) const {
  const json* value = find(key);
  if (value == nullptr) return {};
  if (!value->is_string()) fail(fmt::format("\"{}\" is not text", key));
  return value->get<std::string>();
}

bool FrameJson::flag(const char* key) const {
  const json* value = find(key);
  if (value == nullptr) return false;
  return value->is_boolean() ? value->get<bool>() : number(key).value_or(0) != 0;
}

void FrameJson::fail(const std::string& what, const std::string& hint) const {
  throw Error(what, where, hint);
}

FrameSize frame_size(const FrameJson& frame) {
  const auto w = frame.number("w"), h = frame.number("h");
  if (!w || !h) return {};
  if (!(*w >= 1 && *h >= 1 && *w <= kMaxImageSide && *h <= kMaxImageSide)) {
    frame.fail(fmt::format("\"w\" and \"h\" are {} and {}", *w, *h), kImageSizeHint);
  }
  return {static_cast<int>(std::lround(*w)), static_cast<int>(std::lround(*h))};
}

namespace {

enum class LensKind { kPerspective, kFullOpenCV, kFisheye, kPanorama };

LensKind lens_kind(const FrameJson& frame) {
  for (const char* key : {"ftheta_p0", "equirectangular"}) {
    if (frame.find(key) != nullptr && (key[0] == 'f' || frame.flag(key))) {
      frame.fail(fmt::format("the lens that \"{}\" describes is not supported", key),
                 "perspective, OPENCV_FISHEYE and EQUIRECTANGULAR ones are; undistort the images");
    }
  }
  const std::string model = frame.text("camera_model");
  if (model == "EQUIRECTANGULAR" || model == "SPHERICAL" || frame.flag("latlong"))
    return LensKind::kPanorama;
  if (model == "FULL_OPENCV") return LensKind::kFullOpenCV;
  for (const char* known : {"OPENCV_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_RADIAL_FISHEYE"}) {
    if (model == known) return LensKind::kFisheye;
  }
  for (const char* known : {"", "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"}) {
    if (model == known)
      return frame.flag("is_fisheye") ? LensKind::kFisheye : LensKind::kPerspective;
  }
  frame.fail(fmt::format("camera_model {} is not supported", printable(model)),
             "known: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, "
             "SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, OPENCV_FISHEYE, EQUIRECTANGULAR; undistort "
             "the images");
}

// Focal length of one axis: given, or from the field of view over the image's side.
std::optional<double> focal(const FrameJson& frame, const char* length, const char* angle,
                            const char* degrees, int side) {
  if (const auto value = frame.number(length)) return value;
  auto fov = frame.number(angle);
  if (!fov) {
    fov = frame.number(degrees);
    if (fov) *fov *= std::numbers::pi / 180;
  }
  if (!fov) return std::nullopt;
  if (!(*fov > 0 && *fov < std::numbers::pi)) {
    frame.fail(fmt::format("\"{}\" is {} radians", angle, *fov),
               "a field of view lies between 0 and pi");
  }
  return 0.5 * side / std::tan(0.5 * *fov);
}

// The whole sphere, whatever the file says of a focal length: programs write half of the width,
// the height, or a number that means nothing.
Camera panorama_camera(const FrameJson& frame, const FrameSize& size, std::string* warning) {
  for (const char* key : {"k1", "k2", "k3", "k4", "p1", "p2"})
    if (frame.number(key).value_or(0) != 0)
      *warning = "the distortion of EQUIRECTANGULAR pictures is not used";
  const auto off = [&](const char* key, int side) {
    return std::abs(frame.number(key).value_or(0.5 * side) - 0.5 * side) > 1;
  };
  if (off("cx", size.width) || off("cy", size.height))
    *warning = "cx and cy of EQUIRECTANGULAR pictures are not used: forward is in the middle";
  const Camera camera = panorama(size.width, size.height);
  if (const auto problem = camera_problem(camera)) frame.fail("the camera " + *problem);
  return camera;
}

}  // namespace

Camera frame_camera(const FrameJson& frame, const FrameSize& size, std::string* warning) {
  const LensKind kind = lens_kind(frame);
  if (kind == LensKind::kPanorama) return panorama_camera(frame, size, warning);
  auto fx = focal(frame, "fl_x", "camera_angle_x", "x_fov", size.width);
  auto fy = focal(frame, "fl_y", "camera_angle_y", "y_fov", size.height);
  if (!fx) fx = fy;
  if (!fy) fy = fx;
  if (!fx) {
    frame.fail(
        "there is no focal length",
        "give fl_x (pixels) or camera_angle_x (radians), in the frame or for the whole file");
  }
  const auto value = [&](const char* key) { return frame.number(key).value_or(0); };
  const double cx = frame.number("cx").value_or(size.width / 2.0);
  const double cy = frame.number("cy").value_or(size.height / 2.0);
  const double k1 = value("k1"), k2 = value("k2"), k3 = value("k3"), k4 = value("k4");
  const double p1 = value("p1"), p2 = value("p2");

  Camera camera;
  camera.width = size.width;
  camera.height = size.height;
  if (kind == LensKind::kFisheye) {
    camera.model = CameraModel::kOpenCVFisheye;
    camera.params = {*fx, *fy, cx, cy, k1, k2, k3, k4};
    if (p1 != 0 || p2 != 0) *warning = "p1 and p2 of a fisheye lens are not used";
  } else if (kind == LensKind::kFullOpenCV) {
    camera.model = CameraModel::kFullOpenCV;
    camera.params = {*fx, *fy, cx, cy, k1, k2, p1, p2, k3, k4, value("k5"), value("k6")};
  } else if (k3 != 0) {
    camera.model = CameraModel::kFullOpenCV;
    camera.params = {*fx, *fy, cx, cy, k1, k2, p1, p2, k3, 0, 0, 0};
  } else if (k1 != 0 || k2 != 0 || p1 != 0 || p2 != 0) {
    camera.model = CameraModel::kOpenCV;
    camera.params = {*fx, *fy, cx, cy, k1, k2, p1, p2};
  } else {
    camera.model = CameraModel::kPinhole;
    camera.params = {*fx, *fy, cx, cy};
  }
  // Programs disagree on whether a perspective k4 is the factor of r^8 or OpenCV's denominator.
  if (kind == LensKind::kPerspective && k4 != 0) {
    *warning = "k4 of a perspective lens is not used (camera_model FULL_OPENCV would say how)";
  }
  if (const auto problem = camera_problem(camera)) {
    frame.fail("the camera " + *problem, kImageSizeHint);
  }
  return camera;
}

}  // namespace nerf::internal
