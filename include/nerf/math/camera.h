// Camera models of COLMAP (ids 0 to 11, and 17) and rays through pixels.
//
// Pixel coordinates: (0, 0) is the upper left corner of the image, the centre of pixel (i, j) is
// (i + 0.5, j + 0.5). Camera axes: x right, y down, z forward (COLMAP, OpenCV).
#pragma once

#include <array>
#include <cstdint>
#include <numbers>
#include <optional>
#include <span>
#include <string_view>

#include "nerf/math/twist.h"
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
  // fx, fy (pixels per radian), cx, cy, eye: see panorama(). COLMAP's files have w, h instead.
  kEquirectangular = 17,
};

inline constexpr int kMaxCameraParams = 16;

// Name as in cameras.txt ("SIMPLE_PINHOLE"), and its number of parameters.
std::string_view camera_model_name(CameraModel model);
int camera_model_params(CameraModel model);
std::optional<CameraModel> camera_model_from_id(int64_t id);
std::optional<CameraModel> camera_model_from_name(std::string_view name);

// How a camera moves while a picture's lines are read one after another (rolling shutter). At an
// image point the pose is the given one times exp(s twist), with s = x / width * along.x + y /
// height * along.y - middle: with the defaults rows are read from the top, and the given pose is
// that of the middle row.
struct LineMotion {
  Twist twist;  // while all lines are read; camera axes, radians and the pose's unit
  Vec2d along{0, 1};
  double middle = 0.5;
  bool any() const { return twist != Twist(); }
};

struct Camera {
  CameraModel model = CameraModel::kPinhole;
  int width = 0, height = 0;                      // pixels
  std::array<double, kMaxCameraParams> params{};  // in COLMAP's order, see CameraModel
  LineMotion motion = {};                         // none: all lines are read at once

  double fx() const;  // pixels; of a panorama pixels per radian
  double fy() const;
  double cx() const;
  double cy() const;

  // The same lens on an image of another size: x and y scaled by their own ratios. A model with one
  // focal length becomes the equivalent model with two where the ratios differ (see the .cc).
  Camera scaled_to(int new_width, int new_height) const;
  // The same lens on rows [first, first + count) of the image alone.
  Camera rows(int first, int count) const;
  // The same camera for poses in another unit, `scale` of which make one of the old.
  Camera in_unit(double scale) const;
};

// An equirectangular picture of so many radians of azimuth, with the forward axis in its middle,
// and of all elevations: pixel = (fx atan2(x, z) + cx, fy atan2(y, hypot(x, z)) + cy), as COLMAP 4
// and nerfstudio have it. The full sphere by default; pi is what VR180 shows.
Camera panorama(int width, int height, double azimuths = 2 * std::numbers::pi);

// Whether a camera looks all around, so that its pose says nothing of what it looks at and depth
// along its axis means nothing.
inline bool is_panorama(const Camera& camera) {
  return camera.model == CameraModel::kEquirectangular;
}

// Image point (pixels) of a direction in camera axes (any length, z may be <= 0 for fisheyes and
// panoramas). No value where the model does not see the direction.
std::optional<Vec2d> project(const Camera& camera, const Vec3d& direction);

// Direction in camera axes of an image point (pixels). Pinhole-like models return z = 1 (so that a
// distance along it is depth); fisheyes and panoramas return a unit vector. Inverts the distortion
// by Newton iterations to 1e-10; no value where that does not converge or lies beyond the lens's
// valid range.
std::optional<Vec3d> unproject(const Camera& camera, const Vec2d& pixel);

// Directions of the centres of successive pixels of row y, from column x on: unproject()'s, of unit
// length; zero where there is none.
void unproject_row(const Camera& camera, int x, int y, std::span<Vec3d> out);

// Radius at distance 1 of the cone that a pixel casts along its (normalised) ray: 2 / sqrt(12)
// times the mean distance to the rays of the next pixel to the right and below, so that the cone's
// variance is that of the square pixel (Barron et al. 2021, section 3). 0 where a neighbour has no
// ray.
double pixel_cone_radius(const Camera& camera, const Vec2d& pixel);

// The s of LineMotion at an image point (pixels), and the pose there.
double line_share(const Camera& camera, const Vec2d& pixel);
Pose line_pose(const Camera& camera, const Pose& camera_to_world, double share);

// `camera_to_world` while the line of the image point is read, moved to where the ray through the
// point begins. All rays of a line begin at the camera's centre, but for one eye of an
// omnidirectional stereo panorama (Peleg, Ben-Ezra and Pritch 2001), whose parameter `eye` is not
// 0: its rays begin so far (in the pose's unit) to the right of the centre, at right angles to
// their azimuth, level in camera axes. Below 0: to the left.
Pose ray_pose(const Camera& camera, const Pose& camera_to_world, const Vec2d& pixel);

// What turns distance along a ray into a picture's depth: the cosine between the ray (unit
// direction, camera axes) and the optical axis; 1 for panoramas.
inline double depth_per_distance(const Camera& camera, const Vec3d& direction) {
  return is_panorama(camera) ? 1 : direction.z;
}

// Solid angle of a pixel in row y against that of the picture's largest: the cosine of the
// elevation in a panorama; 1 for other cameras, whose pixels count alike.
double relative_solid_angle(const Camera& camera, double y);

}  // namespace nerf
