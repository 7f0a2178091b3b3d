// First stage: features of every photo, through colmap.
#pragma once

#include <filesystem>
#include <string>

#include "io/cameras/capture_photos.h"
#include "io/cameras/colmap_program.h"
#include "io/cameras/stage_progress.h"

namespace nerf::internal {

struct FeatureSettings {
  // Photos are reduced to this before features are looked for.
  int longest_side = 2400;
  // Photos below this are doubled first, which takes four times as long: 1080 x 1920 photos give
  // half as many features undoubled but 9 in 10 of the matches; 800 x 533 ones a quarter.
  int doubled_below = 1200;
  double peak_threshold = 0.0067;  // of a feature's contrast; COLMAP's default

  // A lens with eight numbers is more than few photos can tell.
  size_t photos_for_opencv = 8;

  std::string text() const;  // for keys
};

inline constexpr const char* kAutoCameraModel = "auto";

// Looks for features of the photos that `database` lacks. One camera for each device and lens, its
// focal length as EXIF has it where it does. `camera_model`: see capture_tools.h.
void find_features(const ColmapProgram& colmap, const CapturePhotos& photos,
                   const std::filesystem::path& database, const std::string& camera_model,
                   const FeatureSettings& settings, const Tell& tell);

}  // namespace nerf::internal
