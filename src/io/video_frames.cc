// A video to its sharpest frames, in two passes of ffmpeg: the first scores every frame on a small
// grey copy that never touches the disk, the second stores the chosen ones.
#include <fmt/format.h>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/process.h"
#include "nerf/io/capture_tools.h"
#include "paths.h"
#include "sharpness.h"
#include "staged_folder.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using Progress = std::function<void(const std::string&)>;

constexpr size_t kFramesPerLine = 300;  // of progress

std::vector<double> score_frames(const std::string& ffmpeg, const fs::path& video,
                                 const Progress& progress, const Cancel* cancel) {
  internal::GreyStream stream;
  size_t told = 0;
  ProcessOptions options;
  options.cancel = cancel;
  options.on_output = [&](std::span<const uint8_t> bytes) {
    stream.add(bytes);
    if (!progress || stream.scores().size() < told + kFramesPerLine) return;
    told = stream.scores().size();
    progress(fmt::format("ffmpeg: looked at {} frames", told));
  };
  // V leaves out cover pictures; -vsync 0 gives every frame once, so that the second pass counts
  // alike.
  const ProcessResult result =
      run_process({ffmpeg, "-nostdin", "-v", "error", "-i", video.string(), "-map", "0:V:0", "-vf",
                   "scale=w='min(960,iw)':h=-2", "-vsync", "0", "-pix_fmt", "gray", "-f",
                   "yuv4mpegpipe", "-strict", "-1", "-"},
                  options);
  // A film whose end is missing still has its frames.
  if (!stream.scores().empty()) return stream.scores();
  throw Error("no frame can be read from the video" +
                  (result.last_lines.empty() ? "" : ": " + result.last_lines),
              video.string(), "check that it is a video that ffmpeg can play");
}

void store_frames(const std::string& ffmpeg, const fs::path& video, const std::vector<int>& chosen,
                  const fs::path& folder, const Progress& progress, const Cancel* cancel) {
  std::string filter = "select='";
  for (size_t i = 0; i < chosen.size(); ++i) {
    filter += fmt::format("{}eq(n,{})", i == 0 ? "" : "+", chosen[i]);
  }
  filter += "'";
  if (progress) progress(fmt::format("ffmpeg: storing the {} sharpest frames", chosen.size()));
  // In a file: a long list of frames would not fit on a command line.
  const fs::path script = folder.string() + ".filter";
  write_file_atomically(script, filter);
  ProcessOptions options;
  options.cancel = cancel;
  options.folder = folder;  // a % of its name would be taken for a pattern
  ProcessResult result;
  try {
    result = run_process({ffmpeg, "-nostdin", "-v", "error", "-i", video.string(), "-map", "0:V:0",
                          "-filter_script:v", script.string(), "-vsync", "0", "-q:v", "1", "-qmin",
                          "1", "-f", "image2", "frame_%06d.jpg"},
                         options);
  } catch (...) {
    fs::remove(script);
    throw;
  }
  fs::remove(script);
  const auto stored = std::distance(fs::directory_iterator(folder), fs::directory_iterator());
  if (stored != static_cast<std::ptrdiff_t>(chosen.size())) {
    throw Error(fmt::format("ffmpeg stored {} of {} frames{}{}", stored, chosen.size(),
                            result.last_lines.empty() ? "" : ": ", result.last_lines),
                folder.parent_path().string(), "check that the disk is not full");
  }
}

}  // namespace

fs::path extract_video_frames(const fs::path& video, const fs::path& work_folder, int max_frames,
                              const Progress& progress, const Cancel* cancel) {
  if (max_frames < 1) throw Error("at least one frame is needed", video.string());
  std::error_code failed;
  const auto bytes = fs::file_size(video, failed);
  if (failed) throw errno_error(failed.value(), "cannot read the video", video);
  const std::string key =
      fmt::format("{}\n{} {}\n{}\n", fs::weakly_canonical(video).string(), bytes,
                  fs::last_write_time(video, failed).time_since_epoch().count(), max_frames);
  const fs::path result = work_folder / "frames";
  if (internal::StagedFolder::is_complete(result, key)) {
    if (progress) progress("ffmpeg: using the frames stored earlier in " + result.string());
    return result;
  }
  const std::string ffmpeg =
      require_program("ffmpeg", "ffmpeg", "reads frames from a video").string();
  make_writable_folder(work_folder);
  internal::StagedFolder staged(result);
  if (progress) progress("ffmpeg: looking for the sharpest frames of " + video.string());
  // Absolute: ffmpeg would take "a:b.mp4" for a protocol and "-v.mp4" for an option.
  const fs::path source = fs::absolute(video);
  const std::vector<double> scores = score_frames(ffmpeg, source, progress, cancel);
  store_frames(ffmpeg, source, internal::sharpest_of_windows(scores, max_frames),
               fs::absolute(staged.path()), progress, cancel);
  staged.commit(key);
  return result;
}

}  // namespace nerf
