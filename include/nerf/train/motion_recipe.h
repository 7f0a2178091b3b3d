// What a scene that moves asks of the grid method.
#pragma once

#include <array>
#include <optional>

#include "nerf/base/options.h"
#include "nerf/model/grid_motion.h"

namespace nerf {

struct Scene;

enum class Deform { kAuto, kNone, kTranslation, kSe3 };
inline auto option_names(Deform) {
  return std::array{OptionName{Deform::kAuto, "auto"}, OptionName{Deform::kNone, "none"},
                    OptionName{Deform::kTranslation, "translation"},
                    OptionName{Deform::kSe3, "se3"}};
}

struct MotionRecipe {
  Deform deform = Deform::kAuto;
  int ambient = 0;
  double rate = 0.15;
  int width = 128;
  std::optional<double> offset;  // see offset_weight()

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
    v("motion_width", width, "width of the motion's networks", at_least(8), at_most(256));
    v("motion_offset", offset,
      "weight of the loss on how far matter is moved, so that what could stand still does; without "
      "it 0.1 where one camera filmed the moments on its way, else 0",
      at_least(0), at_most(100));
  }
};

// Moments of the training photos.
int count_moments(const Scene& scene);
// Whether the training photos are one camera's, one a moment, on a way in small steps: no moment is
// seen from elsewhere. Few photos do not tell.
bool filmed_on_the_way(const Scene& scene);
// Of the loss on how far matter is moved.
double offset_weight(const MotionRecipe& recipe, const Scene& scene);
// What Deform::kAuto stands for. Throws Error where a motion is asked for and there are no two
// moments.
void resolve_motion(const Scene& scene, MotionRecipe& recipe);

}  // namespace nerf
