// Points of a posed capture that has none, found in the photos themselves.
#pragma once

#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"

namespace nerf {

// Fewer points than this in a capture say nothing of where matter begins.
inline constexpr int kFewPoints = 100;

// Adds points and their observations to a capture whose files name fewer than kFewPoints: each of
// up to 64 training photos is compared, at some 190 pixels across, with neighbours at planes of
// equal steps in inverse depth (Collins 1996; Yang and Pollefeys 2003) by normalised
// cross-correlation of 7x7 pixels, and a place is kept where two photos agree on it. Leaves
// captures with alpha alone: their mattes say more. The same points for any number of threads;
// returns how many were added.
int add_swept_points(Scene& scene, const PhotoSet& photos, ThreadPool& pool);

}  // namespace nerf
