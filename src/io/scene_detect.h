// Which of the formats a path holds, and reading it.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "nerf/base/cancel.h"
#include "scene_input.h"

namespace nerf::internal {

// The first format, in the order of SceneFormat, that `path` has the files of; Error where it has
// none.
SceneFormat detect_format(const std::filesystem::path& path);

// `path`, or the folder in it that holds the scene where it holds nothing else, as archives that
// are unpacked into a folder of their own leave it. `own` is the run's folder, which does not
// count.
std::filesystem::path unwrapped(const std::filesystem::path& path,
                                const std::filesystem::path& own);

// What else lies in the folder `path`, whose scene is read as `used`.
std::vector<std::string> inputs_beside(const std::filesystem::path& path, SceneFormat used);

// What photos and videos need besides a path.
struct CaptureRun {
  const SceneOptions& options;
  const std::function<void(const std::string&)>& progress;
  const Cancel* cancel;
};

// Reads `path` as the format; runs colmap and ffmpeg where it has to.
SceneInput read_scene_input(const std::filesystem::path& path, SceneFormat format,
                            const CaptureRun& run);

}  // namespace nerf::internal
