#include "scene_detect.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>

#include "io/cameras/capture_photos.h"
#include "io/cameras/find_cameras.h"
#include "lenient_json.h"
#include "nerf/io/capture_tools.h"
#include "panoramas.h"
#include "paths.h"
#include "phone_scans.h"
#include "photo_conversion.h"
#include "video_files.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

// In which they are looked for.
constexpr std::array kOrder{SceneFormat::kBlender,    SceneFormat::kNerfies, SceneFormat::kColmap,
                            SceneFormat::kTransforms, SceneFormat::kLlff,    SceneFormat::kNonrigid,
                            SceneFormat::kPhotos,     SceneFormat::kVideo};

// COLMAP on a CPU matches every pair of so many frames in minutes.
constexpr int kMaxVideoFrames = 120;

bool is_video_file(const fs::path& path) {
  static const std::set<std::string> kExtensions{".mp4",  ".mov", ".m4v", ".mkv", ".avi",
                                                 ".webm", ".mts", ".mpg", ".mpeg"};
  return kExtensions.count(lower_extension(path)) > 0 || is_spherical_video_file(path);
}

std::vector<fs::path> videos_in(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code problem;
  for (fs::directory_iterator it(folder, problem), end; !problem && it != end;
       it.increment(problem)) {
    if (is_file(it->path()) && is_video_file(it->path())) found.push_back(it->path());
  }
  std::ranges::sort(found, {}, [](const fs::path& video) {
    return std::pair(is_spherical_video_file(video), video);  // what cannot be read comes last
  });
  return found;
}

// Whether there is an image in the folder or in one right below it. Looks no deeper: the path may
// be a mistake for a whole disk.
bool holds_images(const fs::path& folder, int depth = 1) {
  std::error_code problem;
  for (fs::directory_iterator it(folder, problem), end; !problem && it != end;
       it.increment(problem)) {
    if (is_file(it->path()) && is_image_file(it->path())) return true;
    if (depth > 0 && is_folder(it->path()) && holds_images(it->path(), depth - 1)) return true;
  }
  return false;
}

// The folder whose photos count: images/ or input/ where it holds any, else the folder itself.
fs::path photo_folder(const fs::path& root) {
  for (const char* name : {"images", "input"})
    if (holds_images(root / name)) return root / name;
  return root;
}

bool has_format(const fs::path& path, SceneFormat format) {
  const bool folder = is_folder(path);
  switch (format) {
    case SceneFormat::kBlender:
      return folder ? path_exists(path / "transforms_train.json")
                    : path.filename() == "transforms_train.json";
    case SceneFormat::kNerfies:
      return folder && is_nerfies_scene(path);
    case SceneFormat::kColmap:
      return folder && !find_colmap_models(path).empty();
    case SceneFormat::kTransforms:
      return folder ? path_exists(path / "transforms.json") ||
                          (is_phone_scan(path) && !is_nerfies_scene(path))
                    : path.extension() == ".json";
    case SceneFormat::kLlff:
      return folder && path_exists(path / "poses_bounds.npy");
    case SceneFormat::kNonrigid:
      return folder && path_exists(path / "precomputed.json");
    case SceneFormat::kPhotos:
      return folder && holds_images(photo_folder(path));
    case SceneFormat::kVideo:
      return folder ? !videos_in(path).empty() : is_video_file(path);
    case SceneFormat::kAuto:
      break;
  }
  return false;
}

// With cameras, which are found at their places alone.
bool has_cameras(const fs::path& path) {
  return std::ranges::any_of(kOrder, [&](SceneFormat format) {
    return format != SceneFormat::kPhotos && format != SceneFormat::kVideo &&
           has_format(path, format);
  });
}

// The only thing that a person sees in the folder, where that is a folder; else empty.
fs::path only_folder_in(const fs::path& folder, const fs::path& own) {
  const auto counts = [&](const fs::path& entry) {
    const std::string name = entry.filename().string();
    if (name.starts_with(".") || name == "__MACOSX" || name == "desktop.ini" || name == "runs")
      return false;
    std::error_code ignored;
    return own.empty() || !fs::equivalent(entry, own, ignored);
  };
  fs::path only;
  std::error_code problem;
  for (fs::directory_iterator it(folder, problem), end; !problem && it != end;
       it.increment(problem)) {
    if (!counts(it->path())) continue;
    if (!only.empty() || !is_folder(it->path())) return {};
    only = it->path();
  }
  return problem ? fs::path() : only;
}

const char* what_is_wanted(SceneFormat format) {
  switch (format) {
    case SceneFormat::kBlender:
      return "transforms_train.json";
    case SceneFormat::kNerfies:
      return "capture in Nerfies' layout (camera/, rgb/, scene.json, dataset.json)";
    case SceneFormat::kColmap:
      return "COLMAP model (sparse/0, sparse or colmap/sparse/0)";
    case SceneFormat::kTransforms:
      return "transforms.json";
    case SceneFormat::kLlff:
      return "poses_bounds.npy";
    case SceneFormat::kNonrigid:
      return "precomputed.json";
    case SceneFormat::kPhotos:
      return "folder of photos (images/ or the folder itself)";
    case SceneFormat::kVideo:
      return "video file";
    case SceneFormat::kAuto:
      break;
  }
  return "";
}

fs::path work_folder(const SceneOptions& options) {
  if (!options.work_folder.empty()) return options.work_folder;
  throw Error("photos without a camera model need a folder to work in", "work_folder",
              "name a folder for the run, COLMAP's model is written there");
}

SceneInput read_photos(const fs::path& photos, const fs::path& mask_root, bool is_film,
                       const CaptureRun& run) {
  check_camera_model(run.options.camera_model);
  if (is_folder(photos / "masks")) {
    throw Error("photos and masks/ are in one folder, and COLMAP would take masks for photos",
                photos.string(), "put the photos into images/ beside masks/");
  }
  const CaptureFolders folders{work_folder(run.options), run.options.run_folder};
  const bool panoramas =
      run.options.camera_model == camera_model_name(CameraModel::kEquirectangular);
  const std::vector<std::string> names = capture_photo_names(photos, folders);
  SceneInput input;
  if (panoramas || are_panoramas(photos, names)) {
    input = read_panoramas(photos, names, folders, run.progress, run.cancel);
  } else {
    std::vector<std::string> notes;
    const fs::path prepared = prepared_photos(photos, folders, run.progress, run.cancel, notes);
    const CameraSearch search{.camera_model = run.options.camera_model, .is_film = is_film};
    input = read_colmap_scene(find_cameras(prepared, folders, search, run.progress, run.cancel));
    input.notes.insert(input.notes.begin(), notes.begin(), notes.end());
    input.images_total = std::max(static_cast<int>(input.views.size()),
                                  static_cast<int>(capture_photo_names(prepared, folders).size()));
    input.format = "photos, " + input.format;
  }
  input.mask_folders = {mask_root / "masks"};
  return input;
}

// Times by the film's clock, where it was looked at.
void give_film_times(const fs::path& file, const fs::path& video, SceneInput& input) {
  if (!is_file(file)) return;  // frames of an earlier version
  const nlohmann::json times = read_lenient_json(file);
  for (View& view : input.views) {
    const auto it = times.find(fs::path(view.name).filename().string());
    if (it == times.end() || !it->is_number()) return;
    view.time = it->get<double>();
  }
  input.times =
      SceneInput::Times{.source = video.filename().string(), .seconds = true, .on_request = true};
  if (const fs::path film = file.parent_path() / kFilm; is_file(film)) {
    const nlohmann::json read = read_lenient_json(film);
    if (const auto it = read.find("frame_interval"); it != read.end() && it->is_number())
      input.times->interval = std::max(0.0, it->get<double>());
  }
}

}  // namespace

fs::path unwrapped(const fs::path& path, const fs::path& own) {
  constexpr int kDeepest = 3;
  fs::path folder = path;
  for (int depth = 0; depth <= kDeepest && is_folder(folder); ++depth) {
    if (has_cameras(folder)) return folder;
    folder = only_folder_in(folder, own);
    // Photos alone are found one folder down as they are; deeper they are to be looked for.
    if (has_format(folder, SceneFormat::kPhotos) && !has_format(path, SceneFormat::kPhotos) &&
        !has_cameras(folder))
      return folder;
  }
  return path;
}

SceneFormat detect_format(const fs::path& path) {
  for (const SceneFormat format : kOrder)
    if (has_format(path, format)) return format;
  if (is_folder(path)) {
    std::error_code problem;
    const bool empty = fs::is_empty(path, problem);
    throw Error(empty ? "the folder is empty" : "there is no scene in this folder", path.string(),
                "wanted: transforms_train.json, a COLMAP model in sparse/, transforms.json, "
                "poses_bounds.npy, Nerfies' camera/ and rgb/, precomputed.json, photos or a video");
  }
  throw Error(path_exists(path) ? "the file is neither a transforms .json nor a video"
                                : "there is no such file or folder",
              path.string(), "give the folder of a scene");
}

std::vector<std::string> inputs_beside(const fs::path& path, SceneFormat used) {
  std::vector<std::string> found;
  if (!is_folder(path)) return found;
  for (const SceneFormat format : kOrder) {
    // Photos beside a model are the model's own.
    const bool own = format == SceneFormat::kPhotos && used != SceneFormat::kVideo;
    if (format != used && !own && has_format(path, format)) found.push_back(what_is_wanted(format));
  }
  return found;
}

SceneInput read_scene_input(const fs::path& path, SceneFormat format, const CaptureRun& run) {
  if (!path_exists(path)) {
    throw Error("there is no such file or folder", path.string(), "give the folder of a scene");
  }
  if (!has_format(path, format)) {
    throw Error(fmt::format("there is no {}", what_is_wanted(format)), path.string(),
                "leave --format out to have the format found");
  }
  const bool folder = is_folder(path);
  switch (format) {
    case SceneFormat::kBlender:
      return read_blender_scene(folder ? path : path.parent_path());
    case SceneFormat::kNerfies:
      return read_nerfies_scene(path);
    case SceneFormat::kColmap:
      return read_colmap_scene(path, run.options.adjust_cameras, run.progress, run.cancel);
    case SceneFormat::kTransforms:
      if (folder && !path_exists(path / "transforms.json")) return read_phone_scene(path);
      return read_transforms_scene(folder ? path / "transforms.json" : path);
    case SceneFormat::kLlff:
      return read_llff_scene(path);
    case SceneFormat::kNonrigid:
      return read_nonrigid_scene(path);
    case SceneFormat::kPhotos:
      return read_photos(photo_folder(path), path, false, run);
    case SceneFormat::kVideo: {
      const std::vector<fs::path> videos = folder ? videos_in(path) : std::vector{path};
      const fs::path& video = videos.front();
      const fs::path frames = extract_video_frames(video, work_folder(run.options), kMaxVideoFrames,
                                                   run.progress, run.cancel);
      SceneInput input = read_photos(frames, frames.parent_path(), true, run);
      give_film_times(frames.parent_path() / kFrameTimes, video, input);
      input.format = "video " + video.filename().string() + ", " + input.format;
      for (size_t i = 1; i < videos.size(); ++i)
        input.ignored.push_back(videos[i].filename().string());
      return input;
    }
    case SceneFormat::kAuto:
      break;
  }
  throw std::logic_error("read_scene_input: format not detected");
}

}  // namespace nerf::internal
