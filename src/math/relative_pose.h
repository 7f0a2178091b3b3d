// How two cameras stand to each other, and directions in which both see the same things.
#pragma once

#include <optional>
#include <span>

#include "nerf/math/vec.h"

namespace nerf::internal {

// Directions (unit, camera axes) in which two cameras see the same things, one for each thing.
struct SeenByTwo {
  std::span<const Vec3d> first, second;
};

// Share of the things that a pose explains: its rays meet before both cameras, within `tolerance`
// radians (Sampson's distance from the epipolar planes, on the sphere). 0 of none.
double explained_share(const Pose& second_from_first, const SeenByTwo& seen, double tolerance);

// Rotation of second_from_first by the eight-point algorithm (Longuet-Higgins 1981), the directions
// made isotropic first (Hartley 1997), outliers weighing less from round to round. No value: fewer
// than 8 things, directions that leave it open, or fewer than three quarters of them before both
// cameras.
std::optional<Mat3d> relative_rotation(const SeenByTwo& seen);

}  // namespace nerf::internal
