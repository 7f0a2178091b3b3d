// Space that is empty by the sparse points: between a camera and the points that it sees, and
// before everything that a photo shows.
#pragma once

#include <vector>

#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/parts/occupancy.h"

namespace nerf {

// Distance from each view's camera at which its rays begin, engine units: six tenths of that to the
// nearest hundredth of the points that it sees or, where that is nearer, of those in its picture
// that other photos saw. Scene::near, the least of all, where it sees too few of them, and
// everywhere where an option gives it.
std::vector<double> near_of_views(const Scene& scene);

// Switches off the cells of an unbounded scene's grid that are empty by two witnesses or more, but
// for those at the rim of such space, those that hold a point and their neighbours. Witnesses are
// lines of sight, from a training camera most of the way to a point it sees, and training cameras
// that have the cell nearer than nine tenths of the way to their nearest points: in the picture, or
// around the camera as far as no point is. Matter there is seen by no photo but would fog new
// views. One witness may be wrong. Of a film there is one in each of six parts besides, since what
// moves is seen through before it comes and after it has gone; not where one camera filmed on its
// way.
void switch_off_free_space(const Scene& scene, const PhotoSet& photos, ThreadPool& pool,
                           OccupancyGrid& grid);

}  // namespace nerf
