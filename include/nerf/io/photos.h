// Decoded photos, kept as stored (8-bit sRGB, or half for 16-bit and EXR files).
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "nerf/base/real.h"
#include "nerf/base/threads.h"
#include "nerf/io/depth_map.h"
#include "nerf/io/scene.h"

namespace nerf {

// One photo after downscaling: pixels row by row, channels interleaved.
struct Photo {
  int width = 0, height = 0;
  int channels = 3;                // 3, or 4 with alpha (straight, not premultiplied)
  std::vector<uint8_t> pixels8;    // 8-bit sources
  std::vector<uint16_t> pixels16;  // half floats (bits); exactly one of the two is filled
  DepthMap depth;                  // empty where the capture has none
  std::vector<uint8_t> mask;       // empty, or width*height: 0 = masked out, 255 = keep

  // Straight colour and alpha of pixel (x, y) in [0, 1] (EXR may exceed 1); alpha 1 where absent.
  void pixel(int x, int y, Real rgba[4]) const;
  // Asks for the memory that pixel() and masked_out() of this place will read.
  void prefetch(int x, int y) const {
    const size_t at = static_cast<size_t>(y) * width + x, c = static_cast<size_t>(channels);
    if (!pixels8.empty())
      __builtin_prefetch(pixels8.data() + at * c);
    else
      __builtin_prefetch(pixels16.data() + at * c);
    if (!mask.empty()) __builtin_prefetch(mask.data() + at);
  }
  // Whether the alpha of pixel() is not above 0.
  bool transparent(int x, int y) const {
    if (channels < 4) return false;
    const size_t at =
        (static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)) * 4 + 3;
    if (!pixels8.empty()) return pixels8[at] == 0;
    constexpr uint16_t kInfinity = 0x7c00;  // above it: what is no number or negative
    return pixels16[at] == 0 || pixels16[at] > kInfinity;
  }
  bool masked_out(int x, int y) const {
    return !mask.empty() && mask[static_cast<size_t>(y) * width + x] == 0;
  }
};

struct PhotoSet {
  std::vector<Photo> photos;    // parallel to Scene::views
  std::vector<Camera> cameras;  // parallel to Scene::views, scaled to the photo's size
  double fraction_masked = 0;   // of all pixels
  double decode_seconds = 0;
};

// Decodes every view's photo (and mask and depth map) in parallel, downscales by area average
// (masks: nearest). Throws Error for truncated or corrupt files, photos transposed against their
// camera and sizes whose ratio disagrees with the camera. `progress` is called from one thread at a
// time.
PhotoSet load_photos(const Scene& scene, ThreadPool& pool,
                     const std::function<void(int done, int total)>& progress = {});

}  // namespace nerf
