// Rows of numbers into photos.
#pragma once

#include <span>

#include "nerf/io/photos.h"

namespace nerf::internal {

// Colour of a pixel whose colour was multiplied by alpha; black where alpha is 0.
void unpremultiply(float* rgb, float alpha);

// Row y of straight pixels, in the form that the photo holds (8 bits or half).
void store_row(Photo& photo, int y, std::span<const float> row);

// Row y of an average of pixels whose colours were multiplied by alpha where the photo has any.
// A transparent pixel's colour means nothing, so colours are averaged weighted by alpha.
void store_averaged_row(Photo& photo, int y, std::span<const float> row);

}  // namespace nerf::internal
