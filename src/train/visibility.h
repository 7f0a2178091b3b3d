// Which cells of the occupancy grid can hold matter at all, from the cameras and the photos' alpha.
#pragma once

#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/parts/occupancy.h"
#include "nerf/train/trainer.h"

namespace nerf {

// How many of so many photos must show a cell as wholly transparent for it to be empty. Mattes are
// wrong here and there: what one or two show so and the others do not stays on and is learnt. Few
// photos leave too little to ask for more than one.
inline int matte_agreement(size_t photos) { return 1 + (photos >= 10) + (photos >= 50); }

// Switches off the cells that no training camera sees (unless options.grid_recipe.keep_unseen), and
// with alpha those outside the visual hull (unless options.grid_recipe.keep_transparent): what
// matte_agreement() photos show as wholly transparent, or all that see it, is empty (the footprint
// of a cell is taken generously).
void switch_off_impossible_cells(const Scene& scene, const PhotoSet& photos,
                                 const TrainOptions& options, ThreadPool& pool,
                                 OccupancyGrid& grid);

}  // namespace nerf
