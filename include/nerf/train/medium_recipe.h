// What photos that were taken through fog or water ask of the grid method.
#pragma once

#include <array>

#include "nerf/base/options.h"
#include "nerf/model/medium.h"

namespace nerf {

struct Scene;

inline auto option_names(LearntMedium) {
  return std::array{OptionName{LearntMedium::kNone, "none"}, OptionName{LearntMedium::kFog, "fog"},
                    OptionName{LearntMedium::kWater, "water"}};
}

struct MediumRecipe {
  LearntMedium medium = LearntMedium::kNone;
  double rate = 10;

  template <class V>
  void visit_options(V& v) {
    v("medium", medium,
      "what the photos were taken through, learnt with the scene: fog, of one density for all "
      "colours, or water, which weakens what is in it and adds its own light by channel; "
      "nerf_render "
      "shows the scene through it, or clear with --medium off");
    v("medium_rate", rate, "step size of the medium's numbers, as a share of the networks'",
      above(0), at_most(100));
  }
};

// Throws Error where a medium is asked for and the photos have alpha.
void check_medium(const Scene& scene, const MediumRecipe& recipe);

}  // namespace nerf
