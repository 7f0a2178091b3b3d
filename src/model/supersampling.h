// Several rays to a pixel.
#pragma once

#include "nerf/model/renderer.h"

namespace nerf::internal {

// The means of n x n pixels; of depths the middle one, where most of them have any.
Frame reduced(const Frame& from, int n);

}  // namespace nerf::internal
