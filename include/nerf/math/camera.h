// Camera models of COLMAP (ids 0 to 11) and rays through pixels.
//
// Pixel coordinates: (0, 0) is the upper left corner of the image, the centre of pixel (i, j) is
// (i + 0.5, j + 0.5). Camera axes: x right, y down, z forward (COLMAP, OpenCV).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "nerf/math/vec.h"

namespace nerf {

// Ids as COLMAP writes them into cameras.bin.
enum class CameraModel : int32_t {
  kSimplePinhole = 0,            // f, cx, cy
  kPinhole = 1,                  // fx, fy, cx, cy
  kSimpleRadial = 2,             // f, cx, cy, k
  kRadial = 3,                   // f, cx, cy, k1, k2
  kOpenCV = 4,                   // fx, fy, cx, cy, k1, k2, p1, p2
  kOpenCVFisheye = 5,            // fx, fy, cx, cy, k1, k2, k3, k4
  kFullOpenCV = 6,               // fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6
  kFov = 7,                      // fx, fy, cx, cy, omega
  kSimpleRadialFisheye = 8,      // f, cx, cy, k
  kRadialFisheye = 9,            // f, cx, cy, k1, k2
  kThinPrismFisheye = 10,        // fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx1, sy1
  kRadTanThinPrismFisheye = 11,  // fx, fy, cx, cy, k0..k5, p0, p1, s0..s3
};

inline constexpr int kMaxCameraParams = 16;

// Name as in cameras.txt ("SIMPLE_PINHOLE"), and its number of parameters.
std::string_view camera_model_name(CameraModel model);
int camera_model_params(CameraModel model);
std::optional<CameraModel> camera_model_from_id(int64_t id);
std::optional<CameraModel> camera_model_from_name(std::string_view name);

struct Camera {
  CameraModel model = CameraModel::kPinhole;
  int width = 0, height = 0;                      // pixels
  std::array<double, kMaxCameraParams> params{};  // in COLMAP's order, see CameraModel

  double fx() const;
  double fy() const;
  double cx() const;
  double cy() const;

  // The same lens on an image of another size: x and y scaled by their own ratios. A model with one
  // focal length becomes the equivalent model with two where the ratios differ (see the .cc).
  Camera scaled_to(int new_width, int new_height) const;
  // The same lens on rows [first, first + count) of the image alone.
  Camera rows(int first, int count) const;
};

// Image point (pixels) of a direction in camera axes (any length, z may be <= 0 for fisheyes). No
// value where the model does not see the direction.
std::optional<Vec2d> project(const Camera& camera, const Vec3d& direction);

// Direction in camera axes of an image point (pixels). Pinhole-like models return z = 1 (so that a
// distance along it is depth); fisheyes return a unit vector. Inverts the distortion by Newton
// iterations to 1e-10; no value where that does not converge or lies beyond the lens's valid range.
std::optional<Vec3d> unproject(const Camera& camera, const Vec2d& pixel);

// Directions of the centres of successive pixels of row y, from column x on: unproject()'s, of unit
// length; zero where there is none.
void unproject_row(const Camera& camera, int x, int y, std::span<Vec3d> out);

// Radius at distance 1 of the cone that a pixel casts along its (normalised) ray: 2 / sqrt(12)
// times the mean distance to the rays of the next pixel to the right and below, so that the cone's
// variance is that of the square pixel (Barron et al. 2021, section 3). 0 where a neighbour has no
// ray.
double pixel_cone_radius(const Camera& camera, const Vec2d& pixel);

}  // namespace nerf
