// Which cells of the occupancy grid can hold matter at all, from the cameras and the photos' alpha.
#pragma once

#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/parts/occupancy.h"
#include "nerf/train/trainer.h"

namespace nerf {

// Switches off the cells that no training camera sees (unless options.keep_unseen), and with alpha
// those outside the visual hull (unless options.keep_transparent): what some photo shows as wholly
// transparent is empty (the footprint of a cell is taken generously).
void switch_off_impossible_cells(const Scene& scene, const PhotoSet& photos,
                                 const TrainOptions& options, ThreadPool& pool,
                                 OccupancyGrid& grid);

}  // namespace nerf
