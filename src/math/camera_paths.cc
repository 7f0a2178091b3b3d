#include "nerf/math/camera_paths.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "nerf/base/error.h"

namespace nerf {
namespace {

constexpr double kTwoPi = 2 * std::numbers::pi;

// Mean squared sine of the axes' spread below which where they meet is a guess.
constexpr double kLeastSpread = 0.01;

}  // namespace

double orthonormality_error(const Mat3d& r) {
  const Mat3d product = r * r.transposed();
  double worst = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      const double error = std::abs(product.m[i][j] - (i == j ? 1.0 : 0.0));
      if (!(error <= worst)) worst = error;  // not-a-number sticks
    }
  const double determinant = dot(cross(r.column(0), r.column(1)), r.column(2));
  return determinant > 0 && std::isfinite(worst) ? worst : std::numeric_limits<double>::infinity();
}

Mat3d orthonormalized(const Mat3d& nearly) {
  const Vec3d z = normalized(nearly.column(2));
  const Vec3d y = normalized(nearly.column(1) - z * dot(nearly.column(1), z));
  Mat3d r;
  r.set_column(0, cross(y, z));
  r.set_column(1, y);
  r.set_column(2, z);
  return r;
}

Mat3d look_rotation(const Vec3d& forward, const Vec3d& up) {
  const Vec3d z = normalized(forward);
  Vec3d x = cross(z, normalized(up));
  if (length(x) < 1e-9) {  // straight up or down: level whatever x is
    const Vec3d axis = std::abs(z.x) < 0.5 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
    x = axis - z * dot(axis, z);
  }
  x = normalized(x);
  Mat3d r;
  r.set_column(0, x);
  r.set_column(1, cross(z, x));
  r.set_column(2, z);
  return r;
}

std::optional<Vec3d> nearest_point_to_axes(std::span<const Pose> cameras) {
  // The normal equations of sum |(1 - d d^T)(p - o)|^2, origins taken from their mean so that no
  // digits are lost where the world's origin is far away.
  Vec3d mean;
  for (const Pose& c : cameras) mean = mean + c.translation;
  mean = mean / std::max<double>(1, static_cast<double>(cameras.size()));
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const Pose& c : cameras) {
    const Vec3d f = normalized(c.rotation.column(2));
    const Vec3d offset = c.translation - mean;
    const Eigen::Vector3d d(f.x, f.y, f.z), o(offset.x, offset.y, offset.z);
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - d * d.transpose();
    a += across;
    b += across * o;
  }
  if (cameras.size() < 2) return std::nullopt;
  a /= static_cast<double>(cameras.size());
  b /= static_cast<double>(cameras.size());
  if (!a.allFinite() || !b.allFinite()) return std::nullopt;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(a, Eigen::EigenvaluesOnly);
  if (!(eigen.eigenvalues()(0) >= kLeastSpread)) return std::nullopt;
  const Eigen::Vector3d p = a.ldlt().solve(b);
  return mean + Vec3d{p.x(), p.y(), p.z()};
}

double quantile(std::vector<double> values, double q) {
  NERF_CHECK(!values.empty());
  std::sort(values.begin(), values.end());
  const double place = std::clamp(q, 0.0, 1.0) * static_cast<double>(values.size() - 1);
  const auto below = static_cast<size_t>(place);
  const size_t next = std::min(below + 1, values.size() - 1);
  return values[below] + (values[next] - values[below]) * (place - static_cast<double>(below));
}

Arc covered_arc(std::vector<double> azimuths, double max_gap) {
  if (azimuths.empty()) return {true, 0, std::numbers::pi};
  for (double& a : azimuths) a -= kTwoPi * std::floor(a / kTwoPi);
  std::sort(azimuths.begin(), azimuths.end());
  // The gap from the last one around to the first, then those between neighbours.
  double gap = azimuths.front() + kTwoPi - azimuths.back();
  double start = azimuths.front();
  for (size_t i = 0; i + 1 < azimuths.size(); ++i)
    if (azimuths[i + 1] - azimuths[i] > gap) {
      gap = azimuths[i + 1] - azimuths[i];
      start = azimuths[i + 1];
    }
  if (gap < max_gap) return {true, start, std::numbers::pi};
  const double half = (kTwoPi - gap) / 2;
  return {false, start + half, half};
}

std::vector<double> constant_speed_parameters(const PoseCurve& curve, int count, bool closed) {
  std::vector<double> parameters;
  if (count <= 0) return parameters;
  // Lengths of a polyline with so many pieces that a frame takes several.
  const int pieces = std::clamp(count * 8, 1024, 1 << 20);
  std::vector<double> distance(static_cast<size_t>(pieces) + 1, 0.0);
  Pose before = curve.at(0);
  for (int i = 1; i <= pieces; ++i) {
    const Pose now = curve.at(static_cast<double>(i) / pieces);
    const double moved = length(now.translation - before.translation);
    const double turned = curve.turn_weight > 0
                              ? curve.turn_weight * rotation_angle(before.rotation, now.rotation)
                              : 0.0;
    distance[i] = distance[i - 1] + std::sqrt(moved * moved + turned * turned);
    before = now;
  }
  const double total = distance.back();
  const int steps = closed ? count : std::max(1, count - 1);
  int piece = 0;
  for (int k = 0; k < count; ++k) {
    const double share = static_cast<double>(k) / steps;
    if (!(total > 0)) {
      parameters.push_back(share);
      continue;
    }
    while (piece + 1 < pieces && distance[piece + 1] < share * total) ++piece;
    const double span = distance[piece + 1] - distance[piece];
    const double within = span > 0 ? (share * total - distance[piece]) / span : 0.0;
    parameters.push_back((piece + std::clamp(within, 0.0, 1.0)) / pieces);
  }
  return parameters;
}

}  // namespace nerf
