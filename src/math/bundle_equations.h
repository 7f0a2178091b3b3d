// The normal equations of a bundle adjustment, linear in a small move of everything.
//
// Residuals are pixels. The sum that falls is Cauchy's loss of their lengths, sum of s^2 log(1 +
// |r|^2 / s^2), by reweighting: a keypoint weighs 1 / (1 + |r|^2 / s^2). The points' blocks are
// eliminated (Triggs et al. 2000, section 6.1): what is left is dense in images and lenses.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "math/bundle_adjustment.h"

namespace nerf::internal {

// Of a keypoint: its residual and the derivatives by the pose (turn about the camera's own centre,
// world axes; move), by the lens's free parameters and by the point, all times the root of its
// weight.
struct KeypointRow {
  static constexpr int kMostLens = 14;
  Eigen::Vector2d residual;
  Eigen::Matrix<double, 2, 6> pose;
  Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, kMostLens> lens;
  Eigen::Matrix<double, 2, 3> point;
};

// s^2 log(1 + e^2 / s^2) of an error whose square is given, and scale s.
double cauchy_loss(double square, double scale);

// Of a keypoint from where its point is seen; the picture's diagonal where it is not.
double squared_error(const Camera& camera, const std::optional<Vec2d>& seen, const Vec2d& keypoint);

// Parameters of a lens that are adjusted, by their places: all but the principal point.
std::vector<int> free_parameters(const Camera& camera);

class BundleEquations {
 public:
  // The bundle as it was given: what the priors hold on to. Keypoints of points that have fewer
  // than two are left out.
  BundleEquations(const Bundle& given, ThreadPool& pool);

  // Memory that equations of that size take.
  static uint64_t bytes(uint64_t keypoints, uint64_t points, uint64_t unknowns);
  // Sum of the losses and of the priors.
  double cost(const Bundle& bundle, double loss_scale);
  void linearise(const Bundle& bundle, double loss_scale);
  // The bundle moved by the damped equations' solution; false where they have none. damping: share
  // of the diagonal that is added to it.
  bool solve(const Bundle& bundle, double damping, Bundle& moved);

 private:
  // What a lens of a point has of the eliminated block; a point is seen through few of them.
  struct LensOfPoint {
    int camera;
    Eigen::Matrix<double, Eigen::Dynamic, 3, 0, KeypointRow::kMostLens, 3> block;
  };
  int64_t lens_at(int camera) const { return lens_at_[static_cast<size_t>(camera)]; }
  void find_rows(const Bundle& bundle, double loss_scale, size_t point);
  void eliminate(size_t point, double damping);
  void reduce_image(size_t image, double damping);
  void reduce_lens(int camera, double damping);
  void move(const Bundle& bundle, Bundle& moved) const;

  Bundle given_;  // without its keypoints and points
  ThreadPool& pool_;
  double extent_ = 1;                   // of the images' places
  std::vector<std::vector<int>> free_;  // of each camera: parameters that are adjusted
  std::vector<int64_t> lens_at_;        // of each camera: its first unknown
  int64_t unknowns_ = 0;
  std::vector<Keypoint> keypoints_;                 // by point, then by image
  std::vector<size_t> first_;                       // [points + 1], into keypoints_
  std::vector<std::vector<size_t>> of_image_;       // places in keypoints_
  std::vector<std::vector<size_t>> of_camera_;      // points that a camera sees
  std::vector<double> losses_;                      // [points]
  std::vector<KeypointRow> rows_;                   // as keypoints_
  std::vector<Eigen::Matrix3d> normal_, factor_;    // [points]; factor: lower, of the damped
  std::vector<Eigen::Vector3d> down_, eliminated_;  // [points]: J^T r; factor^-1 of it
  std::vector<Eigen::Matrix<double, 6, 3>> poses_;  // as keypoints_: J_pose^T J_point factor^-T
  std::vector<std::vector<LensOfPoint>> lenses_;    // [points]
  Eigen::MatrixXd reduced_;                         // lower half
  Eigen::VectorXd step_;
  Eigen::VectorXd prior_, prior_down_;  // diagonal and gradient
};

}  // namespace nerf::internal
