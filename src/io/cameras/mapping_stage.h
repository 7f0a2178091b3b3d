// Last stage: cameras from matches, through colmap's mapper.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "io/cameras/capture_photos.h"
#include "io/cameras/colmap_program.h"
#include "io/cameras/stage_progress.h"

namespace nerf::internal {

// A model as colmap wrote it, and how many photos it places.
struct MappedModel {
  std::filesystem::path folder;  // empty: none
  int64_t photos = 0;
};

struct MapSettings {
  // Weaker pairs of photos will do, where nothing was found with COLMAP's own thresholds.
  bool eager = false;
  // Cameras in the database are right as they are.
  bool lenses_are_known = false;
};

// Models go to folders below `folder`, which is emptied first; where there are several that do not
// join, the largest counts, and a line says what it leaves out. Where close pairs of photos
// contradict the model (lookalikes.h), photos are mapped again without the pairs that misled it,
// below a folder beside that one, and once more where that is misled as well. The best model
// counts; of the database, what is verified of the pairs that it did without is then gone.
MappedModel map_photos(const ColmapProgram& colmap, const CapturePhotos& photos,
                       const std::filesystem::path& database, const std::filesystem::path& folder,
                       const MapSettings& map, const Tell& tell);

}  // namespace nerf::internal
