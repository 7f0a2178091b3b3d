// What decoding a set of photos will take, before it starts.
#pragma once

#include <cstdint>

#include "nerf/io/image.h"
#include "nerf/io/scene.h"

namespace nerf::internal {

// Width or height after --downscale: nearest whole number, at least 1.
int downscaled(int size, int downscale);

// Whether two pictures have the same shape, within 2 % or 2 pixels: a resized side is a whole
// number.
bool same_shape(double w1, double h1, double w2, double h2);

// The camera of a photo of width x height pixels, turned as orientation_for() says, scaled to
// new_width x new_height. Throws Error where the photo lies on its side against the camera, or the
// ratios of the sides differ by more than 2 % (or 2 pixels: a resized side is a whole number).
Camera camera_of_photo(const Camera& camera, const View& view, int width, int height, int new_width,
                       int new_height);

struct PhotoMemory {
  uint64_t kept = 0;     // the decoded, downscaled photos and their masks
  uint64_t largest = 0;  // the largest photo as one thread decodes it
};

// Adds a photo of this kind.
void add_photo(PhotoMemory& memory, const ImageInfo& info, bool mask, int downscale);

// Throws Error where photos do not fit into `limit` bytes; it names the --downscale that would.
void check_photo_memory(const PhotoMemory& memory, int threads, uint64_t limit, int downscale,
                        const std::string& where);

}  // namespace nerf::internal
