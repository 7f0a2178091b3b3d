// Which files are videos.
#pragma once

#include <filesystem>

#include "paths.h"

namespace nerf::internal {

// Cameras that see all round write these in forms of their own: pictures of two fisheye lenses, or
// the faces of a cube.
inline bool is_spherical_video_file(const std::filesystem::path& path) {
  const std::string extension = lower_extension(path);
  return extension == ".insv" || extension == ".360";
}

}  // namespace nerf::internal
