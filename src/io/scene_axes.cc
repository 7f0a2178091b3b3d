// Focus of a capture, and the rotation that makes it level.
#include <Eigen/Dense>
#include <cmath>

#include "math/eigen_vectors.h"
#include "scene_frame.h"

namespace nerf::internal {
namespace {

Eigen::Vector3d axis(const View& view, int c) { return to_eigen(view.pose.rotation.column(c)); }

}  // namespace

std::optional<Vec3d> estimate_focus(const std::vector<View>& views) {
  if (views.empty()) return std::nullopt;
  std::vector<double> weights(views.size(), 1.0);
  Eigen::Vector3d focus = Eigen::Vector3d::Zero();
  std::vector<double> distance(views.size()), offset(views.size());
  for (int iteration = 0; iteration < 8; ++iteration) {
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
    Eigen::Vector3d rhs = Eigen::Vector3d::Zero();
    double total = 0;
    for (size_t i = 0; i < views.size(); ++i) {
      const Eigen::Vector3d d = axis(views[i], 2);
      const Eigen::Matrix3d p = Eigen::Matrix3d::Identity() - d * d.transpose();
      m += weights[i] * p;
      rhs += weights[i] * (p * to_eigen(views[i].pose.translation));
      total += weights[i];
    }
    m /= total;
    rhs /= total;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m);
    // The smallest eigenvalue is sin^2 of the axes' spread: below 6 degrees they are parallel.
    if (!(solver.eigenvalues()(0) > 0.011)) return std::nullopt;
    focus = solver.eigenvectors() *
            (solver.eigenvectors().transpose() * rhs).cwiseQuotient(solver.eigenvalues());

    for (size_t i = 0; i < views.size(); ++i) {
      const Eigen::Vector3d to_focus = focus - to_eigen(views[i].pose.translation);
      distance[i] = to_focus.dot(axis(views[i], 2));
      offset[i] = (to_focus - distance[i] * axis(views[i], 2)).norm();
    }
    std::vector<double> sorted = offset;
    std::nth_element(sorted.begin(),
                     sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2), sorted.end());
    const double typical = sorted[sorted.size() / 2];
    for (size_t i = 0; i < views.size(); ++i) {  // Huber: linear beyond the median
      weights[i] = offset[i] > typical ? typical / offset[i] : 1.0;
    }
    if (typical == 0) break;
  }
  // In front of nearly all cameras, and near the middle of most pictures (tan 20 degrees).
  size_t in_front = 0, central = 0;
  for (size_t i = 0; i < views.size(); ++i) {
    in_front += distance[i] > 0;
    central += distance[i] > 0 && offset[i] < 0.36 * distance[i];
  }
  if (10 * in_front < 9 * views.size() || 10 * central < 7 * views.size()) return std::nullopt;
  return from_eigen(focus);
}

Mat3d rotation_to_z(const Vec3d& up) {
  const Eigen::Matrix3d r =
      Eigen::Quaterniond::FromTwoVectors(to_eigen(up), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  Mat3d out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out.m[static_cast<size_t>(i)][static_cast<size_t>(j)] = r(i, j);
  return out;
}

}  // namespace nerf::internal
