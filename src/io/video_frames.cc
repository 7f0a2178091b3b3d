// A video to its sharpest frames, in two passes of ffmpeg: the first scores every frame on a small
// grey copy that never touches the disk, the second stores the chosen ones.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/process.h"
#include "nerf/io/capture_tools.h"
#include "paths.h"
#include "sharpness.h"
#include "staged_folder.h"
#include "video_files.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using Progress = std::function<void(const std::string&)>;

constexpr size_t kFramesPerLine = 300;  // of progress
constexpr size_t kMostTerms = 50;       // of one of ffmpeg's expressions

// Of every frame how sharp it is, and how far the picture has moved since the one before.
internal::GreyStream score_frames(const std::string& ffmpeg, const fs::path& video,
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
  if (!stream.scores().empty()) return stream;
  throw Error("no frame can be read from the video" +
                  (result.last_lines.empty() ? "" : ": " + result.last_lines),
              video.string(), "check that it is a video that ffmpeg can play");
}

// ffmpeg reads some of them, and gives pictures that no lens model fits.
void refuse_spherical_video(const fs::path& video) {
  if (!internal::is_spherical_video_file(video)) return;
  throw Error("this is a 360-degree camera's own file, which is not read", video.string(),
              "export it with the camera's program, as a flat video (.mp4)");
}

// What ffprobe says of the video's colours; empty where it is missing or says nothing.
std::string transfer_of(const fs::path& video, const Cancel* cancel) {
  std::string transfer;
  if (!find_program("ffprobe")) return transfer;
  ProcessOptions options;
  options.cancel = cancel;
  options.on_line = [&](std::string_view line) {
    if (transfer.empty()) transfer = line;
  };
  run_process({"ffprobe", "-v", "error", "-select_streams", "V:0", "-show_entries",
               "stream=color_transfer", "-of", "default=nw=1:nk=1", video.string()},
              options);
  return transfer;
}

// When each frame is shown, seconds from the first; empty where ffprobe is missing or says other
// frames than `frames`.
std::vector<double> frame_times(const fs::path& video, size_t frames, const Cancel* cancel) {
  std::vector<double> times;
  if (!find_program("ffprobe")) return times;
  ProcessOptions options;
  options.cancel = cancel;
  options.on_line = [&](std::string_view line) {
    double time = 0;
    if (std::from_chars(line.data(), line.data() + line.size(), time).ec == std::errc())
      times.push_back(time);
  };
  run_process({"ffprobe", "-v", "error", "-select_streams", "V:0", "-show_entries",
               "packet=pts_time", "-of", "csv=p=0", video.string()},
              options);
  if (times.size() != frames || times.empty()) return {};
  std::ranges::sort(times);  // packets come in the order of decoding
  const double first = times.front();
  for (double& time : times) time -= first;
  return times;
}

// {"frame_000001.jpg": seconds, ...} of the stored frames.
void store_times(const fs::path& file, const std::vector<int>& chosen,
                 const std::vector<double>& times) {
  std::string text;
  for (size_t i = 0; i < chosen.size() && !times.empty(); ++i)
    text += fmt::format("{}\n\"frame_{:06}.jpg\": {:.6f}", i == 0 ? "" : ",", i + 1,
                        times[static_cast<size_t>(chosen[i])]);
  write_file_atomically(file, "{" + text + "\n}\n");
}

// The usual time between two of the film's frames, and nothing where its clock is not known.
void store_interval(const fs::path& file, const std::vector<double>& times) {
  if (times.size() < 2) return;
  std::vector<double> steps;
  for (size_t i = 1; i < times.size(); ++i) steps.push_back(times[i] - times[i - 1]);
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::ranges::nth_element(steps, middle);
  write_file_atomically(file, fmt::format("{{\"frame_interval\": {:.6f}}}\n", *middle));
}

bool has_filter(const std::string& ffmpeg, const std::string& name) {
  bool found = false;
  ProcessOptions options;
  options.on_line = [&](std::string_view line) {
    if (line.find(fmt::format(" {} ", name)) != std::string_view::npos) found = true;
  };
  run_process({ffmpeg, "-hide_banner", "-filters"}, options);
  return found;
}

// Filters that bring pictures of a high dynamic range (PQ or HLG, as phones record them) into that
// of photos; empty where the video has none. Without them such frames are pale and grey.
std::string tone_mapping(const std::string& ffmpeg, const fs::path& video, const Progress& progress,
                         const Cancel* cancel) {
  const std::string transfer = transfer_of(video, cancel);
  if (transfer != "smpte2084" && transfer != "arib-std-b67") return "";
  if (!has_filter(ffmpeg, "zscale") || !has_filter(ffmpeg, "tonemap")) {
    if (progress)
      progress("ffmpeg: the video is HDR, which this ffmpeg cannot map; frames will be pale");
    return "";
  }
  if (progress) progress("ffmpeg: the video is HDR; its tones are mapped to those of photos");
  return ",zscale=t=linear:npl=100,format=gbrpf32le,zscale=p=bt709,tonemap=hable:desat=0,"
         "zscale=t=bt709:m=bt709:r=pc,format=yuvj420p";
}

void store_frames(const std::string& ffmpeg, const fs::path& video, const std::vector<int>& chosen,
                  const fs::path& folder, const Progress& progress, const Cancel* cancel) {
  const std::string tones = tone_mapping(ffmpeg, video, progress, cancel);
  if (progress) progress(fmt::format("ffmpeg: storing the {} sharpest frames", chosen.size()));
  std::vector<std::string> command{ffmpeg, "-nostdin", "-v", "error", "-i", video.string()};
  // An output for each part of the frames: an expression of more than 100 terms is refused. In
  // files: a long list of frames would not fit on a command line.
  const fs::path scripts = folder.string() + ".filters";
  make_writable_folder(scripts);
  const auto remove_scripts = [&] {
    std::error_code ignored;
    fs::remove_all(scripts, ignored);
  };
  ProcessOptions options;
  options.cancel = cancel;
  options.folder = folder;  // a % of its name would be taken for a pattern
  ProcessResult result;
  try {
    for (size_t begin = 0; begin < chosen.size(); begin += kMostTerms) {
      std::string filter;
      for (size_t i = begin; i < std::min(chosen.size(), begin + kMostTerms); ++i)
        filter += fmt::format("{}eq(n,{})", i == begin ? "" : "+", chosen[i]);
      const std::string script = (scripts / std::to_string(begin)).string();
      write_file_atomically(script, fmt::format("select='{}'{}", filter, tones));
      command.insert(command.end(), {"-map", "0:V:0", "-filter_script:v", script, "-vsync", "0",
                                     "-q:v", "1", "-qmin", "1", "-f", "image2", "-start_number",
                                     std::to_string(begin + 1), "frame_%06d.jpg"});
    }
    result = run_process(command, options);
  } catch (...) {
    remove_scripts();
    throw;
  }
  remove_scripts();
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
  refuse_spherical_video(video);
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
  const internal::GreyStream stream = score_frames(ffmpeg, source, progress, cancel);
  const std::vector<int> chosen =
      internal::sharpest_of_windows(stream.scores(), stream.motions(), max_frames);
  store_frames(ffmpeg, source, chosen, fs::absolute(staged.path()), progress, cancel);
  const std::vector<double> times = frame_times(source, stream.scores().size(), cancel);
  store_times(work_folder / kFrameTimes, chosen, times);
  store_interval(work_folder / kFilm, times);
  staged.commit(key);
  return result;
}

}  // namespace nerf
