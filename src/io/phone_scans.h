// Captures of phone applications that know the camera's poses, in the words of a transforms file.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

namespace nerf::internal {

// Whether the folder is one of
// - Polycam's raw data: keyframes/corrected_cameras/*.json with corrected_images/, or cameras/ with
//   images/;
// - Record3D's export: metadata.json with rgb/.
bool is_phone_scan(const std::filesystem::path& root);

struct PhoneScan {
  std::string format;           // "Polycam raw data"
  std::filesystem::path where;  // what was read, for errors
  nlohmann::json transforms;    // frames with names below the folder
};

// Throws Error that names the file.
PhoneScan read_phone_scan(const std::filesystem::path& root);

}  // namespace nerf::internal
