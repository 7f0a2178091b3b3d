#include "math/bundle_equations.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "math/eigen_vectors.h"
#include "math/lens.h"
#include "nerf/math/refined_camera.h"

namespace nerf::internal {
namespace {

// Standard deviations of the priors, against keypoints that are a pixel off.
constexpr double kTurn = 0.35;  // radians
constexpr double kMove = 0.5;   // of the images' extent
constexpr double kFocal = 0.5;  // of the focal length
constexpr double kDistortion = 1;

constexpr int64_t kPointsAtOnce = 64;

template <class Fn>
void for_points(ThreadPool& pool, size_t count, const Fn& fn) {
  const int64_t chunks = (static_cast<int64_t>(count) + kPointsAtOnce - 1) / kPointsAtOnce;
  pool.parallel_for(chunks, [&](int64_t chunk) {
    const size_t begin = static_cast<size_t>(chunk * kPointsAtOnce);
    for (size_t p = begin; p < std::min(begin + kPointsAtOnce, count); ++p) fn(p);
  });
}

bool is_focal(const Camera& camera, int parameter) {
  return parameter < (has_one_focal(camera.model) ? 1 : 2);
}

Vec3d in_camera(const Pose& pose, const Vec3d& point) {
  return pose.rotation.transposed() * (point - pose.translation);
}

// The turn that leads from one pose to the other, world axes, radians.
Vec3d turn_of(const Pose& now, const Pose& then) {
  return twist_of({now.rotation * then.rotation.transposed(), {}}).rotation;
}

// Standard deviation of the prior of a lens's parameter.
double spread_of(const Camera& given, int parameter) {
  return is_focal(given, parameter) ? kFocal * given.params[static_cast<size_t>(parameter)]
                                    : kDistortion;
}

// Derivatives of a projection that is one, by the direction and by the lens's free parameters.
template <class ByLens>
Eigen::Matrix<double, 2, 3> find_derivatives(const Camera& camera, const std::vector<int>& free,
                                             const Vec3d& direction, ByLens& by_lens) {
  // Of the distance, of a focal length, absolute for distortion: central differences.
  constexpr double kStep = 1e-6;
  const auto slope = [](double step, const auto& at) {
    const std::optional<Vec2d> ahead = at(step), behind = at(-step);
    if (!ahead || !behind) return Eigen::Vector2d(0, 0);
    return Eigen::Vector2d((ahead->x - behind->x) / (2 * step),
                           (ahead->y - behind->y) / (2 * step));
  };
  const Lens lens = make_lens(camera);
  const bool on_plane = camera.model != CameraModel::kFov && !is_panorama(camera) && !lens.fisheye;
  const Vec2d uv = on_plane ? Vec2d{direction.x / direction.z, direction.y / direction.z} : Vec2d{};
  for (size_t i = 0; i < free.size(); ++i) {
    const size_t parameter = static_cast<size_t>(free[i]);
    const double step =
        is_focal(camera, free[i]) ? kStep * std::abs(camera.params[parameter]) : kStep;
    by_lens.col(static_cast<Eigen::Index>(i)) = slope(step, [&](double by) -> std::optional<Vec2d> {
      Camera moved = camera;
      moved.params[parameter] += by;
      if (!on_plane) return project(moved, direction);
      const Lens of = make_lens(moved);  // as project() does, which asks first whether it may
      const Distorted d = distort(of, uv);
      return Vec2d{of.fx * d.p.a + of.cx, of.fy * d.q.a + of.cy};
    });
  }
  Eigen::Matrix<double, 2, 3> by_direction;
  if (on_plane) {
    const Distorted d = distort(lens, uv);
    Eigen::Matrix2d by_plane;
    by_plane << lens.fx * d.p.du, lens.fx * d.p.dv, lens.fy * d.q.du, lens.fy * d.q.dv;
    Eigen::Matrix<double, 2, 3> plane;
    plane << 1, 0, -uv.x, 0, 1, -uv.y;
    return by_plane * plane / direction.z;
  }
  for (int i = 0; i < 3; ++i)
    by_direction.col(i) = slope(kStep * length(direction), [&](double step) {
      Vec3d moved = direction;
      moved[i] += step;
      return project(camera, moved);
    });
  return by_direction;
}

}  // namespace

double cauchy_loss(double square, double scale) {
  return scale * scale * std::log1p(square / (scale * scale));
}

double squared_error(const Camera& camera, const std::optional<Vec2d>& seen,
                     const Vec2d& keypoint) {
  const double x = seen ? seen->x - keypoint.x : camera.width;
  const double y = seen ? seen->y - keypoint.y : camera.height;
  return x * x + y * y;
}

std::vector<int> free_parameters(const Camera& camera) {
  if (is_panorama(camera)) return {};
  const int centre = has_one_focal(camera.model) ? 1 : 2;
  std::vector<int> free;
  for (int i = 0; i < camera_model_params(camera.model); ++i)
    if (i < centre || i >= centre + 2) free.push_back(i);
  return free;
}

BundleEquations::BundleEquations(const Bundle& given, ThreadPool& pool) : pool_(pool) {
  given_.cameras = given.cameras;
  given_.images = given.images;
  Box3 box;
  for (const Bundle::Image& image : given.images) box.extend(image.pose.translation);
  if (!box.empty() && length(box.size()) > 0) extent_ = length(box.size());
  unknowns_ = 6 * static_cast<int64_t>(given.images.size());
  for (const Camera& camera : given.cameras) {
    free_.push_back(free_parameters(camera));
    lens_at_.push_back(unknowns_);
    unknowns_ += static_cast<int64_t>(free_.back().size());
  }
  std::vector<int> seen(given.points.size());
  for (const Keypoint& k : given.keypoints) ++seen[static_cast<size_t>(k.point)];
  for (const Keypoint& k : given.keypoints)
    if (seen[static_cast<size_t>(k.point)] > 1) keypoints_.push_back(k);
  std::ranges::stable_sort(keypoints_, [](const Keypoint& a, const Keypoint& b) {
    return std::pair(a.point, a.image) < std::pair(b.point, b.image);
  });
  first_.assign(given.points.size() + 1, 0);
  for (const Keypoint& k : keypoints_) ++first_[static_cast<size_t>(k.point) + 1];
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
  of_image_.resize(given.images.size());
  of_camera_.resize(given.cameras.size());
  for (size_t k = 0; k < keypoints_.size(); ++k) {
    const size_t image = static_cast<size_t>(keypoints_[k].image);
    const size_t point = static_cast<size_t>(keypoints_[k].point);
    of_image_[image].push_back(k);
    std::vector<size_t>& points = of_camera_[static_cast<size_t>(given.images[image].camera)];
    if (points.empty() || points.back() != point) points.push_back(point);
  }
  const size_t points = given.points.size();
  losses_.resize(points);
  normal_.resize(points);
  factor_.resize(points);
  down_.resize(points);
  eliminated_.resize(points);
  lenses_.resize(points);
  rows_.resize(keypoints_.size());
  poses_.resize(keypoints_.size());
}

uint64_t BundleEquations::bytes(uint64_t keypoints, uint64_t points, uint64_t unknowns) {
  // A point has as many lenses as keypoints where each image has one, in vectors that grew.
  constexpr uint64_t kOfKeypoint = sizeof(Keypoint) + 2 * sizeof(size_t) + sizeof(KeypointRow) +
                                   sizeof(Eigen::Matrix<double, 6, 3>) + 2 * sizeof(LensOfPoint);
  constexpr uint64_t kOfPoint =
      2 * sizeof(Eigen::Matrix3d) + 2 * sizeof(Eigen::Vector3d) + 8 * sizeof(double);
  return keypoints * kOfKeypoint + points * kOfPoint + unknowns * unknowns * sizeof(double);
}

double BundleEquations::cost(const Bundle& bundle, double loss_scale) {
  for_points(pool_, bundle.points.size(), [&](size_t p) {
    double sum = 0;
    for (size_t k = first_[p]; k < first_[p + 1]; ++k) {
      const Bundle::Image& image = bundle.images[static_cast<size_t>(keypoints_[k].image)];
      const Camera& camera = bundle.cameras[static_cast<size_t>(image.camera)];
      const std::optional<Vec2d> seen = project(camera, in_camera(image.pose, bundle.points[p]));
      sum += cauchy_loss(squared_error(camera, seen, keypoints_[k].pixel), loss_scale);
    }
    losses_[p] = sum;
  });
  double sum = std::accumulate(losses_.begin(), losses_.end(), 0.0);
  for (size_t i = 0; i < bundle.images.size(); ++i) {
    const Pose &now = bundle.images[i].pose, &then = given_.images[i].pose;
    const Vec3d turn = turn_of(now, then);
    const Vec3d move = (now.translation - then.translation) / (kMove * extent_);
    sum += dot(turn, turn) / (kTurn * kTurn) + dot(move, move);
  }
  for (size_t c = 0; c < bundle.cameras.size(); ++c)
    for (const int parameter : free_[c]) {
      const double then = given_.cameras[c].params[static_cast<size_t>(parameter)];
      const double spread = spread_of(given_.cameras[c], parameter);
      const double off = bundle.cameras[c].params[static_cast<size_t>(parameter)] - then;
      sum += off * off / (spread * spread);
    }
  return sum;
}

void BundleEquations::find_rows(const Bundle& bundle, double loss_scale, size_t point) {
  normal_[point].setZero();
  down_[point].setZero();
  for (size_t k = first_[point]; k < first_[point + 1]; ++k) {
    KeypointRow& row = rows_[k];
    const Bundle::Image& image = bundle.images[static_cast<size_t>(keypoints_[k].image)];
    const Camera& camera = bundle.cameras[static_cast<size_t>(image.camera)];
    const std::vector<int>& free = free_[static_cast<size_t>(image.camera)];
    row.lens.setZero(2, static_cast<Eigen::Index>(free.size()));
    const Vec3d apart = bundle.points[point] - image.pose.translation;
    const Vec3d direction = image.pose.rotation.transposed() * apart;
    const std::optional<Vec2d> seen = project(camera, direction);
    if (!seen) {
      row.residual.setZero();
      row.pose.setZero();
      row.point.setZero();
      continue;
    }
    const Vec2d& pixel = keypoints_[k].pixel;
    row.residual = {seen->x - pixel.x, seen->y - pixel.y};
    const Eigen::Matrix<double, 2, 3> by_direction =
        find_derivatives(camera, free, direction, row.lens);
    const double weight = 1 / (1 + row.residual.squaredNorm() / (loss_scale * loss_scale));
    const double root = std::sqrt(weight);
    Eigen::Matrix3d to_camera, turn;
    for (int i = 0; i < 3; ++i) to_camera.row(i) = to_eigen(image.pose.rotation.column(i));
    turn << 0, -apart.z, apart.y, apart.z, 0, -apart.x, -apart.y, apart.x, 0;  // cross(apart, .)
    row.residual *= root;
    row.lens *= root;
    row.point = root * by_direction * to_camera;
    row.pose.leftCols<3>() = row.point * turn;
    row.pose.rightCols<3>() = -row.point;
    normal_[point] += row.point.transpose() * row.point;
    down_[point] += row.point.transpose() * row.residual;
  }
}

void BundleEquations::linearise(const Bundle& bundle, double loss_scale) {
  for_points(pool_, bundle.points.size(),
             [&](size_t point) { find_rows(bundle, loss_scale, point); });
  prior_.setZero(unknowns_);
  prior_down_.setZero(unknowns_);
  for (size_t i = 0; i < bundle.images.size(); ++i) {
    const Pose &now = bundle.images[i].pose, &then = given_.images[i].pose;
    const Vec3d turn = turn_of(now, then);
    const Vec3d move = now.translation - then.translation;
    const Eigen::Index at = 6 * static_cast<Eigen::Index>(i);
    prior_.segment<3>(at).setConstant(1 / (kTurn * kTurn));
    prior_.segment<3>(at + 3).setConstant(1 / (kMove * kMove * extent_ * extent_));
    prior_down_.segment<3>(at) = to_eigen(turn);
    prior_down_.segment<3>(at + 3) = to_eigen(move);
  }
  for (size_t c = 0; c < bundle.cameras.size(); ++c)
    for (size_t i = 0; i < free_[c].size(); ++i) {
      const size_t parameter = static_cast<size_t>(free_[c][i]);
      const double then = given_.cameras[c].params[parameter];
      const double spread = spread_of(given_.cameras[c], free_[c][i]);
      const Eigen::Index at = lens_at_[c] + static_cast<Eigen::Index>(i);
      prior_[at] = 1 / (spread * spread);
      prior_down_[at] = bundle.cameras[c].params[parameter] - then;
    }
  prior_down_.array() *= prior_.array();
}

void BundleEquations::eliminate(size_t point, double damping) {
  std::vector<LensOfPoint>& lenses = lenses_[point];
  lenses.clear();
  if (first_[point] == first_[point + 1]) return;
  // A point that nearly parallel rays see has a direction of which they say nothing.
  constexpr double kLeast = 1e-9;
  Eigen::Matrix3d damped = normal_[point];
  damped.diagonal() *= 1 + damping;
  damped.diagonal().array() += kLeast * normal_[point].trace() + 1e-300;
  const Eigen::LLT<Eigen::Matrix3d> cholesky(damped);
  factor_[point] = cholesky.matrixL();
  const auto lower = factor_[point].triangularView<Eigen::Lower>();
  eliminated_[point] = lower.solve(down_[point]);
  for (size_t k = first_[point]; k < first_[point + 1]; ++k) {
    const KeypointRow& row = rows_[k];
    const Eigen::Matrix<double, 3, 2> by_point = lower.solve(row.point.transpose());
    poses_[k] = (by_point * row.pose).transpose();
    if (row.lens.cols() == 0) continue;
    const int camera = given_.images[static_cast<size_t>(keypoints_[k].image)].camera;
    auto lens = std::ranges::find(lenses, camera, &LensOfPoint::camera);
    if (lens == lenses.end()) {
      lenses.push_back({camera, {}});
      lens = lenses.end() - 1;
      lens->block.setZero(row.lens.cols(), 3);
    }
    lens->block += (by_point * row.lens).transpose();
  }
}

// The image's rows of the reduced matrix, up to the diagonal, and its columns of the lenses' rows.
void BundleEquations::reduce_image(size_t image, double damping) {
  const Eigen::Index at = 6 * static_cast<Eigen::Index>(image);
  const int camera = given_.images[image].camera;
  const Eigen::Index lens = lens_at(camera);
  Eigen::Matrix<double, 6, 6> own = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> down = prior_down_.segment<6>(at);
  for (const size_t k : of_image_[image]) {
    const size_t point = static_cast<size_t>(keypoints_[k].point);
    const KeypointRow& row = rows_[k];
    own += row.pose.transpose() * row.pose;
    down += row.pose.transpose() * row.residual - poses_[k] * eliminated_[point];
    if (row.lens.cols() > 0)
      reduced_.block(lens, at, row.lens.cols(), 6) += row.lens.transpose() * row.pose;
    for (const LensOfPoint& of : lenses_[point])
      reduced_.block(lens_at(of.camera), at, of.block.rows(), 6).noalias() -=
          of.block * poses_[k].transpose();
    for (size_t other = first_[point]; other < first_[point + 1]; ++other) {
      if (keypoints_[other].image > keypoints_[k].image) break;
      reduced_.block<6, 6>(at, 6 * keypoints_[other].image).noalias() -=
          poses_[k] * poses_[other].transpose();
    }
  }
  own.diagonal() += prior_.segment<6>(at);
  own.diagonal() *= 1 + damping;
  reduced_.block<6, 6>(at, at) += own;
  step_.segment<6>(at) = -down;
}

void BundleEquations::reduce_lens(int camera, double damping) {
  const Eigen::Index size = static_cast<Eigen::Index>(free_[static_cast<size_t>(camera)].size());
  if (size == 0) return;
  const Eigen::Index at = lens_at(camera);
  Eigen::MatrixXd own = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd down = prior_down_.segment(at, size);
  for (const size_t point : of_camera_[static_cast<size_t>(camera)]) {
    for (size_t k = first_[point]; k < first_[point + 1]; ++k) {
      if (given_.images[static_cast<size_t>(keypoints_[k].image)].camera != camera) continue;
      own += rows_[k].lens.transpose() * rows_[k].lens;
      down += rows_[k].lens.transpose() * rows_[k].residual;
    }
    const auto& lenses = lenses_[point];
    const auto lens = std::ranges::find(lenses, camera, &LensOfPoint::camera);
    down -= lens->block * eliminated_[point];
    for (const LensOfPoint& other : lenses)
      if (other.camera <= camera)
        reduced_.block(at, lens_at(other.camera), size, other.block.rows()).noalias() -=
            lens->block * other.block.transpose();
  }
  own.diagonal() += prior_.segment(at, size);
  own.diagonal() *= 1 + damping;
  reduced_.block(at, at, size, size) += own;
  step_.segment(at, size) = -down;
}

bool BundleEquations::solve(const Bundle& bundle, double damping, Bundle& moved) {
  for_points(pool_, bundle.points.size(), [&](size_t point) { eliminate(point, damping); });
  reduced_.setZero(unknowns_, unknowns_);
  step_.setZero(unknowns_);
  pool_.parallel_for(static_cast<int64_t>(given_.images.size()),
                     [&](int64_t i) { reduce_image(static_cast<size_t>(i), damping); });
  pool_.parallel_for(static_cast<int64_t>(given_.cameras.size()),
                     [&](int64_t c) { reduce_lens(static_cast<int>(c), damping); });
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> cholesky(reduced_);
  if (cholesky.info() != Eigen::Success) return false;
  cholesky.solveInPlace(step_);
  if (!step_.allFinite()) return false;
  move(bundle, moved);
  return true;
}

void BundleEquations::move(const Bundle& bundle, Bundle& moved) const {
  moved.cameras = bundle.cameras;
  moved.images = bundle.images;
  moved.points = bundle.points;
  for (size_t i = 0; i < moved.images.size(); ++i) {
    const Eigen::Index at = 6 * static_cast<Eigen::Index>(i);
    Pose& pose = moved.images[i].pose;
    pose =
        corrected(pose, {from_eigen(step_.segment<3>(at)), from_eigen(step_.segment<3>(at + 3))});
  }
  for (size_t c = 0; c < moved.cameras.size(); ++c)
    for (size_t i = 0; i < free_[c].size(); ++i)
      moved.cameras[c].params[static_cast<size_t>(free_[c][i])] +=
          step_[lens_at_[c] + static_cast<Eigen::Index>(i)];
  for_points(pool_, moved.points.size(), [&](size_t p) {
    if (first_[p] == first_[p + 1]) return;
    Eigen::Vector3d down = down_[p];
    for (size_t k = first_[p]; k < first_[p + 1]; ++k) {
      const KeypointRow& row = rows_[k];
      const Eigen::Index image = keypoints_[k].image;
      Eigen::Vector2d by = row.pose * step_.segment<6>(6 * image);
      if (row.lens.cols() > 0)
        by += row.lens * step_.segment(lens_at(given_.images[static_cast<size_t>(image)].camera),
                                       row.lens.cols());
      down += row.point.transpose() * by;
    }
    factor_[p].triangularView<Eigen::Lower>().solveInPlace(down);
    factor_[p].transpose().triangularView<Eigen::Upper>().solveInPlace(down);
    moved.points[p] = moved.points[p] - from_eigen(down);
  });
}

}  // namespace nerf::internal
