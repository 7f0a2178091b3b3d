// From the command line and what the model knows to a list of pictures: cameras, sizes, files.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "nerf/io/camera_path.h"
#include "nerf/math/camera.h"
#include "nerf/math/vec.h"
#include "nerf/model/model_info.h"
#include "nerf/parts/codes.h"
#include "render_options.h"
#include "stereo.h"

namespace nerf::apps {

struct PlannedFrame {
  std::string name;             // of the view
  Camera camera;                // at the size to render; of a stereo picture the left eye's
  Pose camera_to_world;         // input coordinates
  double time = 0;              // [0, 1]
  double seconds = 0;           // since the film's beginning, of what is inserted
  Appearance appearance;        // empty parts: the model's own
  std::optional<Eye> right;     // of a stereo picture
  std::filesystem::path color;  // files, below the output folder
  std::filesystem::path depth;  // empty: not wanted
  std::filesystem::path film;   // the film's frame; empty: it is the colour's
};

struct RenderPlan {
  std::vector<PlannedFrame> frames;
  PictureKind picture = PictureKind::kPerspective;
  double fps = 30;
  LookOptions look;
  std::vector<std::string> notes;  // for the user
};

// What a plan asks of the model besides its info.
struct ModelAnswers {
  PathOptions::Density density = {};  // where an orbit would pass
  bool shows_background = true;       // see RadianceField
  bool moves = true;                  // whether its pictures depend on their time
};

// The model file of a RUN argument: the file itself, or model.nerf in that folder. Throws Error.
std::filesystem::path find_model_file(const std::filesystem::path& run);

// Throws Error for views that are neither a known word nor a file, what make_camera_path and
// read_camera_path refuse, --frames and --camera where the views have their own, --ipd where there
// are no two eyes, times that the capture does not have, pictures that do not fit into
// `memory_bytes`, and pictures of different sizes where a video is wanted.
RenderPlan make_render_plan(const RenderCommand& command, const ModelInfo& info,
                            uint64_t memory_bytes, const ModelAnswers& model = {});

// File of a view's picture below a folder: sub-folders kept, extension replaced by .png, parts that
// would lead out of the folder ("..", a leading "/") dropped.
std::filesystem::path picture_file(const std::string& view_name);

}  // namespace nerf::apps
