// Depth maps as files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "nerf/io/depth_map.h"
#include "nerf/io/scene.h"
#include "scene_input.h"

namespace nerf::internal {

struct DepthImage {
  int width = 0, height = 0;
  bool integers = false;
  std::vector<float> values;  // as stored, in the file's unit
};

// One channel of integers (PNG, TIFF) or of floats (EXR, TIFF; of several the one named Z, else the
// first), or an .npy array [rows][columns] of floats or unsigned integers. Throws Error that names
// the file: missing, damaged, a colour picture, 8 bits.
DepthImage read_depth_image(const std::filesystem::path& path);

// Which of the views' maps exist, their units where the files do not say them, what they take in
// memory; a word on each in the report. Files' integers are 1/1000 (nerfstudio's
// depth_unit_scale_factor); so are floats, unless cameras would then stand much further apart than
// what they see.
void resolve_depths(SceneInput& input, SceneReport& report);

// The view's map for a photo that is shown as width x height pixels and that `orientation` (EXIF's)
// turned; `scale`: engine units of an input unit. Depths that are not above 0, not finite, beyond
// View::depth_reach or of no confidence are unknown. Throws Error, also for another shape than the
// photo's.
DepthMap read_depth_map(const View& view, int orientation, int width, int height, double scale);

}  // namespace nerf::internal
