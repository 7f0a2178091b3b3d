// Where samples lie on the rays of each photo.
#pragma once

#include <vector>

#include "nerf/io/scene.h"
#include "nerf/train/trainer.h"

namespace nerf {

// Distances from a camera, engine units.
struct SampleRange {
  double near = 0, far = 0;
};

// Of all rays: what the options say, or the scene. 0 to 1 in normalised device coordinates.
SampleRange range_of(const Scene& scene, const TrainOptions& options);

// Of each view, with NetworkRecipe::photo_range: between the nearest and the farthest thousandth of
// the points that it sees (Martin-Brualla et al. 2021, in the form of kwea123/nerf_pl), as far as
// the options do not say it; range_of() where it sees too few. Else none.
std::vector<SampleRange> ranges_of_views(const Scene& scene, const TrainOptions& options);

// From the nearest to the farthest of the training views' ranges, or range_of() where there are
// none. Throws Error where it is empty.
SampleRange range_of_field(const Scene& scene, const TrainOptions& options,
                           const std::vector<SampleRange>& views);

}  // namespace nerf
