// Several rays to a pixel.
#pragma once

#include <functional>

#include "nerf/model/renderer.h"

namespace nerf::internal {

// Draws what a camera sees; `progress` as render() takes it.
using RenderPart = std::function<Frame(const Camera&, const std::function<void(double)>& progress)>;

// The picture of `camera` from n x n rays to a pixel: their means, and of their depths the middle
// one where most of them have any. `render` is asked for bands of the n times larger picture, so
// that no more than a few million of its pixels are ever held.
Frame render_supersampled(int n, const Camera& camera, const std::function<void(double)>& progress,
                          const RenderPart& render);

}  // namespace nerf::internal
