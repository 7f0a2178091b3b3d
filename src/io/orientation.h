// EXIF orientation: which stored pixel is shown where.
#pragma once

#include <cstdint>

#include "nerf/io/image.h"
#include "nerf/math/camera.h"

namespace nerf::internal {

// The picture as it is shown: its size, and where pixel (x, y) of it lies among the stored ones,
// counted row by row from the top.
struct ShownPixels {
  int width = 0, height = 0;
  int64_t origin = 0, step_x = 1, step_y = 0;
  int64_t at(int64_t x, int64_t y) const { return origin + x * step_x + y * step_y; }
};

// How a stored picture of that size is shown. `orientation` is EXIF's, 1 to 8 (JEITA CP-3451, tag
// 274).
inline ShownPixels shown_pixels(int orientation, int stored_width, int stored_height) {
  const int64_t w = stored_width, h = stored_height;
  switch (orientation) {
    case 2:
      return {stored_width, stored_height, w - 1, -1, w};
    case 3:
      return {stored_width, stored_height, w * h - 1, -1, -w};
    case 4:
      return {stored_width, stored_height, w * (h - 1), 1, -w};
    case 5:
      return {stored_height, stored_width, 0, w, 1};
    case 6:
      return {stored_height, stored_width, w * (h - 1), -w, 1};
    case 7:
      return {stored_height, stored_width, w * h - 1, -w, -1};
    case 8:
      return {stored_height, stored_width, w - 1, w, -1};
    default:
      return {stored_width, stored_height, 0, 1, w};
  }
}

// The orientation that a camera's photo is to be turned by: the file's, where it swaps the sides
// and the camera has the size of the picture as it is shown; else 1, as stored.
int orientation_for(const Camera& camera, const ImageInfo& info);

}  // namespace nerf::internal
