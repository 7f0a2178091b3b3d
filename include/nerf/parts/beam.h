// Rays side by side that begin at one point: how far none of them meets matter.
#pragma once

#include "nerf/math/vec.h"
#include "nerf/parts/occupancy.h"

namespace nerf {

// Engine coordinates; the rays' directions and the axis are of unit length.
struct Beam {
  Vec3d origin, axis;
  double spread = 0;  // most distance between a ray's direction and the axis
  double near = 0;    // the rays begin at this distance from the origin
};

// A distance from the origin, at least `near`, before which no ray of the beam enters a brick that
// holds matter; infinity where none does at all. Found in steps as long as the grid's clearances
// allow (sphere tracing, Hart 1996, of a cone).
double clear_until(const OccupancyGrid& grid, const Beam& beam);

}  // namespace nerf
