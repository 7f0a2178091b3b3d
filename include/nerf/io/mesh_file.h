// Surfaces, points and cameras as files for other programs: glTF 2.0 (GLB) and PLY.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "nerf/geometry/triangle_mesh.h"
#include "nerf/io/camera_path.h"
#include "nerf/math/vec.h"
#include "nerf/model/model_info.h"

namespace nerf {

// Input coordinates to those of glTF, whose unit is the metre and whose +y is up: the engine's axes
// and centre, so that a scene stands upright on the origin. metres: of one input unit.
Similarity input_to_gltf(const ModelInfo& info, double metres = 1);

// Binary PLY of a mesh, or of points where it has no triangles: x, y, z (float, or double where
// floats are too coarse), nx, ny, nz and red, green, blue (sRGB, 8 bits) where the mesh has them.
// to_file: from the mesh's coordinates to the file's. Throws Error.
void write_ply(const std::filesystem::path& path, const TriangleMesh& mesh,
               const Similarity& to_file);

// A mesh with normals and vertex colours as GLB. Colours are emitted as they are (extension
// KHR_materials_unlit): light is in them. to_gltf: from the mesh's coordinates; input_to_gltf: is
// written into the file (asset.extras, 4x4, column by column), so that others find their way back.
// Throws Error.
void write_glb(const std::filesystem::path& path, const TriangleMesh& mesh,
               const Similarity& to_gltf, const Similarity& input_to_gltf);

// The training cameras as glTF cameras (nodes named after the photos, the lens's numbers in their
// extras) and, where it has frames, a path as one more, animated camera. Cameras that look all
// around are no glTF cameras: nodes without one. Returns what could not be said, for the user.
// Throws Error.
std::vector<std::string> write_glb_cameras(const std::filesystem::path& path, const ModelInfo& info,
                                           const CameraPath& camera_path,
                                           const Similarity& input_to_gltf);

}  // namespace nerf
