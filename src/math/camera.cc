// Projection and its inverse for all camera models. Formulas: COLMAP's src/colmap/sensor/models
// (ids 0 to 10 as published with COLMAP, Schoenberger and Frahm, CVPR 2016), OpenCV's calib3d
// documentation for the radial, tangential and thin-prism terms, Devernay and Faugeras 2001 for
// FOV, Project Aria's "FisheyeRadTanThinPrism" for id 11.
// Notation: that of lens.h.
#include "nerf/math/camera.h"

#include <cmath>
#include <numbers>

#include "lens.h"
#include "panorama.h"
#include "polynomial.h"
#include "wanted_pixels.h"

namespace nerf {
namespace {

constexpr double kPi = std::numbers::pi;

using internal::distort;
using internal::Distorted;
using internal::Lens;
using internal::make_lens;

// Whether the lens is one-to-one from the axis out to s = r^2: r N(s)/D(s) rises all the way,
// that is N D + 2 s (N' D - N D') > 0 and D > 0 on [0, s]. Beyond that a distortion folds back, and
// what it says there is an artefact of its polynomial.
bool radially_monotonic(const Lens& lens, double s) {
  if (lens.fisheye && !(s < kPi * kPi)) return false;
  const auto& n = lens.numerator;
  const auto& d = lens.denominator;
  if (d.size > 1 && !internal::positive_on(d, s)) return false;
  auto slope = internal::multiply<10>(n, d);
  const auto rise = internal::multiply<10>(internal::times_x_derivative(n), d);
  const auto fall = internal::multiply<10>(n, internal::times_x_derivative(d));
  for (size_t i = 0; i < slope.size; ++i) slope.c[i] += 2 * (rise.c[i] - fall.c[i]);
  return internal::positive_on(slope, s);
}

// Solves distort(uv) = target from *uv, all in the normalised plane.
bool newton(const Lens& lens, const Vec2d& target, Vec2d* uv) {
  const double scale = 1 + std::sqrt(target.x * target.x + target.y * target.y);
  const double least = 1e-14 * scale;
  Vec2d at = *uv;
  for (int iteration = 0; iteration < 40; ++iteration) {
    const Distorted d = distort(lens, at);
    const double fp = d.p.a - target.x, fq = d.q.a - target.y;
    const double det = d.det();
    if (!(det > 0)) return false;  // also when NaN
    const double du = (fp * d.q.dv - fq * d.p.dv) / det;
    const double dv = (fq * d.p.du - fp * d.q.du) / det;
    at.x -= du;
    at.y -= dv;
    if (!std::isfinite(at.x) || !std::isfinite(at.y)) return false;
    if (du * du + dv * dv <= least * least) {
      *uv = at;
      return true;
    }
  }
  // Rounding can keep the step above the bound near a fold: what counts is the residual.
  const Distorted d = distort(lens, at);
  if (!(std::hypot(d.p.a - target.x, d.q.a - target.y) <= 1e-11 * scale)) return false;
  *uv = at;
  return true;
}

// Where a lens is one-to-one. Remembers how far out it rises, for the pixels that follow.
class OneToOne {
 public:
  explicit OneToOne(const Lens& lens) : lens_(lens) {}
  bool at(const Vec2d& uv) {
    const double s = uv.x * uv.x + uv.y * uv.y;
    if (!(s <= rises_to_)) {
      if (!radially_monotonic(lens_, s)) return false;
      // A second pixel will not be the last.
      const bool further = rises_to_ >= 0 && radially_monotonic(lens_, 1.5 * s);
      rises_to_ = further ? 1.5 * s : s;
    }
    return distort(lens_, uv).det() > 0;
  }

 private:
  const Lens& lens_;
  double rises_to_ = -1;
};

std::optional<Vec2d> undistort(const Lens& lens, const Vec2d& target, OneToOne& one_to_one) {
  if (!lens.distorted) {
    if (lens.fisheye && !(std::hypot(target.x, target.y) < kPi)) return std::nullopt;
    return target;
  }
  Vec2d uv = target;
  if (newton(lens, target, &uv) && one_to_one.at(uv)) return uv;
  // Followed from the axis outwards, the solution stays on the branch that starts there.
  constexpr int kSteps = 32;
  uv = {0, 0};
  for (int i = 1; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    if (!newton(lens, {target.x * t, target.y * t}, &uv)) return std::nullopt;
  }
  if (!one_to_one.at(uv)) return std::nullopt;
  return uv;
}

// FOV: r_d = atan(2 r tan(w/2)) / w. Exact also for small w, where COLMAP switches to a series.
double fov_distorted_ratio(double omega, double r) {
  if (omega == 0) return 1;
  const double k = 2 * std::tan(omega / 2);
  return r * k < 1e-8 ? k / omega : std::atan(r * k) / (r * omega);
}
std::optional<double> fov_undistorted_ratio(double omega, double r) {
  if (omega == 0) return 1;
  if (!(r * omega < kPi / 2)) return std::nullopt;
  const double k = 2 * std::tan(omega / 2);
  return r * omega < 1e-8 ? omega / k : std::tan(r * omega) / (r * k);
}

bool usable(const Camera& camera, const Lens& lens) {
  for (int i = 0; i < camera_model_params(camera.model); ++i) {
    if (!std::isfinite(camera.params[static_cast<size_t>(i)])) return false;
  }
  if (camera.model == CameraModel::kFov && !(std::abs(camera.params[4]) < kPi)) return false;
  return lens.fx > 0 && lens.fy > 0;
}

bool finite(const Vec2d& v) { return std::isfinite(v.x) && std::isfinite(v.y); }
bool finite(const Vec3d& v) { return finite(Vec2d{v.x, v.y}) && std::isfinite(v.z); }

}  // namespace

std::optional<Vec2d> project(const Camera& camera, const Vec3d& direction) {
  if (is_panorama(camera)) return internal::project_panorama(camera, direction);
  const Lens lens = make_lens(camera);
  if (!usable(camera, lens) || !finite(direction)) return std::nullopt;
  Vec2d uv;
  if (lens.fisheye) {
    const double rho = std::hypot(direction.x, direction.y);
    const double theta = std::atan2(rho, direction.z);
    if (rho > 0) {
      uv = {direction.x / rho * theta, direction.y / rho * theta};
    } else if (!(direction.z > 0)) {
      return std::nullopt;  // zero, or straight back, which is a whole circle of the image
    }
  } else {
    if (!(direction.z > 0)) return std::nullopt;
    uv = {direction.x / direction.z, direction.y / direction.z};
  }
  if (!finite(uv)) return std::nullopt;

  Vec2d pq = uv;
  if (camera.model == CameraModel::kFov) {
    const double ratio = fov_distorted_ratio(std::abs(camera.params[4]), std::hypot(uv.x, uv.y));
    pq = {uv.x * ratio, uv.y * ratio};
  } else if (lens.distorted) {
    if (!OneToOne(lens).at(uv)) return std::nullopt;
    const Distorted d = distort(lens, uv);
    pq = {d.p.a, d.q.a};
  } else if (lens.fisheye && !(std::hypot(uv.x, uv.y) < kPi)) {
    return std::nullopt;
  }
  const Vec2d pixel{lens.fx * pq.x + lens.cx, lens.fy * pq.y + lens.cy};
  if (!finite(pixel)) return std::nullopt;
  return pixel;
}

namespace {

std::optional<Vec3d> unproject(const Camera& camera, const Lens& lens, const Vec2d& pixel,
                               OneToOne& one_to_one) {
  if (!finite(pixel)) return std::nullopt;
  const Vec2d pq{(pixel.x - lens.cx) / lens.fx, (pixel.y - lens.cy) / lens.fy};
  if (!finite(pq)) return std::nullopt;
  if (camera.model == CameraModel::kFov) {
    const auto ratio = fov_undistorted_ratio(std::abs(camera.params[4]), std::hypot(pq.x, pq.y));
    if (!ratio) return std::nullopt;
    return Vec3d{pq.x * *ratio, pq.y * *ratio, 1};
  }
  const auto uv = undistort(lens, pq, one_to_one);
  if (!uv) return std::nullopt;
  if (!lens.fisheye) return Vec3d{uv->x, uv->y, 1};
  const double theta = std::hypot(uv->x, uv->y);
  const double k = theta > 0 ? std::sin(theta) / theta : 1;
  return Vec3d{uv->x * k, uv->y * k, std::cos(theta)};
}

}  // namespace

std::optional<Vec3d> unproject(const Camera& camera, const Vec2d& pixel) {
  if (is_panorama(camera)) return internal::unproject_panorama(camera, pixel);
  const Lens lens = make_lens(camera);
  OneToOne one_to_one(lens);
  return usable(camera, lens) ? unproject(camera, lens, pixel, one_to_one) : std::nullopt;
}

void unproject_row(const Camera& camera, int x, int y, std::span<Vec3d> out) {
  internal::unproject_wanted(camera, x, y, nullptr, out);
}

void internal::unproject_wanted(const Camera& camera, int x, int y, const uint8_t* wanted,
                                std::span<Vec3d> out) {
  const Lens lens = make_lens(camera);
  const bool around = is_panorama(camera), seen = usable(camera, lens);
  OneToOne one_to_one(lens);
  for (size_t i = 0; i < out.size(); ++i) {
    out[i] = Vec3d();
    if (wanted && !wanted[i]) continue;
    const Vec2d pixel{x + static_cast<double>(i) + 0.5, y + 0.5};
    const auto d = around ? internal::unproject_panorama(camera, pixel)
                   : seen ? unproject(camera, lens, pixel, one_to_one)
                          : std::nullopt;
    if (d) out[i] = normalized(*d);
  }
}

double line_share(const Camera& camera, const Vec2d& pixel) {
  const LineMotion& m = camera.motion;
  return pixel.x / camera.width * m.along.x + pixel.y / camera.height * m.along.y - m.middle;
}

Pose line_pose(const Camera& camera, const Pose& pose, double share) {
  return camera.motion.any() ? moved(pose, motion_by(camera.motion.twist * share)) : pose;
}

double pixel_cone_radius(const Camera& camera, const Vec2d& pixel) {
  if (is_panorama(camera)) return internal::panorama_cone_radius(camera, pixel);
  const auto here = unproject(camera, pixel);
  const auto right = unproject(camera, {pixel.x + 1, pixel.y});
  const auto below = unproject(camera, {pixel.x, pixel.y + 1});
  if (!here || !right || !below) return 0;
  const double apart = 0.5 * (length(*right - *here) + length(*below - *here));
  return apart / length(*here) * 2 / std::sqrt(12.0);
}

}  // namespace nerf
