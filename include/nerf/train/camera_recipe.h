// How cameras are refined while a field is trained by their photos.
#pragma once

#include <array>

#include "nerf/base/options.h"
#include "nerf/train/shutter_option.h"

namespace nerf {

enum class RefineCameras { kOff, kAuto, kOn };
inline auto option_names(RefineCameras) {
  return std::array{OptionName{RefineCameras::kOff, "off"},
                    OptionName{RefineCameras::kAuto, "auto"}, OptionName{RefineCameras::kOn, "on"}};
}

struct CameraRecipe {
  RefineCameras refine = RefineCameras::kOff;
  double rate = 1e-3;        // of a camera's step, radians as the photo sees them
  double final_rate = 0.01;  // of the last step, as a share of `rate`
  int first_step = 128;      // steps before, in which the field takes shape
  int steps = 1;             // whose gradients make a camera's step
  double prior = 0;          // weight of the squared corrections
  bool lens = true;          // focal length and distortion too
  bool centre = false;       // the principal point as well
  int first_levels = 5;      // of the table that are open while the cameras begin to move
  double levels_open = 0.5;  // share of the training by which all are
  Readout rolling_shutter;   // of a film's frames (train/rolling_shutter.h)
  FirstLine first_line = FirstLine::kAuto;

  template <class V>
  void visit_options(V& v) {
    v("refine_cameras", refine,
      "poses and lenses are corrected while the field is trained; auto: where it pays");
    v("camera_rate", rate, "largest step of a camera, radians as its photo sees them", above(0),
      at_most(0.1));
    v("camera_final_rate", final_rate, "step of a camera at last, as a share of the first",
      above(0), at_most(1));
    v("camera_first_step", first_step, "steps before cameras begin to move", at_least(0));
    v("camera_steps", steps, "steps whose gradients make one of the cameras", at_least(1),
      at_most(1024));
    v("camera_prior", prior, "weight of the squares of all corrections in the loss", at_least(0),
      at_most(1e6));
    v("camera_lens", lens, "focal lengths and distortion are corrected too");
    v("camera_centre", centre, "principal points are corrected too, where lenses are");
    v("camera_first_levels", first_levels,
      "levels of the hash grid that are open while cameras begin to move", at_least(1),
      at_most(16));
    v("camera_levels_open", levels_open,
      "share of the training by which all levels are open, one after another", at_least(0),
      at_most(1));
    v("rolling_shutter", rolling_shutter,
      "share of the time between a film's frames in which a frame's lines are read one after "
      "another (phones: 0.5 to 0.9), while the camera moves on as its poses before and after say; "
      "auto: learnt for each camera, with the poses where these are refined");
    v("first_line", first_line,
      "side of the pixels as stored that is read first; auto: the top, of pictures higher than "
      "wide the right, as phones store what they film upright");
  }
};

}  // namespace nerf
