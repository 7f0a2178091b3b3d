// Corners followed through a film whose cameras are known, and whether they stand still.
#pragma once

#include <cstdint>
#include <span>

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "sweep_image.h"

namespace nerf::internal {

// Longer side of the pictures that thresholds are in pixels of.
inline constexpr int kTrackedSize = 320;

struct CornerTracks {
  int64_t followed = 0;  // through frames enough to tell
  int64_t moving = 0;    // of these, what no point explains that stands still
};

// `frames` are in the order of time, of one place and kTrackedSize each. From every fourth frame on
// the strongest corner of each block of 10x10 pixels (by the smaller eigenvalue of the structure
// tensor, Shi and Tomasi 1994) is followed through up to 24 frames by the normalised correlation of
// 7x7 pixels, there and back. A track of 8 frames and more moves if its places are more than 3
// pixels (rms) from those of each point of its first ray, and leave them bit by bit: a jump is a
// corner taken for another one. Throws Cancelled.
CornerTracks follow_corners(std::span<const SweepImage> frames, ThreadPool& pool,
                            const Cancel* cancel = nullptr);

}  // namespace nerf::internal
