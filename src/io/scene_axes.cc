// Up direction and focus of a capture.
#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include "nerf/math/camera_paths.h"
#include "scene_frame.h"

namespace nerf::internal {
namespace {

Eigen::Vector3d to_eigen(const Vec3d& v) { return {v.x, v.y, v.z}; }
Vec3d from_eigen(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

Eigen::Vector3d axis(const View& view, int c) { return to_eigen(view.pose.rotation.column(c)); }

Eigen::Vector3d mean_axis(const std::vector<View>& views, int c) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const View& view : views) sum += axis(view, c);
  return sum / static_cast<double>(views.size());
}

// The direction most nearly perpendicular to axis c of all cameras, near `prior` where that leaves
// it open.
Eigen::Vector3d level_up(const std::vector<View>& views, int c, const Eigen::Vector3d& prior) {
  constexpr double kPriorWeight = 0.02;  // of all axes pointing the wrong way together
  Eigen::Matrix3d m = kPriorWeight * (Eigen::Matrix3d::Identity() - prior * prior.transpose());
  for (const View& view : views) {
    const Eigen::Vector3d a = axis(view, c);
    m += a * a.transpose() / static_cast<double>(views.size());
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m);
  const Eigen::Vector3d up = solver.eigenvectors().col(0);
  return up.dot(prior) < 0 ? Eigen::Vector3d(-up) : up;
}

// Normal of the plane that a closed ring of cameras stands on, towards `up`; nothing where they do
// not stand on one.
std::optional<Eigen::Vector3d> ring_normal(const std::vector<View>& views,
                                           const Eigen::Vector3d& up) {
  if (views.size() < 8) return std::nullopt;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const View& view : views) mean += to_eigen(view.pose.translation);
  mean /= static_cast<double>(views.size());
  Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
  for (const View& view : views) {
    const Eigen::Vector3d d = to_eigen(view.pose.translation) - mean;
    m += d * d.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m);
  const Eigen::Vector3d& variance = solver.eigenvalues();
  // Flat to 1/20 of its width, and about as wide as long.
  if (!(variance(0) < variance(1) / 400 && variance(1) > variance(2) / 4)) return std::nullopt;
  std::vector<double> angles;
  for (const View& view : views) {
    const Eigen::Vector3d d = to_eigen(view.pose.translation) - mean;
    angles.push_back(
        std::atan2(d.dot(solver.eigenvectors().col(1)), d.dot(solver.eigenvectors().col(2))));
  }
  if (!covered_arc(angles, std::numbers::pi / 2).full) return std::nullopt;
  Eigen::Vector3d normal = solver.eigenvectors().col(0);
  if (normal.dot(up) < 0) normal = -normal;
  // A ring on a slope is a ring as well: only a small correction is believable.
  if (normal.dot(up) < std::cos(10 * std::numbers::pi / 180)) return std::nullopt;
  return normal;
}

}  // namespace

Vec3d estimate_up(const std::vector<View>& views, std::vector<std::string>& warnings) {
  const Eigen::Vector3d own_up = -mean_axis(views, 1), own_right = mean_axis(views, 0);
  // Photos stored on their side: the cameras' x axes agree like nothing but up and down do, while
  // their y axes go round. Which end is up cannot be told from that.
  if (own_up.norm() < 0.3 && own_right.norm() > 0.7) {
    warnings.push_back(
        "the photos seem to lie on a side: up is a guess and may be down (--up x,y,z sets it)");
    return from_eigen(level_up(views, 1, own_right.normalized()));
  }
  const Eigen::Vector3d forward = mean_axis(views, 2);
  Eigen::Vector3d prior(0, 0, 1);
  if (own_up.norm() < 0.3 && forward.norm() > 0.7) {
    prior = -forward.normalized();  // flown over ground, looking down and turning
  } else if (own_up.norm() > 1e-6) {
    prior = own_up.normalized();
  }
  if (own_up.norm() < 0.3 && forward.norm() <= 0.7) {
    warnings.push_back("the cameras do not agree on an up direction (--up x,y,z sets it)");
  }
  const Eigen::Vector3d level = level_up(views, 0, prior);
  // Cameras rolled about as if on a sphere have no common horizon: keep to their mean then.
  const Eigen::Vector3d up = level.dot(prior) > 0.5 ? level : prior;
  return from_eigen(ring_normal(views, up).value_or(up));
}

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
