// From photos or a video to a COLMAP model, through the programs `colmap` and `ffmpeg`.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace nerf {

// Runs the installed colmap on the CPU over a folder of photos (sub-folders included). `camera_model`
// is COLMAP's name of a model. Everything is written below work_folder, nothing beside the photos.
// Returns a folder that load_scene reads: images/ and sparse/0. `progress` gets lines for a person.
// Throws Error: colmap not installed (with the command that installs it), colmap failed, no model.
std::filesystem::path run_colmap_on_photos(
    const std::filesystem::path& images, const std::filesystem::path& work_folder,
    const std::string& camera_model, const std::function<void(const std::string&)>& progress);

// Extracts at most max_frames frames, the sharpest of each window of equal length, into a folder
// below work_folder, and returns that folder (image files only, in order of time). Throws Error:
// ffmpeg not installed (with the command that installs it), not a video, no frame.
std::filesystem::path extract_video_frames(
    const std::filesystem::path& video, const std::filesystem::path& work_folder, int max_frames,
    const std::function<void(const std::string&)>& progress);

}  // namespace nerf
