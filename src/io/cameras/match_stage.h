// Second stage: matches between photos, and which of them agree with a geometry.
#pragma once

#include <filesystem>

#include "io/cameras/capture_photos.h"
#include "io/cameras/colmap_program.h"
#include "io/cameras/photo_pairs.h"
#include "io/cameras/stage_progress.h"
#include "nerf/base/threads.h"

namespace nerf::internal {

// Matches descriptors of pairs that may show the same things and writes the matches into the
// database. Pairs that have been matched are not matched again. Throws Error, Cancelled.
void match_features(const CapturePhotos& photos, const std::filesystem::path& database,
                    const PairSettings& settings, ThreadPool& pool, const Tell& tell,
                    const Cancel* cancel);

// Has colmap estimate the geometry of each matched pair that has none, which drops false matches.
void verify_matches(const ColmapProgram& colmap, const std::filesystem::path& database,
                    const Tell& tell);

}  // namespace nerf::internal
