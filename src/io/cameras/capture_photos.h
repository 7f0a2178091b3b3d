// The photos of a capture whose cameras are to be found.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "io/cameras/photo_tags.h"
#include "nerf/io/capture_tools.h"

namespace nerf::internal {

struct CapturePhoto {
  std::string name;  // below the folder
  PhotoTags tags;
};

struct CapturePhotos {
  std::filesystem::path folder;      // absolute
  std::vector<CapturePhoto> photos;  // in the order of names

  // Indices of photos that one camera took: the same device, lens and zoom and the same size, or,
  // where files do not say, the same folder and size.
  std::vector<std::vector<int>> cameras() const;
  // Differs where a photo was changed, added or removed.
  std::string key() const;
  std::string names(const std::vector<int>& which) const;  // a line each
  std::string names() const;
};

// Names of the photos below a folder, as list_images() gives them, without a run's own pictures.
std::vector<std::string> capture_photo_names(const std::filesystem::path& folder,
                                             const CaptureFolders& run);

// Looks at the header of every photo below the folder, leaving out a run's own pictures. Throws
// Error: fewer than two photos, a truncated one.
CapturePhotos look_at_photos(const std::filesystem::path& folder, const CaptureFolders& run);

}  // namespace nerf::internal
