#include "scene_planes.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "nerf/math/camera_paths.h"
#include "nerf/math/random.h"

namespace nerf::internal {
namespace {

constexpr size_t kMostPoints = 4000;
constexpr size_t kFewestPoints = 60;
constexpr double kOutside = 4;        // radii from the middle: background and strays
constexpr double kThickness = 0.02;   // radii; half of what counts as one plane
constexpr double kLeastShare = 0.05;  // of all points
constexpr double kLeastWidth = 0.04;  // of its length, both squared: no line
constexpr int kTrials = 3000;
// A plane is this many times denser than the layers on its sides.
constexpr double kLeastContrast = 3;

// How many points lie in a layer from `from` to `to` along a normal, by the unit of thickness.
double layer(const std::vector<Eigen::Vector3d>& points, const Eigen::Vector3d& normal,
             double offset, double from, double to) {
  int64_t count = 0;
  for (const Eigen::Vector3d& p : points) {
    const double d = normal.dot(p) - offset;
    count += d >= from && d <= to;
  }
  return static_cast<double>(count) / (to - from);
}

}  // namespace

PointCloudShape::PointCloudShape(const std::vector<ScenePoint>& points) {
  std::array<std::vector<double>, 3> along;
  for (const ScenePoint& p : points) {
    if (!std::isfinite(dot(p.position, p.position))) continue;
    for (int k = 0; k < 3; ++k) along[static_cast<size_t>(k)].push_back(p.position[k]);
  }
  if (along[0].size() < kFewestPoints) return;
  const Eigen::Vector3d middle(quantile(along[0], 0.5), quantile(along[1], 0.5),
                               quantile(along[2], 0.5));
  std::vector<double> distances;
  for (size_t i = 0; i < along[0].size(); ++i)
    distances.push_back((Eigen::Vector3d(along[0][i], along[1][i], along[2][i]) - middle).norm());
  radius_ = quantile(distances, 0.5);
  const size_t stride = (distances.size() + kMostPoints - 1) / kMostPoints;
  for (size_t i = 0; i < distances.size(); i += stride)
    if (distances[i] <= kOutside * radius_)  // from the middle, so that far worlds lose no digits
      points_.push_back(Eigen::Vector3d(along[0][i], along[1][i], along[2][i]));
}

std::optional<PointCloudShape::Plane> PointCloudShape::largest_plane(
    const std::function<bool(const Eigen::Vector3d&)>& admitted,
    const std::vector<Eigen::Vector3d>& cameras) const {
  if (points_.size() < kFewestPoints || !(radius_ > 0)) return std::nullopt;
  const double thickness = kThickness * radius_;
  size_t best_count = 0;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  double offset = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    Random random(0, 0, static_cast<uint64_t>(trial));
    const Eigen::Vector3d& a = points_[random.below(points_.size())];
    const Eigen::Vector3d& b = points_[random.below(points_.size())];
    const Eigen::Vector3d& c = points_[random.below(points_.size())];
    Eigen::Vector3d n = (b - a).cross(c - a);
    if (!(n.norm() > 1e-2 * radius_ * radius_)) continue;  // a sliver fixes no direction
    n.normalize();
    if (!admitted(n)) continue;
    size_t count = 0;
    for (const Eigen::Vector3d& p : points_) count += std::abs(n.dot(p - a)) <= thickness;
    if (count > best_count) {
      best_count = count;
      normal = n;
      offset = n.dot(a);
    }
  }
  if (best_count == 0) return std::nullopt;
  for (int iteration = 0; iteration < 3; ++iteration) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    double count = 0;
    for (const Eigen::Vector3d& p : points_) {
      if (std::abs(normal.dot(p) - offset) > thickness) continue;
      mean += p;
      ++count;
    }
    if (count < 3) return std::nullopt;
    mean /= count;
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& p : points_)
      if (std::abs(normal.dot(p) - offset) <= thickness) m += (p - mean) * (p - mean).transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m);
    if (!(solver.eigenvalues()(1) > kLeastWidth * solver.eigenvalues()(2))) return std::nullopt;
    normal = solver.eigenvectors().col(0);
    offset = normal.dot(mean);
  }
  if (!admitted(normal)) return std::nullopt;

  Plane plane;
  plane.normal = normal;
  double near_side = 0;
  for (const Eigen::Vector3d& c : cameras) near_side += normal.dot(c) > offset;
  plane.cameras = near_side / static_cast<double>(std::max<size_t>(1, cameras.size()));
  if (plane.cameras < 0.5) {
    plane.normal = normal = -normal;
    offset = -offset;
    plane.cameras = 1 - plane.cameras;
  }
  const auto all = static_cast<double>(points_.size());
  const double on_it = layer(points_, normal, offset, -thickness, thickness);
  const double beside = 0.5 * (layer(points_, normal, offset, 2 * thickness, 5 * thickness) +
                               layer(points_, normal, offset, -5 * thickness, -2 * thickness));
  plane.share = on_it * 2 * thickness / all;
  plane.beyond = layer(points_, normal, offset, -1e3 * radius_, -3 * thickness) *
                 (1e3 * radius_ - 3 * thickness) / all;
  if (plane.share < kLeastShare || on_it < kLeastContrast * beside) return std::nullopt;
  return plane;
}

}  // namespace nerf::internal
