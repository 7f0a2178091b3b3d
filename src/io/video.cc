#include "nerf/io/video.h"

#include <fmt/format.h>
#include <stdlib.h>

#include <cerrno>
#include <charconv>
#include <cmath>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/process.h"
#include "nerf/io/image.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;

fs::path temporary_folder() {
  std::error_code failed;
  const fs::path folder = fs::temp_directory_path(failed);
  if (!failed) return folder;
  const char* name = ::getenv("TMPDIR");
  throw Error("there is no folder for temporary files", name ? name : "TMPDIR",
              "set TMPDIR to a folder that exists");
}

// A folder of links that number the frames: ffmpeg wants one pattern for all names.
class NumberedFrames {
 public:
  explicit NumberedFrames(const std::vector<fs::path>& frames) {
    std::string name = (temporary_folder() / "nerf_frames_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) {
      throw errno_error(errno, "cannot create a temporary folder", name);
    }
    folder_ = name;
    std::error_code failed;
    for (size_t i = 0; i < frames.size() && !failed; ++i) {
      fs::create_symlink(fs::absolute(frames[i]),
                         folder_ / fmt::format("{:08}{}", i, frames[0].extension().string()),
                         failed);
    }
    extension_ = frames[0].extension().string();
    if (failed) {
      clear();
      throw errno_error(failed.value(), "cannot create links", folder_);
    }
  }
  ~NumberedFrames() { clear(); }
  NumberedFrames(const NumberedFrames&) = delete;
  NumberedFrames& operator=(const NumberedFrames&) = delete;

  const fs::path& folder() const { return folder_; }
  std::string pattern() const { return "%08d" + extension_; }

 private:
  void clear() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  fs::path folder_;
  std::string extension_;
};

void check_frames(const std::vector<fs::path>& frames, const fs::path& film) {
  if (frames.empty()) throw Error("there is no frame for the film", film.string());
  const ImageInfo first = read_image_info(frames[0]);
  if (first.width < 2 || first.height < 2) {
    throw Error(
        fmt::format("a frame of {} x {} pixels is too small for a film", first.width, first.height),
        frames[0].string(), "render at least 2 x 2 pixels");
  }
  for (const fs::path& frame : frames) {
    const ImageInfo info = read_image_info(frame);
    if (info.width != first.width || info.height != first.height) {
      throw Error(fmt::format("this frame is {} x {} pixels and the first one {} x {}", info.width,
                              info.height, first.width, first.height),
                  frame.string(), "give all frames one --size");
    }
    check_image_complete(frame);
    if (frame.extension() != frames[0].extension()) {
      throw Error("the frames of a film must be of one type", frame.string());
    }
  }
}

}  // namespace

fs::path check_video_tools() {
  temporary_folder();
  return require_program("ffmpeg", "ffmpeg", "writes films");
}

void write_video(const fs::path& path, const std::vector<fs::path>& frames,
                 const VideoOptions& options) {
  const std::string ffmpeg = check_video_tools().string();
  if (!(options.frames_per_second > 0) || !(options.frames_per_second <= 1000)) {
    throw Error("frames per second must be above 0 and at most 1000", "--fps");
  }
  check_frames(frames, path);
  const NumberedFrames numbered(frames);
  ProcessOptions process;
  process.cancel = options.cancel;
  process.folder = numbered.folder();
  process.on_line = [&](std::string_view line) {
    if (!options.progress || !line.starts_with("frame=")) return;
    int done = 0;
    std::from_chars(line.data() + 6, line.data() + line.size(), done);
    options.progress(done, static_cast<int>(frames.size()));
  };
  write_file_atomically(path, [&](const fs::path& temporary) {
    run_process_or_throw(
        {ffmpeg,
         "-nostdin",
         "-v",
         "error",
         "-xerror",  // else a damaged frame is left out and the film is written all the same
         "-progress",
         "pipe:1",
         "-y",
         "-framerate",
         fmt::format("{}", options.frames_per_second),
         "-start_number",
         "0",
         "-f",
         "image2",
         "-i",
         numbered.pattern(),
         "-vf",
         "crop=trunc(iw/2)*2:trunc(ih/2)*2:0:0,scale=out_color_matrix=bt709:out_range=tv,"
         "format=yuv420p",
         "-c:v",
         "libx264",
         "-crf",
         std::to_string(options.quality),
         "-colorspace",
         "bt709",
         "-color_primaries",
         "bt709",
         "-color_trc",
         "bt709",
         "-movflags",
         "+faststart",
         "-f",
         "mp4",
         fs::absolute(temporary).string()},
        process, "the film was not written; the frames are kept");
  });
}

}  // namespace nerf
