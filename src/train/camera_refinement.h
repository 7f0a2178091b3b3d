// Corrections of the training photos' cameras, and how they move (Lin et al. 2021, "BARF"; Park et
// al. 2023, "CamP").
//
// A pose has six parameters and a lens five (math/refined_camera.h); photos of one file share a
// pose, photos with the same intrinsics a lens. Adam moves them in coordinates in which each turns
// what the photo shows by the same angle and hardly any does what another does: with the mean S of
// J^T J over points that a photo sees, J the derivative of where its ray passes them, and S = L
// L^T, the correction is L^-T times the coordinates. A lens comes behind the poses of its photos:
// what they would make up for of its correction goes with it. What would move all cameras alike as
// a rigid body or in scale is taken out of every step: the field could only follow. The time in
// which a camera's lines are read (train/rolling_shutter.h) is a number of its own, in units in
// which it moves what the photos show by as much.
#pragma once

#include <span>
#include <vector>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/math/refined_camera.h"
#include "nerf/train/camera_recipe.h"
#include "train/ray_batch.h"
#include "train/rolling_shutter.h"

namespace nerf {

// Of a ray through a photo: the gradient by its origin, sum over its samples of g, and the torque
// about the photo's pose, sum of cross(sample - centre, g), g being the gradient by a sample's
// position. Of one line's pose that is what turns the direction; where lines have poses of their
// own, what moves the origin comes to it.
struct RayMove {
  int32_t source = -1;  // the i-th training photo; below 0: none
  Vec3d origin, torque;
  std::array<double, LensCorrection::kParameters> lens{};
  double readout = 0;
};

class CameraRefinement {
 public:
  // Weight of a readout's square in the loss: of a camera whose lines move what they show by less
  // than a tenth of a pixel it decides.
  static constexpr double kReadoutPrior = 1e-6;

  // All must outlive it; the source's cameras are the given ones by now. shutter: none where lines
  // are read at once; what it learns is set in it.
  CameraRefinement(const Scene& scene, const PhotoSet& photos, const CameraRecipe& recipe,
                   PixelSource& source, RollingShutter* shutter = nullptr);

  // Completes the move of a ray, whose torque is that on its direction by now, by what it says of
  // lens and readout, and by the torque of its origin. pose, share: of the ray's line.
  void find_gradient(const Pose& pose, double share, const Vec3d& direction, const Vec3d& gradient,
                     RayMove& move) const;
  // The moves of a step's rays in one order; then, every so many steps, a step of Adam, whose size
  // is `rate`, after which the source has new cameras.
  void add(std::span<const RayMove> moves);
  void update(double rate);
  void reset();  // the given cameras, an optimiser without memory

  // Of a view of the scene, held-out ones included: input coordinates. The pose of one that does
  // not train is as it was given.
  Pose pose(size_t view) const;
  Camera camera(size_t view) const;

  // Gradient by all coordinates (poses, lenses, readouts) of what was added since the last step.
  std::vector<double> gradient() const;
  size_t parameters() const { return values_.size(); }
  // Coordinates to corrections; for tests, and after loading.
  void set_values(std::span<const double> values);
  std::span<const double> values() const { return values_; }

  // What a step reads and the step before wrote.
  template <class T, class Visit>
  static void visit_arrays(T& t, Visit&& visit) {
    visit("camera_values", std::span(t.values_));
    visit("camera_m", std::span(t.m_));
    visit("camera_v", std::span(t.v_));
    visit("camera_sums", std::span(t.sums_));
    visit("camera_counts", std::span(t.counts_));
  }
  void apply();  // corrections to the source

 private:
  static constexpr int kPose = PoseCorrection::kParameters;
  static constexpr int kLens = LensCorrection::kParameters;
  // Lower triangular factor of a photo's or lens's S, [n][n] row by row.
  struct Factor {
    std::vector<double> l;
    void solve_transposed(double* x) const;  // x = L^-T x
    void solve(double* x) const;             // x = L^-1 x
    void multiply_transposed(double* x) const;
    int n = 0;
  };
  static Factor factor_of(std::vector<double> sum, int n);
  size_t readouts_at() const { return kPose * pose_factors_.size() + kLens * lens_factors_.size(); }
  bool learns_readouts() const { return shutter_ && shutter_->is_learnt(); }
  void find_factors();
  std::array<double, kLens> free_gradient(const Camera& refined, const LensCorrection& correction,
                                          const Vec3d& direction, const Vec3d& gradient) const;
  double* lens_part(std::vector<double>& of, size_t lens) const {
    return of.data() + kPose * pose_factors_.size() + kLens * lens;
  }
  void find_gauge();
  PoseCorrection pose_correction(size_t pose) const;
  LensCorrection lens_correction(size_t lens) const;
  const double* lens_values(size_t lens) const {
    return values_.data() + kPose * pose_factors_.size() + kLens * lens;
  }

  const Scene& scene_;
  const PhotoSet& photos_;
  CameraRecipe recipe_;
  PixelSource& source_;
  RollingShutter* shutter_;
  std::vector<double> readout_scale_;   // radians that a readout of 1 moves what a photo shows by
  std::vector<int> pose_of_, lens_of_;  // of each training photo
  std::vector<int> lens_of_view_;       // of each view of the scene; below 0: stays
  std::vector<Pose> given_;             // of each training photo, engine coordinates
  std::vector<Factor> pose_factors_, lens_factors_;
  // L's part below a pose: of its photo's lens (which may be none), [kLens][kPose].
  std::vector<std::vector<double>> between_;
  std::vector<int> lens_of_pose_;
  std::vector<std::vector<double>> gauge_;  // orthonormal, in coordinates
  std::vector<double> values_, m_, v_;      // [poses][6], [lenses][5], [readouts]
  std::vector<double> sums_;                // gradient by corrections, of the steps since the last
  std::vector<int64_t> counts_ = {0, 0};    // steps of Adam; steps in sums_
};

}  // namespace nerf
