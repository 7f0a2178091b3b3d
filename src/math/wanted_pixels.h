// Directions of some pixels of a row.
#pragma once

#include <cstdint>
#include <span>

#include "nerf/math/camera.h"

namespace nerf::internal {

// unproject_row() of the pixels for which `wanted`, a byte for each, is not 0; zero for the others.
// All of them where `wanted` is null.
void unproject_wanted(const Camera& camera, int x, int y, const uint8_t* wanted,
                      std::span<Vec3d> out);

}  // namespace nerf::internal
