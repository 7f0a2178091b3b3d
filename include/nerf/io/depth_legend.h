// What the colours of a depth picture mean, beside it.
#pragma once

#include "nerf/io/depth_image.h"
#include "nerf/io/image.h"

namespace nerf {

// Columns that the legend of a picture so high takes.
int legend_width(int height);

// The picture (3 channels) with a strip at its right: the map's colours from near (above) to far,
// and five depths, input units, at the heights of theirs. Black for an empty range.
Image8 with_legend(const Image8& picture, const DepthRange& range, DepthLook map);

}  // namespace nerf
