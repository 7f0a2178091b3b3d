// Points that lie beside a capture in a file of their own: a reconstruction's (nerfstudio's
// sparse_pc.ply, 3D Gaussian splatting's points3D.ply), or a laser's.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "scene_input.h"

namespace nerf::internal {

// Gives a capture that has no points those of input.point_files or of a PLY file in `root`, the
// first that can be read; what a file that nobody named holds must be what the cameras look at.
// Where the input has points already, and for files that are of no use, the report says so.
void add_points_from_files(SceneInput& input, const std::filesystem::path& root,
                           SceneReport& report);

// Indices of some 20,000 of the points at most, spread evenly, that fall into the camera's picture.
std::vector<size_t> points_in_picture(const std::vector<ScenePoint>& points, const Camera& camera,
                                      const Pose& pose);

}  // namespace nerf::internal
