// When a capture's photos were taken: from its files, or as SceneOptions::times asks.
#pragma once

#include "scene_input.h"

namespace nerf::internal {

// Gives every view its View::clock, and brings View::time of all views, which stand in order of
// their names, to [0, 1] over the capture's first moment to its last (times of files that lie there
// already stay), and says in `report` what there is. Without times all are 0. Throws Error where
// times are asked for and a photo gets none, or all get the same.
CaptureTimes settle_times(SceneInput& input, const SceneOptions& options, SceneReport& report);

// Adds to report.times what is new in the scene's held-out views.
void describe_held_out(const Scene& scene, SceneReport& report);

}  // namespace nerf::internal
