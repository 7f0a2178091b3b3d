// Cameras of a COLMAP model that do not fit its own points (poses from a phone's sensors with
// points triangulated from them, models that were edited or written without a last adjustment), and
// lenses of which each photo was given one.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "colmap.h"
#include "nerf/base/cancel.h"

namespace nerf::internal {

// Median distance of keypoints from where their points are projected to, above which cameras are
// wrong, and below which they fit: pixels, or a share of the photos' longest side if that is more.
// COLMAP's own models have 0.2 to 1.3 pixels; it drops keypoints that are 4 off.
inline constexpr double kWrongCameras = 2, kWrongOfSide = 0.001;

// Whether the model says where in its photos it saw its points.
bool has_keypoints(const ColmapModel& model);

// Adjusts cameras, poses and points to the model's keypoints (math/bundle_adjustment.h) where
// `wanted` says so, or, with kAuto, where they are wrong. They stay as they are where that leaves
// them wrong or, with kAuto, more than half as wrong, and where there are no keypoints or where
// there are panoramas. Then photos of one size that have a lens each get one for all, RADIAL
// (square pixels), where that explains the keypoints as well. Says in `notes` what was done.
// Returns whether cameras were changed. Points' errors are the new ones. Throws Cancelled.
bool adjust_cameras(AdjustCameras wanted, ColmapModel& model, std::vector<std::string>& notes,
                    const std::function<void(const std::string&)>& progress = {},
                    const Cancel* cancel = nullptr);

}  // namespace nerf::internal
