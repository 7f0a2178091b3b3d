// Models of captures that colmap folded: photos of one side of a thing stand where those of the
// other side do, because both sides look alike (cameras/lookalikes.h).
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "nerf/base/cancel.h"
#include "scene_input.h"

namespace nerf::internal {

using ViewPair = std::pair<size_t, size_t>;

// Views that follow each other by name and yet look in directions more than 60 degrees apart and
// share hardly a point, where views that follow each other do not elsewhere; eight at most. None
// where there is one only.
std::vector<ViewPair> find_jumps(const SceneInput& input);

// Where matches between the photos of two jumps or more say that they stand together, cameras are
// found anew (found_cameras.h), which takes minutes; says in input.notes what was done. The matches
// are made in options.work_folder, which takes seconds for each photo; the answer is kept there.
// Nothing happens where there are no jumps, no colmap or no folder, or colmap fails. Throws
// Cancelled. Returns whether cameras were found.
bool unfold(SceneInput& input, const SceneOptions& options,
            const std::function<void(const std::string&)>& progress, const Cancel* cancel);

}  // namespace nerf::internal
