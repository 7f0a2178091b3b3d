// The arithmetic of lens models: all but FOV and panoramas as one.
//
// Notation: (u, v) a point of the undistorted plane: (x/z, y/z) of a pinhole-like model, or the
// direction's angle theta times the unit vector of (x, y) of a fisheye; s = u^2 + v^2; (p, q) the
// distorted point; pixel = (fx p + cx, fy q + cy).
#pragma once

#include <cstddef>

#include "nerf/math/camera.h"
#include "polynomial.h"

namespace nerf::internal {

// Whether a model has one focal length for both axes: f, cx, cy, ... in place of fx, fy, cx, cy.
bool has_one_focal(CameraModel model);

// All models but FOV as one: radial factor N(s) / D(s), then tangential and thin-prism terms, which
// model 11 computes from the radially distorted point and the others from (u, v).
struct Lens {
  double fx = 0, fy = 0, cx = 0, cy = 0;
  bool fisheye = false;
  bool distorted = false;
  Polynomial<7> numerator;
  Polynomial<4> denominator;
  double p1 = 0, p2 = 0;
  double prism[4] = {0, 0, 0, 0};
  bool after_radial = false;
};

inline Lens make_lens(const Camera& camera) {
  Lens lens;
  lens.fx = camera.fx();
  lens.fy = camera.fy();
  lens.cx = camera.cx();
  lens.cy = camera.cy();
  auto& n = lens.numerator;
  auto& d = lens.denominator;
  n.c[0] = d.c[0] = 1;
  const auto& k = camera.params;
  const auto radial = [&](size_t first, size_t count) {
    for (size_t i = 0; i < count; ++i) n.c[i + 1] = k[first + i];
  };
  switch (camera.model) {
    case CameraModel::kSimplePinhole:
    case CameraModel::kPinhole:
    case CameraModel::kFov:
    case CameraModel::kEquirectangular:  // panorama.cc
      break;
    case CameraModel::kSimpleRadialFisheye:
      lens.fisheye = true;
      [[fallthrough]];
    case CameraModel::kSimpleRadial:
      radial(3, 1);
      break;
    case CameraModel::kRadialFisheye:
      lens.fisheye = true;
      [[fallthrough]];
    case CameraModel::kRadial:
      radial(3, 2);
      break;
    case CameraModel::kOpenCVFisheye:
      lens.fisheye = true;
      radial(4, 4);
      break;
    case CameraModel::kFullOpenCV:
      n.c[3] = k[8];
      for (size_t i = 0; i < 3; ++i) d.c[i + 1] = k[9 + i];
      [[fallthrough]];
    case CameraModel::kOpenCV:
      radial(4, 2);
      lens.p1 = k[6];
      lens.p2 = k[7];
      break;
    case CameraModel::kThinPrismFisheye:
      lens.fisheye = true;
      radial(4, 2);
      lens.p1 = k[6];
      lens.p2 = k[7];
      n.c[3] = k[8];
      n.c[4] = k[9];
      lens.prism[0] = k[10];
      lens.prism[2] = k[11];
      break;
    case CameraModel::kRadTanThinPrismFisheye:
      lens.fisheye = true;
      lens.after_radial = true;
      radial(4, 6);
      lens.p2 = k[10];  // Aria's p0 is the coefficient of x (r^2 + 2 x^2), OpenCV's p2
      lens.p1 = k[11];
      for (size_t i = 0; i < 4; ++i) lens.prism[i] = k[12 + i];
      break;
  }
  n.size = n.c.size();
  d.size = d.c.size();
  n.trim();
  d.trim();
  lens.distorted = n.size > 1 || d.size > 1 || lens.p1 != 0 || lens.p2 != 0;
  for (double s : lens.prism) lens.distorted = lens.distorted || s != 0;
  return lens;
}

// A value with its derivatives by u and v: gives Newton's Jacobian from the formula itself.
struct Dual {
  double a, du, dv;
};
inline Dual operator+(const Dual& x, const Dual& y) {
  return {x.a + y.a, x.du + y.du, x.dv + y.dv};
}
inline Dual operator+(const Dual& x, double y) { return {x.a + y, x.du, x.dv}; }
inline Dual operator*(const Dual& x, const Dual& y) {
  return {x.a * y.a, x.a * y.du + x.du * y.a, x.a * y.dv + x.dv * y.a};
}
inline Dual operator*(double x, const Dual& y) { return {x * y.a, x * y.du, x * y.dv}; }
inline Dual operator/(const Dual& x, const Dual& y) {
  const double q = x.a / y.a;
  return {q, (x.du - q * y.du) / y.a, (x.dv - q * y.dv) / y.a};
}

template <size_t kCapacity>
Dual evaluate(const Polynomial<kCapacity>& poly, const Dual& s) {
  Dual r{0, 0, 0};
  for (size_t i = poly.size; i-- > 0;) r = r * s + poly.c[i];
  return r;
}

struct Distorted {
  Dual p, q;
  double det() const { return p.du * q.dv - p.dv * q.du; }
};

// The radially distorted point with the tangential and thin-prism terms of (x, y).
inline Distorted with_tangential(const Lens& lens, const Dual& p, const Dual& q, const Dual& x,
                                 const Dual& y) {
  const Dual xx = x * x, yy = y * y, xy = x * y;
  const Dual r2 = xx + yy, r4 = r2 * r2;
  Distorted out;
  out.p = p + 2 * lens.p1 * xy + lens.p2 * (r2 + 2 * xx) + lens.prism[0] * r2 + lens.prism[1] * r4;
  out.q = q + 2 * lens.p2 * xy + lens.p1 * (r2 + 2 * yy) + lens.prism[2] * r2 + lens.prism[3] * r4;
  return out;
}

inline Distorted distort(const Lens& lens, const Vec2d& uv) {
  const Dual u{uv.x, 1, 0}, v{uv.y, 0, 1};
  const Dual s = u * u + v * v;
  Dual radial = evaluate(lens.numerator, s);
  if (lens.denominator.size > 1) radial = radial / evaluate(lens.denominator, s);
  const Dual p = u * radial, q = v * radial;
  return lens.after_radial ? with_tangential(lens, p, q, p, q) : with_tangential(lens, p, q, u, v);
}

}  // namespace nerf::internal
