// Where a paper method's trained network has matter, found once by asking it everywhere, so that
// pictures skip the rest.
#pragma once

#include <cstdint>
#include <optional>

#include "model/matter_cells.h"
#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/model/model_info.h"
#include "nerf/model/network_field.h"

namespace nerf::internal {

// Cells across each grid: for all pictures of a scene that stands still, for one of a moment.
inline constexpr int kBakedSide = 128, kMomentSide = 64;

// Whether to find out saves more than half of the evaluations of so many rays.
bool baking_pays(const NetworkField& field, uint64_t rays, int side);

// Points, and cones where neither space nor distance is warped and the photos' cameras are known:
// around each point a Gaussian of a random photo's cone is asked for, as long as an interval of the
// first level or shorter. (In warped space cells are too coarse beside its intervals to save
// anything.) Not of a scene that moves: a cell would have to be asked at every moment.
bool can_bake(const NetworkField& field, const ModelInfo& info);

// A cell counts as empty where none of its points, nor of its 26 neighbours', would stop as much as
// a thousandth of the light: over a cell's width, of a cone over an interval of the first level.
// Throws Cancelled.
MatterCells bake_occupancy(const NetworkField& field, const ModelInfo& info, ThreadPool& pool,
                           const Cancel* cancel);

// Of a scene that moves, as it is at `time`. No value where the scene stands still, where a point
// is not what its method asks for, and where finding out does not pay in a picture of so many rays.
// Throws Cancelled.
std::optional<MatterCells> occupancy_at(const NetworkField& field, const ModelInfo& info, Real time,
                                        int64_t rays, ThreadPool& pool, const Cancel* cancel);

}  // namespace nerf::internal
