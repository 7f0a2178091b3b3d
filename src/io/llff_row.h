// What LLFF says of a photo, also where a later program of its family wrote it.
#pragma once

#include <string>

#include "scene_input.h"

namespace nerf::internal {

enum class LlffAxes {
  kDownRightBack,  // as LLFF stores a camera's axes in poses_bounds.npy
  kRightUpBack,    // as load_llff.py hands them on, OpenGL's
};

struct LlffRow {
  Camera camera;
  Pose pose;
  SceneInput::Depths depths;
};

// v: 17 numbers, 3 x 5 row by row (columns: the three axes, the position, and height, width and
// focal length in pixels), then the nearest and the farthest depth. Throws Error at `where`.
LlffRow parse_llff_row(const double* v, LlffAxes axes, const std::string& where);

// Adds a view of that name below input.image_folder.
void add_llff_view(const LlffRow& row, const std::string& name, SceneInput& input);

}  // namespace nerf::internal
