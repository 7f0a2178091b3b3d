// Camera paths as other tools write them, and whose coordinates they are in.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "nerf/io/camera_path.h"

namespace nerf::internal {

// What a reader of a format is given. `folder` is where the file lies.
struct PathSource {
  const nlohmann::json& document;
  const ModelInfo& info;
  std::string where, frame_prefix;
  std::filesystem::path folder;

  std::string frame_name(size_t i) const;
};

// JSON of any of the tools. Throws Error with line and column.
nlohmann::json parse_path_json(const std::string& text, const std::string& where);

// transforms.json of nerfstudio, instant-ngp or Blender as a path: every frame's pose, with the
// intrinsics that the file gives.
CameraPath read_transforms_path(const PathSource& source);

// A list of poses, as nerfstudio exports its cameras: {"file_path", "transform": 3x4 or 4x4},
// OpenGL axes.
CameraPath read_pose_list(const PathSource& source);

// instant-ngp's base_cam.json: key poses that a uniform cubic B-spline runs through.
CameraPath read_instant_ngp_path(const PathSource& source);

// A folder of cameras in Nerfies' layout, camera-paths/NAME, in order of the files' names. They say
// no times: of a model of several moments these pass once along the path.
CameraPath read_nerfies_path(const std::filesystem::path& folder, const ModelInfo& info);

// A camera of a glTF file, with its animation.
CameraPath read_gltf_path(const std::filesystem::path& file, const ModelInfo& info,
                          const PathReading& reading);

// Camera-to-world matrix of rows with OpenGL camera axes, of which a uniform scale is dropped.
Pose opengl_pose(const nlohmann::json& rows, const std::string& where);

// Brings a path that a nerfstudio run wrote in its own normalised space back to the input model's
// coordinates. `transform` is that run's dataparser_transforms.json; where it is empty, the one
// beside `file`, if `look_beside`, there is one, and the cameras then lie nearer to the model's.
// Adds notes, also where the path lies far from the model's cameras.
void place_path(CameraPath& path, const std::filesystem::path& file,
                const std::filesystem::path& transform, const ModelInfo& info, bool look_beside);

}  // namespace nerf::internal
