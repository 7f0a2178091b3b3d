// How far a video's picture moves from frame to frame.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace nerf::internal {

class FrameMotion {
 public:
  // Mean displacement of the picture's textured blocks since the frame before, as a share of the
  // longer side; 0 for the first frame. Blocks are looked for on a copy some 120 pixels long (the
  // least sum of squared differences, means taken off so that exposure may change) up to a 20th of
  // it away; blocks that are not found do not count, but where they are three in four the
  // displacement is the most that can be told.
  double add(std::span<const uint8_t> grey, int width, int height);

 private:
  int before_width_ = 0;
  std::vector<uint8_t> before_;
};

}  // namespace nerf::internal
