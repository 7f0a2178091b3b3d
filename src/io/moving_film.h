// Does something move in a film, beside the camera?
#pragma once

#include <functional>
#include <string>

#include "nerf/base/cancel.h"
#include "scene_input.h"

namespace nerf::internal {

// Of input's views, frames of a film with times and cameras: whether at least 200 corners can be
// followed, and at least 6 % of them are of no point that stands still (corner_tracks.h). Measured:
// 11 % where a hand moves among books, 40 % where things turn and open, 3 % of a room with a shiny
// table that stands still. Says in `report` what it found. Throws Error where a frame cannot be
// read; Cancelled.
bool film_moves(const SceneInput& input, SceneReport& report,
                const std::function<void(const std::string&)>& progress, const Cancel* cancel);

}  // namespace nerf::internal
