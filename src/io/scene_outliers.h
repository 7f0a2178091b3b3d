// Cameras that a reconstruction placed where nobody stood.
#pragma once

#include "scene_input.h"

namespace nerf::internal {

// Leaves out, with a warning that names them, the cameras that stand more than kFarOut times as far
// from the middle of all as four fifths of them do (and as most of the points do). One that stands
// nearer is believed: photos may be taken from afar.
inline constexpr double kFarOut = 50;
void drop_far_cameras(SceneInput& input, SceneReport& report);

}  // namespace nerf::internal
