// Photos as cameras store them to photos that colmap reads.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/io/capture_tools.h"

namespace nerf::internal {

// Whether colmap cannot be expected to read files of this kind, though they are photos: HEIF, AVIF,
// JPEG XL, a camera's raw data.
bool needs_conversion(const std::filesystem::path& photo);

// A link to the photo, or a copy where the file system has no links. Throws Error.
void link_or_copy_photo(const std::filesystem::path& photo, const std::filesystem::path& to);

// The folder that colmap is to be run on: `photos` itself where it can read all of them. Else one
// below folders.work with the same names, in which such photos are JPEG (PNG where they have
// alpha), upright, with the EXIF data of the original, and the others are links. A photo that lies
// there in two formats under one name counts once, as the one that colmap reads. What an earlier
// call converted is used again. `notes` gets lines for the report. Throws Error, Cancelled.
std::filesystem::path prepared_photos(const std::filesystem::path& photos,
                                      const CaptureFolders& folders,
                                      const std::function<void(const std::string&)>& progress,
                                      const Cancel* cancel, std::vector<std::string>& notes);

}  // namespace nerf::internal
