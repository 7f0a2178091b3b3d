// Captures of phone applications that know the camera's poses, in the words of a transforms file.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace nerf::internal {

// Whether the folder is one of
// - Polycam's raw data: keyframes/corrected_cameras/*.json with corrected_images/, or cameras/ with
//   images/, depth/ and confidence/ where they are there;
// - Record3D's export: metadata.json with rgb/, depth/ where it is there.
bool is_phone_scan(const std::filesystem::path& root);

struct PhoneScan {
  std::string format;                  // "Polycam raw data"
  std::filesystem::path where;         // what was read, for errors
  nlohmann::json transforms;           // frames with names below the folder
  std::vector<std::string> ignored{};  // what is there and not used, for people
};

// Throws Error that names the file.
PhoneScan read_phone_scan(const std::filesystem::path& root);

}  // namespace nerf::internal
