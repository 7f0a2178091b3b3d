// The stages from photos to a model, one after the other, and again with other settings.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "nerf/base/cancel.h"
#include "nerf/io/capture_tools.h"

namespace nerf::internal {

struct CameraSearch {
  std::string camera_model = {};  // see run_colmap_on_photos()
  bool lenses_are_known = false;  // as the photos' EXIF says, exactly: nothing is left to adjust
  bool is_film = false;           // the photos' names are in the order of a film's frames
  // Share of the capture that a model in a folder places, where that is not the share of photos.
  // Below nine tenths other settings are tried.
  std::function<double(const std::filesystem::path& model)> placed = {};

  std::string text() const;  // for keys
};

// run_colmap_on_photos() is this with a camera model alone.
std::filesystem::path find_cameras(const std::filesystem::path& images,
                                   const CaptureFolders& folders, const CameraSearch& search,
                                   const std::function<void(const std::string&)>& progress,
                                   const Cancel* cancel);

}  // namespace nerf::internal
