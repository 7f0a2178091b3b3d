#include "math/relative_pose.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <vector>

#include "math/eigen_vectors.h"

namespace nerf::internal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kRounds = 8;        // of the reweighting
constexpr double kBefore = 0.75;  // share of things that are before both cameras
constexpr double kParallel = 1e-5;

Matrix3d cross_matrix(const Vector3d& t) {
  return (Matrix3d() << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0).finished();
}

double sampson_distance(const Matrix3d& essential, const Vector3d& a, const Vector3d& b) {
  const Vector3d ea = essential * a, eb = essential.transpose() * b;
  const double norm = std::sqrt(ea.squaredNorm() + eb.squaredNorm());
  return norm > 0 ? std::abs(b.dot(ea)) / norm : 0;
}

// Whether the rays meet before both cameras, or so far away that they are parallel.
bool meet_before_both(const Matrix3d& rotation, const Vector3d& t, const Vector3d& a,
                      const Vector3d& b) {
  const Vector3d ra = rotation * a;
  const double c = ra.dot(b), parallel = 1 - c * c;
  if (parallel < kParallel) return c > 0;
  const double ta = ra.dot(t), tb = b.dot(t);
  return tb * c > ta && tb > ta * c;  // distances times `parallel`
}

// L of the Cholesky factors of the directions' second moments, which has an inverse.
std::optional<Matrix3d> moment_root(std::span<const Vec3d> directions) {
  Matrix3d sum = Matrix3d::Zero();
  for (const Vec3d& d : directions) sum += to_eigen(d) * to_eigen(d).transpose();
  const Eigen::LLT<Matrix3d> factors(sum / static_cast<double>(directions.size()));
  if (factors.info() != Eigen::Success) return std::nullopt;
  const Matrix3d root = factors.matrixL();
  if (root.diagonal().minCoeff() < 1e-9) return std::nullopt;
  return root;
}

Mat3d from_eigen_matrix(const Matrix3d& m) {
  Mat3d out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out.m[static_cast<size_t>(i)][static_cast<size_t>(j)] = m(i, j);
  return out;
}

Matrix3d to_eigen_matrix(const Mat3d& m) {
  Matrix3d out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out(i, j) = m.m[static_cast<size_t>(i)][static_cast<size_t>(j)];
  return out;
}

// The essential matrix nearest to m, by its singular vectors: u diag(1, 1, 0) v^T.
struct Essential {
  Matrix3d u, v;

  explicit Essential(const Matrix3d& m) {
    const Eigen::JacobiSVD<Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
    u = svd.matrixU();
    v = svd.matrixV();
    if (u.determinant() < 0) u = -u;
    if (v.determinant() < 0) v = -v;
  }
  Matrix3d matrix() const { return u * Vector3d(1, 1, 0).asDiagonal() * v.transpose(); }
};

}  // namespace

double explained_share(const Pose& second_from_first, const SeenByTwo& seen, double tolerance) {
  const size_t count = std::min(seen.first.size(), seen.second.size());
  if (count == 0) return 0;
  const Matrix3d rotation = to_eigen_matrix(second_from_first.rotation);
  Vector3d t = to_eigen(second_from_first.translation);
  const bool apart = t.norm() > 0;
  if (apart) t.normalize();
  const Matrix3d essential = cross_matrix(t) * rotation;
  size_t explained = 0;
  for (size_t i = 0; i < count; ++i) {
    const Vector3d a = to_eigen(seen.first[i]), b = to_eigen(seen.second[i]);
    explained +=
        apart ? sampson_distance(essential, a, b) < tolerance && meet_before_both(rotation, t, a, b)
              : (rotation * a).cross(b).norm() < tolerance && (rotation * a).dot(b) > 0;
  }
  return static_cast<double>(explained) / static_cast<double>(count);
}

std::optional<Mat3d> relative_rotation(const SeenByTwo& seen) {
  const size_t count = std::min(seen.first.size(), seen.second.size());
  if (count < 8) return std::nullopt;
  const auto root_a = moment_root(seen.first), root_b = moment_root(seen.second);
  if (!root_a || !root_b) return std::nullopt;
  const Matrix3d to_a = root_a->inverse(), to_b = root_b->inverse();
  std::vector<double> weights(count, 1.0), distances(count);
  Matrix3d essential;
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
    for (size_t i = 0; i < count; ++i) {
      const Vector3d a = to_a * to_eigen(seen.first[i]), b = to_b * to_eigen(seen.second[i]);
      Eigen::Matrix<double, 9, 1> row;
      row << b.x() * a, b.y() * a, b.z() * a;
      normal += weights[i] * weights[i] * row * row.transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> solver(normal);
    if (solver.info() != Eigen::Success) return std::nullopt;
    const Eigen::Matrix<double, 9, 1> least = solver.eigenvectors().col(0);
    Matrix3d isotropic;
    isotropic << least.segment<3>(0).transpose(), least.segment<3>(3).transpose(),
        least.segment<3>(6).transpose();
    essential = Essential(to_b.transpose() * isotropic * to_a).matrix();
    for (size_t i = 0; i < count; ++i)
      distances[i] = sampson_distance(essential, to_eigen(seen.first[i]), to_eigen(seen.second[i]));
    std::vector<double> sorted = distances;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double usual = std::max(2 * *middle, 1e-12);
    for (size_t i = 0; i < count; ++i) weights[i] = 1 / std::max(1.0, distances[i] / usual);
  }
  // Of the four poses that it may be, the one with most things before both cameras.
  const Essential factors(essential);
  Matrix3d quarter;
  quarter << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  size_t most = 0;
  Matrix3d best = Matrix3d::Identity();
  for (const Matrix3d& turn : {quarter, Matrix3d(quarter.transpose())})
    for (const double sign : {1.0, -1.0}) {
      const Matrix3d rotation = factors.u * turn * factors.v.transpose();
      const Vector3d t = sign * factors.u.col(2);
      size_t before = 0;
      for (size_t i = 0; i < count; ++i)
        before += meet_before_both(rotation, t, to_eigen(seen.first[i]), to_eigen(seen.second[i]));
      if (before > most) most = before, best = rotation;
    }
  if (static_cast<double>(most) < kBefore * static_cast<double>(count)) return std::nullopt;
  return from_eigen_matrix(best);
}

}  // namespace nerf::internal
