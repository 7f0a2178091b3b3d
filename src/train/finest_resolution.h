// How fine a hash grid the photos ask for.
#pragma once

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/model/grid_field.h"

namespace nerf {

// The options with a finest resolution where they leave it open: of a bounded scene the cells
// across the region [-1, 1]^3 that are a pixel wide, as the median training camera sees its
// middle, at most kFinestUnbounded; of an unbounded one kFinestUnbounded. Finer cells than the
// photos can resolve fit the single pixel and not what lies between pixels (docs/benchmarks.md).
GridOptions resolved(const GridOptions& options, const Scene& scene, const PhotoSet& photos);

}  // namespace nerf
