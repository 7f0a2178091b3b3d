// What a transforms file says besides images and cameras.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "scene_input.h"
#include "transforms_camera.h"

namespace nerf::internal {

// Names of entries that are read, of the file and of its frames.
bool is_read_entry(const std::string& key);

// Adds the entries of `object` that are not read to `unread`.
void collect_unread(const nlohmann::json& object, std::set<std::string>& unread);

// Lines for the report's list of what was not used.
std::vector<std::string> describe_unread(const std::set<std::string>& unread,
                                         const std::string& file);

// Reads the entries of the whole file: ply_file_path, up, orientation_override.
void read_common_entries(const nlohmann::json& root, const std::filesystem::path& file,
                         SceneInput& input);

// Of a frame: depth_file_path (nerfstudio's) or depth_path (instant-ngp's), the unit,
// depth_unit_scale_factor or integer_depth_scale (nothing where instant-ngp's enable_depth_loading
// is false), and, of no other program, depth_confidence_path (0
// where depth is not to be trusted) and depth_reach (input units, beyond which it is not).
void read_depth_entries(const FrameJson& frame, const std::filesystem::path& root, View& view);

// train_filenames, test_filenames and, where there are none of the latter, val_filenames: sets
// input.is_test (empty where the file makes no split) and leaves out views that are on neither
// side. A view on both is held out.
void obey_split(const nlohmann::json& root, const std::filesystem::path& file, SceneInput& input);

}  // namespace nerf::internal
