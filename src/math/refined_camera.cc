#include "nerf/math/refined_camera.h"

#include <cmath>

#include "lens.h"
#include "rotation_series.h"

namespace nerf {

using internal::cosine_ratio;
using internal::has_one_focal;
using internal::sine_ratio;
using internal::turned_twice;

namespace {

// Index of k1 among the parameters, k2 behind it; 0 where the model has not both.
size_t radial_at(CameraModel model) {
  switch (model) {
    case CameraModel::kRadial:
    case CameraModel::kRadialFisheye:
      return 3;
    case CameraModel::kOpenCV:
    case CameraModel::kOpenCVFisheye:
    case CameraModel::kFullOpenCV:
    case CameraModel::kThinPrismFisheye:
    case CameraModel::kRadTanThinPrismFisheye:
      return 4;
    default:
      return 0;
  }
}

// The same lens in a model with k1 and k2.
Camera with_radial(Camera camera) {
  switch (camera.model) {
    case CameraModel::kSimplePinhole:
    case CameraModel::kSimpleRadial:
      camera.model = CameraModel::kRadial;
      break;
    case CameraModel::kPinhole:
      camera.model = CameraModel::kOpenCV;
      break;
    case CameraModel::kSimpleRadialFisheye:
      camera.model = CameraModel::kRadialFisheye;
      break;
    default:
      break;
  }
  return camera;  // parameters that the smaller model lacks are zero
}

// Gradient by (u, v) of something whose gradient by the unit direction is g.
Vec2d plane_gradient(const internal::Lens& lens, const Vec2d& uv, const Vec3d& direction,
                     const Vec3d& g) {
  if (!lens.fisheye) {
    const double n = std::sqrt(1 + uv.x * uv.x + uv.y * uv.y), along = dot(direction, g);
    return {(g.x - direction.x * along) / n, (g.y - direction.y * along) / n};
  }
  // (u k, v k, cos theta) with k = sin theta / theta; bend = (dk / d theta) / theta.
  const double theta2 = uv.x * uv.x + uv.y * uv.y;
  const double k = 1 - theta2 * sine_ratio(theta2);
  const double bend = sine_ratio(theta2) - cosine_ratio(theta2);
  const double along = bend * (g.x * uv.x + g.y * uv.y) - k * g.z;
  return {k * g.x + uv.x * along, k * g.y + uv.y * along};
}

}  // namespace

Mat3d rotation_by(const Vec3d& w) {
  const double x2 = dot(w, w), a = 1 - x2 * sine_ratio(x2), b = cosine_ratio(x2);
  Mat3d r;
  for (int c = 0; c < 3; ++c) {
    Vec3d e;
    e[c] = 1;
    r.set_column(c, e + cross(w, e) * a + turned_twice(w, e) * b);
  }
  return r;
}

Pose corrected(const Pose& pose, const PoseCorrection& c) {
  return {rotation_by(c.rotation) * pose.rotation, pose.translation + c.translation};
}

bool can_correct_lens(CameraModel model) {
  return model != CameraModel::kFov && model != CameraModel::kEquirectangular;
}

Camera corrected(const Camera& camera, const LensCorrection& c) {
  if (!can_correct_lens(camera.model)) return camera;
  Camera out = c.k1 != 0 || c.k2 != 0 ? with_radial(camera) : camera;
  const double fx = camera.fx(), fy = camera.fy(), factor = std::exp(c.focal);
  // As Camera::fy() and cx() read them: one focal length first, or two.
  const size_t centre = has_one_focal(camera.model) ? 1 : 2;
  for (size_t i = 0; i < centre; ++i) out.params[i] *= factor;
  out.params[centre] += c.centre.x * fx;
  out.params[centre + 1] += c.centre.y * fy;
  if (const size_t k = radial_at(out.model)) {
    out.params[k] += c.k1;
    out.params[k + 1] += c.k2;
  }
  return out;
}

// exp(w + dw) = exp(J(w) dw) exp(w) with the left Jacobian J of rotations, whose transpose is
// J(-w).
Vec3d rotation_gradient(const Vec3d& w, const Vec3d& torque) {
  const double x2 = dot(w, w);
  return torque - cross(w, torque) * cosine_ratio(x2) + turned_twice(w, torque) * sine_ratio(x2);
}

// The pixel stays: 0 = d pq + (the distortion's derivative by the parameter) + J d uv, with the
// sign of what moves on the side of the image. lambda = J^-T (gradient by uv).
std::array<double, LensCorrection::kParameters> lens_gradient(const Camera& refined,
                                                              const LensCorrection& correction,
                                                              const Vec3d& d, const Vec3d& g) {
  std::array<double, LensCorrection::kParameters> out{};
  if (!can_correct_lens(refined.model)) return out;
  const internal::Lens lens = internal::make_lens(refined);
  Vec2d uv;
  if (lens.fisheye) {
    const double rho = std::hypot(d.x, d.y), theta = std::atan2(rho, d.z);
    const double scale = rho > 0 ? theta / rho : 1;
    uv = {d.x * scale, d.y * scale};
  } else {
    if (!(d.z > 0)) return out;
    uv = {d.x / d.z, d.y / d.z};
  }
  const Vec2d by_uv = plane_gradient(lens, uv, d, g);
  const internal::Distorted at = internal::distort(lens, uv);
  const double det = at.det();
  if (!(det > 0)) return out;
  const Vec2d lambda{(by_uv.x * at.q.dv - by_uv.y * at.q.du) / det,
                     (by_uv.y * at.p.du - by_uv.x * at.p.dv) / det};
  out[0] = -(lambda.x * at.p.a + lambda.y * at.q.a);
  const double shift = std::exp(-correction.focal);
  out[1] = -lambda.x * shift;
  out[2] = -lambda.y * shift;
  const double s = uv.x * uv.x + uv.y * uv.y;
  const double below = internal::evaluate(lens.denominator, {s, 0, 0}).a;
  double power = s / below;
  for (size_t i = 3; i < 5; ++i, power *= s) {
    Vec2d moved{uv.x * power, uv.y * power};
    if (lens.after_radial) {
      // The tangential terms are of the radially distorted point, and move along.
      const double radial = internal::evaluate(lens.numerator, {s, 0, 0}).a / below;
      const internal::Dual p{uv.x * radial, 1, 0}, q{uv.y * radial, 0, 1};
      const internal::Distorted by = internal::with_tangential(lens, p, q, p, q);
      moved = {by.p.du * moved.x + by.p.dv * moved.y, by.q.du * moved.x + by.q.dv * moved.y};
    }
    out[i] = -(lambda.x * moved.x + lambda.y * moved.y);
  }
  return out;
}

}  // namespace nerf
