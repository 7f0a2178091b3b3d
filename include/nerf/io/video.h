// Pictures to a film, through the program `ffmpeg`.
#pragma once

#include <filesystem>
#include <functional>
#include <vector>

#include "nerf/base/cancel.h"

namespace nerf {

struct VideoOptions {
  double frames_per_second = 30;
  int quality = 18;  // x264's constant rate factor: 0 lossless, 51 worst
  const Cancel* cancel = nullptr;
  std::function<void(int done, int total)> progress;
};

// What write_video needs besides frames, to be known before these are made: the program, which it
// returns, and a folder for temporary files. Throws Error.
std::filesystem::path check_video_tools();

// Writes an MP4 (H.264, 4:2:0, BT.709) of the frames in the order given; they are image files of
// one size. An odd width or height loses its last column or row, which the format cannot hold. The
// film appears whole or not at all. Throws Error: ffmpeg not installed (with the command that
// installs it), no frame, a frame missing or of another size, output not writable. Throws
// Cancelled.
void write_video(const std::filesystem::path& path,
                 const std::vector<std::filesystem::path>& frames,
                 const VideoOptions& options = {});

}  // namespace nerf
