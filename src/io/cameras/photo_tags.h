// What cameras write beside the pixels (EXIF) that helps to find where photos were taken.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>

namespace nerf::internal {

struct PhotoTags {
  int width = 0, height = 0;
  // Maker, model and number of the device, lens, focal length and zoom: photos of one device and
  // lens have the same text. Empty where the file does not name a device.
  std::string device;
  int orientation = 1;                         // EXIF's 1 to 8, of the pixels as stored
  std::optional<std::array<double, 2>> place;  // latitude and longitude in degrees
};

// Reads only the header. Throws Error: missing, not an image, sizes that no photo has.
PhotoTags read_photo_tags(const std::filesystem::path& path);

}  // namespace nerf::internal
