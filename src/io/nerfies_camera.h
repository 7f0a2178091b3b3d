// Cameras of Nerfies' layout (Park et al. 2021): of its photos, camera/ID.json, and of its paths,
// camera-paths/NAME/*.json.
#pragma once

#include <filesystem>
#include <vector>

#include "nerf/math/camera.h"

namespace nerf::internal {

struct NerfiesCamera {
  Camera camera;
  Pose pose;  // camera-to-world, OpenCV axes, which are also the file's
};

// "orientation" is world-to-camera, row by row; "focal_length" along x, times "pixel_aspect_ratio"
// along y; "radial_distortion" are k1, k2, k3 and "tangential_distortion" (also "tangential") p1,
// p2 of OpenCV; pixel centres at 0.5. Throws Error that names file and entry; so for a skew that
// moves a pixel, which no lens here has.
NerfiesCamera read_nerfies_camera(const std::filesystem::path& file);

// The files of a path's cameras in a folder, in order of their names; empty where there are none.
std::vector<std::filesystem::path> nerfies_path_files(const std::filesystem::path& folder);

}  // namespace nerf::internal
