// How cameras moved while the lines of a film's frames were read one after another.
//
// A frame's camera has the velocity that its poses before and after give: the slope of the parabola
// through the three, in the frame's own axes, so that a camera of constant twist gets that twist.
// At an end, or beside a gap of more than three usual intervals, it is that of the one neighbour; a
// frame without neighbours stands still. What a pose is given for is the middle of its reading.
#pragma once

#include <string>
#include <vector>

#include "nerf/io/scene.h"
#include "nerf/math/camera.h"
#include "nerf/train/camera_recipe.h"
#include "train/ray_batch.h"

namespace nerf {

// The groups of cameras with the same lens, in order of the first of each: of each camera of the
// scene its group.
std::vector<int> lens_groups(const Scene& scene);

class RollingShutter {
 public:
  // Throws Error where the scene's photos are no film: when they were taken is not known, or they
  // are turned by more from one to the next than a film's frames are.
  RollingShutter(const Scene& scene, const CameraRecipe& recipe);

  bool is_learnt() const { return learnt_; }
  // Of each camera that filmed (a folder's, or as the capture numbers them), the share of a frame's
  // time in which the lines are read. One that is learnt begins as 0; below 0 they are read the
  // other way round.
  const std::vector<double>& readouts() const { return readouts_; }
  size_t camera_of(size_t view) const { return camera_of_[view]; }
  void set_readout(size_t camera, double share) { readouts_[camera] = share; }

  // Of a view's camera in a frame's time: camera axes, input unit.
  const Twist& twist(size_t view) const { return twists_[view]; }
  LineMotion motion(size_t view) const;
  // Gives the training photos' cameras, which are in engine coordinates, their motion.
  void place(PixelSource& source) const;

  std::string description() const;  // for people, one line

 private:
  void find_twists(const Scene& scene, const std::vector<std::vector<size_t>>& films);

  const Scene& scene_;
  bool learnt_;
  std::vector<double> readouts_;
  std::vector<size_t> camera_of_;  // of each view
  std::vector<Twist> twists_;
  std::vector<LineMotion> lines_;  // of each view, without their twist
  double usual_ = 0;               // interval between neighbours; in the unit of View::clock
  double interval_ = 0;            // between a film's frames
  size_t moving_ = 0;              // views that have a neighbour
};

}  // namespace nerf
