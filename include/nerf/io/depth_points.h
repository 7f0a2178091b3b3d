// Points of the depth maps that come with a capture.
#pragma once

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"

namespace nerf {

struct DepthPoints {
  int maps = 0;        // of the training photos
  int points = 0;      // added to the scene
  double agreed = 0;   // share of the places looked at that other maps have at the same depth,
  double opposed = 0;  // that they look through
  bool rejected = false;
};

// Adds points of the training photos' depth maps and their observations: places away from edges,
// evenly over each picture, that no more maps look through than have them at the same depth (within
// kDepthEdge). A sensor's depth counts as a second photo that sees the place. Sets near and far by
// them where neither points, nor LLFF's bounds, nor options say them, and far only if the maps know
// the depth of nearly every pixel: beyond a sensor's reach may be anything.
//
// Maps that do not fit the cameras, since their unit is another or they show something else, would
// do harm: where more places are looked through than agreed on, or almost none is agreed on, the
// photos lose their maps, and nothing is added. The same for any number of threads. Throws
// Cancelled.
DepthPoints add_depth_points(Scene& scene, PhotoSet& photos, ThreadPool& pool,
                             const Cancel* cancel = nullptr);

}  // namespace nerf
