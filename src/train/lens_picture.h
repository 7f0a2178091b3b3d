// Pictures with and without what their lens does to them.
#pragma once

#include "nerf/io/photos.h"
#include "nerf/math/vignetting.h"
#include "nerf/model/renderer.h"

namespace nerf {

// The photo as a lens without falloff would have taken it. Its values may exceed 1.
Photo without_falloff(const Photo& photo, const Camera& camera, const Falloff& falloff);

// The rendering, over `background`, as the lens would have taken it.
void add_falloff(const Camera& camera, const Falloff& falloff, const Vec3& background,
                 Frame& frame);

}  // namespace nerf
