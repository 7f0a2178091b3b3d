// From photos or a video to a COLMAP model, through the programs `colmap` and `ffmpeg`.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "nerf/base/cancel.h"

namespace nerf {

// Where photos' cameras and a video's frames are worked out.
struct CaptureFolders {
  std::filesystem::path work;  // everything is written below it
  std::filesystem::path run;   // the run's folder: pictures below it are no photos; empty: none
};

// Throws Error that names --camera-model where COLMAP has no camera model of this name that the
// engine knows; "auto" is one.
void check_camera_model(const std::string& name);

// Finds the cameras of a folder of photos (sub-folders included) on the CPU, through the installed
// colmap; features are matched here, many times faster. `camera_model` is COLMAP's name of a model,
// or "auto": OPENCV for a camera that took many photos, SIMPLE_RADIAL for one that took few.
// Everything is written below folders.work, nothing beside the photos. Returns a folder that
// load_scene and other programs read: images/ (a link to the photos) and sparse/0. A model that an
// earlier call finished for the same photos is used again; so are features and matches of a call
// that failed or was stopped. `progress` gets lines for a person. Up to 150 photos every pair is
// matched, beyond that those that may show the same things. Where too few photos are placed other
// settings are tried; of several models that do not join the largest counts. Throws Error: colmap
// not installed (with the command that installs it), a truncated photo, colmap failed, no model.
// Throws Cancelled after cancel->request().
std::filesystem::path run_colmap_on_photos(const std::filesystem::path& images,
                                           const CaptureFolders& folders,
                                           const std::string& camera_model,
                                           const std::function<void(const std::string&)>& progress,
                                           const Cancel* cancel = nullptr);

// Beside the folder of a video's frames: {"frame_000001.jpg": seconds from the film's first frame},
// empty where its clock is not known.
inline constexpr const char* kFrameTimes = "frame_times.json";
// Likewise, where its clock is known: {"frame_interval": seconds between the film's own frames}.
inline constexpr const char* kFilm = "film.json";

// Extracts at most max_frames frames, the sharpest of each window in which the picture moves
// equally far, upright and with the tones of photos, into a folder below work_folder, and returns
// that folder (image files only, in order of time). Frames that an earlier call extracted from the
// same video are used again. Throws Error: ffmpeg not installed (with the command that installs
// it), not a video, the file of a 360-degree camera, no frame. Throws Cancelled.
std::filesystem::path extract_video_frames(const std::filesystem::path& video,
                                           const std::filesystem::path& work_folder, int max_frames,
                                           const std::function<void(const std::string&)>& progress,
                                           const Cancel* cancel = nullptr);

}  // namespace nerf
