// What a scene that moves asks of the grid method.
#pragma once

#include <array>

#include "nerf/base/options.h"
#include "nerf/model/grid_motion.h"

namespace nerf {

enum class Deform { kAuto, kNone, kTranslation, kSe3 };
inline auto option_names(Deform) {
  return std::array{OptionName{Deform::kAuto, "auto"}, OptionName{Deform::kNone, "none"},
                    OptionName{Deform::kTranslation, "translation"},
                    OptionName{Deform::kSe3, "se3"}};
}

struct MotionRecipe {
  Deform deform = Deform::kAuto;
  int ambient = 0;
  double rate = 0.05;
  int first_levels = 4;
  double levels_open = 0;
  int degrees = 4, time_degrees = 6, time_code = 8, depth = 3, width = 64, point_degrees = 3;

  // Of Deform::kAuto, which is resolved before, that of a scene that stands still.
  MotionShape shape() const;

  template <class V>
  void visit_options(V& v) {
    v("deform", deform,
      "how what moves is led to one canonical scene: translation, or se3, a rotation as well; "
      "auto: "
      "translation where the photos are of several moments, else none",
      brief("motion: auto, none, translation or se3"));
    v("ambient", ambient,
      "coordinates beside the three of space in which a scene that moves may change its shape, as "
      "where a mouth opens",
      at_least(0), at_most(8));
    v("motion_rate", rate, "step size of the motion's networks, as a share of the networks'",
      above(0), at_most(10));
    v("motion_first_levels", first_levels, "levels of the table that are open at first",
      at_least(1), at_most(16));
    v("motion_levels_open", levels_open, "share of the training after which all levels are",
      at_least(0), at_most(1));
    v("motion_degrees", degrees, "frequencies of the position", at_least(0), at_most(16));
    v("motion_time_degrees", time_degrees, "frequencies of time", at_least(0), at_most(16));
    v("motion_time_code", time_code, "numbers of time", at_least(1), at_most(256));
    v("motion_depth", depth, "layers", at_least(1), at_most(16));
    v("motion_width", width, "width", at_least(1), at_most(256));
    v("motion_point_degrees", point_degrees, "frequencies of the position in density", at_least(0),
      at_most(16));
  }
};

struct Scene;

// Moments of the training photos.
int count_moments(const Scene& scene);
// What Deform::kAuto stands for. Throws Error where a motion is asked for and there are no two
// moments.
void resolve_motion(const Scene& scene, MotionRecipe& recipe);

}  // namespace nerf
