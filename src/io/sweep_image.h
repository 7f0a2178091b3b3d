// Small grey pictures without lens distortion, which a plane sweep compares.
#pragma once

#include <vector>

#include "nerf/io/photos.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"

namespace nerf::internal {

// What a pinhole with square pixels at a photo's place would have seen, its axis in the middle.
struct SweepImage {
  int width = 0, height = 0;
  double focal = 0;  // pixels
  Pose to_engine;
  std::vector<float> grey;  // [height][width], 0 to 1; below 0: nothing is known
  double cx() const { return 0.5 * width; }
  double cy() const { return 0.5 * height; }
};

// About `longest` pixels along the longer side; what lies more than 50 degrees off the axis is left
// out. Each pixel is the mean of the photo's pixels that it covers.
SweepImage make_sweep_image(const Photo& photo, const Camera& camera, const Pose& to_engine,
                            int longest);

}  // namespace nerf::internal
