// The table of COLMAP's camera models and what does not need a ray: names, intrinsics, rescaling.
#include <algorithm>
#include <cstddef>

#include "lens.h"
#include "nerf/base/error.h"
#include "nerf/math/camera.h"

namespace nerf {
namespace {

struct ModelRow {
  CameraModel model;
  std::string_view name;
  int params;
  int focals;  // 1: f, cx, cy, ...   2: fx, fy, cx, cy, ...
};

constexpr std::array<ModelRow, 13> kModels{{
    {CameraModel::kSimplePinhole, "SIMPLE_PINHOLE", 3, 1},
    {CameraModel::kPinhole, "PINHOLE", 4, 2},
    {CameraModel::kSimpleRadial, "SIMPLE_RADIAL", 4, 1},
    {CameraModel::kRadial, "RADIAL", 5, 1},
    {CameraModel::kOpenCV, "OPENCV", 8, 2},
    {CameraModel::kOpenCVFisheye, "OPENCV_FISHEYE", 8, 2},
    {CameraModel::kFullOpenCV, "FULL_OPENCV", 12, 2},
    {CameraModel::kFov, "FOV", 5, 2},
    {CameraModel::kSimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", 4, 1},
    {CameraModel::kRadialFisheye, "RADIAL_FISHEYE", 5, 1},
    {CameraModel::kThinPrismFisheye, "THIN_PRISM_FISHEYE", 12, 2},
    {CameraModel::kRadTanThinPrismFisheye, "RAD_TAN_THIN_PRISM_FISHEYE", 16, 2},
    {CameraModel::kEquirectangular, "EQUIRECTANGULAR", 5, 2},
}};

const ModelRow* find_row(int64_t id) {
  const auto it = std::ranges::find_if(
      kModels, [&](const ModelRow& r) { return static_cast<int32_t>(r.model) == id; });
  return it == kModels.end() ? nullptr : &*it;
}

const ModelRow& row(CameraModel model) {
  const ModelRow* found = find_row(static_cast<int32_t>(model));
  NERF_CHECK(found != nullptr);
  return *found;
}

// The model with two focal lengths that, with further coefficients zero, is the same lens.
CameraModel two_focal_model(CameraModel model) {
  switch (model) {
    case CameraModel::kSimplePinhole:
      return CameraModel::kPinhole;
    case CameraModel::kSimpleRadial:
    case CameraModel::kRadial:
      return CameraModel::kOpenCV;
    case CameraModel::kSimpleRadialFisheye:
    case CameraModel::kRadialFisheye:
      return CameraModel::kOpenCVFisheye;
    default:
      return model;
  }
}

}  // namespace

bool internal::has_one_focal(CameraModel model) { return row(model).focals == 1; }

std::string_view camera_model_name(CameraModel model) { return row(model).name; }
int camera_model_params(CameraModel model) { return row(model).params; }

std::optional<CameraModel> camera_model_from_id(int64_t id) {
  const ModelRow* found = find_row(id);
  return found ? std::optional(found->model) : std::nullopt;
}

std::optional<CameraModel> camera_model_from_name(std::string_view name) {
  const auto it = std::find_if(kModels.begin(), kModels.end(),
                               [&](const ModelRow& candidate) { return candidate.name == name; });
  if (it == kModels.end()) return std::nullopt;
  return it->model;
}

double Camera::fx() const { return params[0]; }
double Camera::fy() const { return row(model).focals == 2 ? params[1] : params[0]; }
double Camera::cx() const { return row(model).focals == 2 ? params[2] : params[1]; }
double Camera::cy() const { return row(model).focals == 2 ? params[3] : params[2]; }

// Distortion acts on the normalised image plane, which does not know about pixels: only focal
// lengths and the principal point change. With one focal length and ratios that differ, its
// coefficients move into the same places of the model with two (one to two radial ones, the
// tangential ones stay zero).
Camera Camera::scaled_to(int new_width, int new_height) const {
  NERF_CHECK_GT(width, 0);
  NERF_CHECK_GT(height, 0);
  NERF_CHECK_GT(new_width, 0);
  NERF_CHECK_GT(new_height, 0);
  const double sx = static_cast<double>(new_width) / width;
  const double sy = static_cast<double>(new_height) / height;

  Camera scaled = *this;
  scaled.width = new_width;
  scaled.height = new_height;
  if (row(model).focals == 2) {
    scaled.params[0] *= sx;
    scaled.params[1] *= sy;
    scaled.params[2] *= sx;
    scaled.params[3] *= sy;
    return scaled;
  }
  // Integer arithmetic: the ratios are equal exactly, not nearly.
  if (int64_t{new_width} * height == int64_t{new_height} * width) {
    scaled.params[0] *= sx;
    scaled.params[1] *= sx;
    scaled.params[2] *= sx;
    return scaled;
  }
  scaled.model = two_focal_model(model);
  scaled.params = {params[0] * sx, params[0] * sy, params[1] * sx, params[2] * sy};
  for (int i = 3; i < row(model).params; ++i) {
    scaled.params[static_cast<size_t>(i) + 1] = params[static_cast<size_t>(i)];
  }
  return scaled;
}

Camera Camera::rows(int first, int count) const {
  NERF_CHECK(first >= 0 && count > 0 && first + count <= height);
  Camera part = *this;
  part.height = count;
  part.params[row(model).focals == 2 ? 3 : 2] -= first;
  part.motion.along.y *= static_cast<double>(count) / height;
  part.motion.middle -= motion.along.y * first / height;
  return part;
}

Camera Camera::in_unit(double scale) const {
  Camera moved = *this;
  if (model == CameraModel::kEquirectangular) moved.params[4] *= scale;
  moved.motion.twist.translation = moved.motion.twist.translation * scale;
  return moved;
}

}  // namespace nerf
