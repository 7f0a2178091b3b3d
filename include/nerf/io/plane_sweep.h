// Points of a posed capture that has none, found in the photos themselves.
#pragma once

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"

namespace nerf {

// Fewer points than this in a capture say nothing of where matter begins.
inline constexpr int kFewPoints = 100;

// Adds points and their observations to a capture whose photos are said to see fewer than
// kFewPoints: each of up to 64 training photos is compared, at some 190 pixels across, with
// neighbours at planes of equal steps in inverse depth (Collins 1996; Yang and Pollefeys 2003) by
// normalised cross-correlation of 7x7 pixels, and a place is kept where two photos agree on it.
// Sets near and far by them where neither points, nor LLFF's bounds, nor options say them. Leaves
// captures with alpha alone, whose mattes say more, and lenses that see more than 50 degrees aside.
// The same points for any number of threads; returns how many were added. Throws Cancelled.
int add_swept_points(Scene& scene, const PhotoSet& photos, ThreadPool& pool,
                     const Cancel* cancel = nullptr);

}  // namespace nerf
