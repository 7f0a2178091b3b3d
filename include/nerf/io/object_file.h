// Objects from glTF 2.0 files (GLB, or JSON with its files beside it).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "nerf/geometry/object.h"

namespace nerf {

struct ReadObject {
  SceneObject object;              // glTF's coordinates: metres, +y up
  std::vector<std::string> notes;  // for the user: what in the file was not used
};

// The triangles of the file's scene, its nodes' transforms made, with materials and textures (PNG
// and JPEG). Without skins, animations and morph targets: as the nodes stand. Throws Error that
// names the part of the file: not glTF, truncated, buffers missing, accessors beyond their buffers,
// nodes in a circle, no triangle with an area, coordinates that are not finite, textures that do
// not decode, extensions that are required and not known here.
ReadObject read_object(const std::filesystem::path& path);

}  // namespace nerf
