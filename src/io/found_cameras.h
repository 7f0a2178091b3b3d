// A capture's cameras found anew from its photos, where the files' own are a little wrong and say
// nothing by which they could be mended: poses of a phone's sensors, models without keypoints.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "nerf/base/cancel.h"
#include "scene_input.h"

namespace nerf::internal {

// The similarity that brings poses to where others of the same cameras are, as well as it can: the
// rotation from their axes, scale and place from their centres, both with the least sum of
// distances (Weiszfeld's reweighting), so that some of either may be wrong. None where there are
// fewer than three or the first ones' centres coincide.
std::optional<Similarity> similarity_between(std::span<const Pose> from, std::span<const Pose> to);

// Cameras, poses and points of `found`, whose views are a part of `input`'s (view_of: which), moved
// to where the given cameras are; points in place of those that the given cameras saw, beside none
// that were measured. Views that were not found, or whose photo has another size there, stay. Says
// in input.notes what was done. Leaves `input` as it is where fewer than half of the views were
// found.
bool take_found_cameras(const SceneInput& found, const std::vector<size_t>& view_of,
                        SceneInput& input);

// These views' photos in `folder`, under the views' indices whatever names they have, in a folder
// for each camera; where nearly each view has a camera of its own in one.
void link_photos(const SceneInput& input, const std::vector<size_t>& which,
                 const std::filesystem::path& folder);
// Of the name of a photo that was linked, the view.
size_t linked_view(const std::string& name);

// Has colmap find the cameras of input's photos below options.work_folder (capture_tools.h), which
// takes minutes, and takes them as above. Throws Error: no work folder, and as
// run_colmap_on_photos(); Cancelled.
bool find_cameras_anew(SceneInput& input, const SceneOptions& options,
                       const std::function<void(const std::string&)>& progress,
                       const Cancel* cancel);

}  // namespace nerf::internal
