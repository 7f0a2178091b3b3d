// Where a scene that moves has matter at one moment.
#pragma once

#include <optional>

#include "nerf/autodiff/linear_weights.h"
#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/model/grid_field.h"

namespace nerf::internal {

// The field's occupancy holds what any moment has. Of it here are the cells near which the field
// has matter at `time`: blocks of 2^3 cells where, in the block or one of the 26 around it, one of
// two points would stop a 250th of the light over a cell's width. No value where the scene
// stands still, or where finding out would cost more than it saves in a picture of so many rays.
// Throws Cancelled.
std::optional<OccupancyGrid> occupancy_at(const GridField& field, Precision precision, Real time,
                                          int64_t rays, ThreadPool& pool, const Cancel* cancel);

}  // namespace nerf::internal
