// Layers of pixels that have several rays.
#pragma once

#include "nerf/model/renderer.h"

namespace nerf::internal {

// Appends the pixels of n x n of `from` each. Distances and normals, which means would place
// between near and far, are the middle ones, or none where most rays have none; mean and variance
// are of the light of all rays; 5 % and 95 % the outermost. Colours are left to the picture's.
void append_reduced_layers(const Frame& from, int n, PictureLayers& out);

}  // namespace nerf::internal
