// Cameras as other programs read them: a COLMAP text model and a transforms.json.
#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "nerf/math/camera.h"

namespace nerf {

struct CameraOfPhoto {
  std::string name;  // below the folder of the images, for COLMAP
  std::string file;  // from where the transforms.json is to stand
  Camera camera;
  Pose pose;  // camera-to-world, OpenCV axes
};

// cameras.txt, images.txt and points3D.txt, the latter and the images without any point, into the
// folder, which is made. Photos with the same camera share one.
void write_colmap_text(const std::filesystem::path& folder, std::span<const CameraOfPhoto> photos);

// With the intrinsics of each frame; x right, y up, z backward. The thin-prism and FOV lenses have
// no name there: Error.
void write_transforms(const std::filesystem::path& file, std::span<const CameraOfPhoto> photos);

// Whether write_transforms() can say the model.
bool transforms_know(CameraModel model);

}  // namespace nerf
