// Which frames of a video are worth keeping.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "frame_motion.h"

namespace nerf::internal {

// Variance of the Laplacian (the 4-neighbour one) of a grey picture: the larger, the sharper.
double sharpness(std::span<const uint8_t> grey, int width, int height);

// Indices, ascending, of the sharpest of each of at most `max_frames` windows in which the picture
// moves equally far, however long that takes; all where there are no more than that. `motions`, of
// each frame since the one before; a quarter of them is spread evenly over the frames, so that a
// camera that stands still gives some, and one that never moves gives windows of equal length.
std::vector<int> sharpest_of_windows(std::span<const double> scores,
                                     std::span<const double> motions, int max_frames);

// Cuts a yuv4mpeg stream of grey frames, as it comes in pieces, into pictures, and scores each.
class GreyStream {
 public:
  void add(std::span<const uint8_t> bytes);
  const std::vector<double>& scores() const { return scores_; }
  const std::vector<double>& motions() const { return motions_; }

 private:
  bool take_header();
  bool take_frame();

  std::vector<uint8_t> pending_;
  size_t used_ = 0;  // bytes of pending_ that are done with
  int width_ = 0, height_ = 0;
  std::vector<double> scores_, motions_;
  FrameMotion motion_;
};

}  // namespace nerf::internal
