// Materials and textures of glTF files.
#pragma once

#include <tiny_gltf.h>

#include <filesystem>
#include <string>
#include <vector>

#include "nerf/geometry/object.h"

namespace nerf::internal {

// Fills the object's materials, one more than the file has, for primitives without one, and its
// textures. Adds notes on what is not used. Throws Error.
void read_gltf_materials(const tinygltf::Model& model, const std::filesystem::path& path,
                         SceneObject& object, std::vector<std::string>& notes);

}  // namespace nerf::internal
