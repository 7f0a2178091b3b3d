// Which pixels a training draws, and what it takes from depths and masks: of every method.
#pragma once

#include <optional>

#include "nerf/base/options.h"

namespace nerf {

struct PixelRecipe {
  std::optional<double> depth_loss;    // see depth_loss_weight()
  std::optional<double> point_depth;   // see point_depth_share()
  std::optional<double> masked_share;  // see masked_share()

  template <class V>
  void visit_options(V& v) {
    v("depth_loss", depth_loss,
      "weight, at first, of the loss that draws the light of a ray to where its photo's depth map "
      "says, where there is one",
      at_least(0), at_most(1000));
    v("point_depth", point_depth,
      "share of the pixels that are drawn where a sparse point is seen, whose distance counts like "
      "that of a depth map",
      at_least(0), at_most(1));
    v("masked_share", masked_share,
      "share of the pixels that masks leave out that is drawn, as transparent ones, so that what "
      "no photo shows is empty; 0: they teach nothing. Without it with tables 0.3 where masks "
      "leave "
      "out more than half of all pixels, else 0.1 at first and 0.001 at last; with the papers' "
      "methods 0",
      at_least(0), at_most(1));
  }
};

}  // namespace nerf
