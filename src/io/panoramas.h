// Photos of 360 x 180 degrees without poses.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/io/capture_tools.h"
#include "scene_input.h"

namespace nerf::internal {

// Whether all the photos are whole panoramas: twice as wide as high, and either named so in the
// first one's XMP (GPano:ProjectionType equirectangular) or, as far as a few of them show, made
// like a sphere: the left edge goes on at the right one, and the upper and lower ones are a point
// each.
bool are_panoramas(const std::filesystem::path& folder, const std::vector<std::string>& names);

// File of cut k of the i-th panorama.
std::string cut_name(size_t i, int k);

// The panoramas with the poses that their cuts agree on, from the model of the cuts. Those without
// are left out with a warning. Throws Error for a photo that is no whole panorama.
SceneInput panoramas_of_cuts(SceneInput cuts, const std::filesystem::path& photos,
                             const std::vector<std::string>& names);

// Cuts panoramas into perspective views below folders.work, has colmap find their cameras, and
// returns panoramas_of_cuts(). Throws Error, Cancelled.
SceneInput read_panoramas(const std::filesystem::path& photos,
                          const std::vector<std::string>& names, const CaptureFolders& folders,
                          const std::function<void(const std::string&)>& progress,
                          const Cancel* cancel);

}  // namespace nerf::internal
