// Rays side by side that begin at one point or near it: how far none of them meets matter.
#pragma once

#include "nerf/math/vec.h"
#include "nerf/parts/occupancy.h"

namespace nerf {

// Engine coordinates; the rays' directions and the axis are of unit length.
struct Beam {
  Vec3d origin, axis;
  double spread = 0;  // most distance between a ray's direction and the axis
  double near = 0;    // the rays begin at this distance from their origins
  double width = 0;   // most distance between a ray's origin and the beam's
};

// A distance along the rays, at least `near`, before which none of them enters a brick that holds
// matter; infinity where none does at all. Found in steps as long as the grid's clearances
// allow (sphere tracing, Hart 1996, of a cone).
double clear_until(const OccupancyGrid& grid, const Beam& beam);

}  // namespace nerf
