// Photos to a COLMAP model: the stages are in cameras/. Frames of a video are in video_frames.cc.
#include "nerf/io/capture_tools.h"

#include <fmt/format.h>

#include <vector>

#include "io/cameras/capture_photos.h"
#include "io/cameras/colmap_program.h"
#include "io/cameras/feature_stage.h"
#include "io/cameras/find_cameras.h"
#include "io/cameras/mapping_stage.h"
#include "io/cameras/match_stage.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/nearest_name.h"
#include "nerf/base/threads.h"
#include "nerf/math/camera.h"
#include "paths.h"
#include "staged_folder.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;

using internal::CapturePhotos;
using internal::ColmapProgram;
using internal::MappedModel;
using Progress = std::function<void(const std::string&)>;

// Below this share of what could be placed other settings are tried.
constexpr double kEnoughPlaced = 0.9;

// What is tried in turn until enough photos are placed; the best result counts.
struct Attempt {
  const char* folder;  // below the work folder; the same one for the same features and matches
  bool eager = false;
  internal::FeatureSettings features = {};
  internal::PairSettings pairs = {};
  std::string told = {};
};

std::vector<Attempt> attempts(bool is_film) {
  Attempt usual{"usual"}, eager{"usual", true, {}, {}, "weaker links between photos"};
  // A frame shows what those before it show, and what few others do: where the camera comes back.
  if (is_film) usual.pairs = eager.pairs = {30, 16, 20, 8};
  Attempt thorough{"thorough", true, {}, {}, "more features and more pairs of photos"};
  thorough.features.doubled_below = 1 << 20;
  thorough.features.longest_side = 1600;
  thorough.features.peak_threshold = 0.004;
  thorough.pairs = {400, 150, 50, 24};
  return {usual, eager, thorough};
}

// Runs in a folder of its own below the work folder, which keeps what is done when it is stopped.
MappedModel try_to_place(const Attempt& attempt, const ColmapProgram& colmap,
                         const CapturePhotos& photos, const fs::path& work_folder,
                         const internal::CameraSearch& search, const Progress& progress,
                         const Cancel* cancel) {
  const fs::path folder = work_folder / "cameras" / attempt.folder;
  const fs::path database = folder / "database.db", key_file = folder / "photos.key";
  const std::string key = search.text() + "\n" + attempt.features.text() + "\n" +
                          attempt.pairs.text() + "\n" + photos.key();
  if (!internal::is_file(key_file) || read_text_file(key_file) != key) {
    std::error_code failed;
    fs::remove_all(folder, failed);
    if (failed) throw errno_error(failed.value(), "cannot remove", folder);
    make_writable_folder(folder);
    write_file_atomically(key_file, key);
  }
  ThreadPool pool;
  internal::find_features(colmap, photos, database, search.camera_model, attempt.features,
                          progress);
  internal::match_features(photos, database, attempt.pairs, pool, progress, cancel);
  internal::verify_matches(colmap, database, progress);
  return internal::map_photos(colmap, photos, database,
                              folder / (attempt.eager ? "eager" : "sparse"),
                              {attempt.eager, search.lenses_are_known}, progress);
}

MappedModel place_photos(const ColmapProgram& colmap, const CapturePhotos& photos,
                         const fs::path& work_folder, const internal::CameraSearch& search,
                         const Progress& progress, const Cancel* cancel) {
  const auto count = static_cast<double>(photos.photos.size());
  MappedModel best;
  for (const Attempt& attempt : attempts(search.is_film)) {
    if (!attempt.told.empty() && progress) {
      progress(fmt::format("colmap: placed {} of {} photos only; trying again with {}", best.photos,
                           photos.photos.size(), attempt.told));
    }
    const MappedModel model =
        try_to_place(attempt, colmap, photos, work_folder, search, progress, cancel);
    if (model.photos > best.photos) best = model;
    if (best.photos == 0) continue;
    const double share =
        search.placed ? search.placed(best.folder) : static_cast<double>(best.photos) / count;
    if (share >= kEnoughPlaced) break;
  }
  return best;
}

// What a run that was stopped goes on from is in its databases. Where none was begun nothing stays.
void remove_what_is_no_use(const fs::path& work_folder) {
  std::error_code ignored;
  for (fs::recursive_directory_iterator it(work_folder / "cameras", ignored), end;
       !ignored && it != end; it.increment(ignored))
    if (it->path().filename() == "database.db") return;
  fs::remove_all(work_folder / "cameras", ignored);
  fs::remove(work_folder, ignored);  // where it is empty
}

void link_or_copy(const CapturePhotos& photos, const fs::path& link) {
  std::error_code failed;
  fs::create_directory_symlink(fs::weakly_canonical(photos.folder), link, failed);
  if (!failed) return;
  // Some file systems have no links.
  for (const internal::CapturePhoto& photo : photos.photos) {
    failed.clear();
    fs::create_directories((link / photo.name).parent_path(), failed);
    if (!failed) fs::copy_file(photos.folder / photo.name, link / photo.name, failed);
    if (failed) throw errno_error(failed.value(), "cannot link or copy the photos to", link);
  }
}

}  // namespace

void check_camera_model(const std::string& name) {
  if (name == internal::kAutoCameraModel || camera_model_from_name(name)) return;
  std::vector<std::string> known{internal::kAutoCameraModel};
  for (int id = 0; const auto model = camera_model_from_id(id); ++id)
    known.emplace_back(camera_model_name(*model));
  throw Error(fmt::format("there is no camera model {}", name), "--camera-model",
              nearest_name_hint(name, known));
}

fs::path run_colmap_on_photos(const fs::path& images, const CaptureFolders& folders,
                              const std::string& camera_model, const Progress& progress,
                              const Cancel* cancel) {
  internal::CameraSearch search;
  search.camera_model = camera_model;
  return internal::find_cameras(images, folders, search, progress, cancel);
}

std::string internal::CameraSearch::text() const {
  return camera_model + (lenses_are_known ? ", known" : "") + (is_film ? ", film" : "");
}

fs::path internal::find_cameras(const fs::path& images, const CaptureFolders& folders,
                                const CameraSearch& search, const Progress& progress,
                                const Cancel* cancel) {
  const fs::path& work_folder = folders.work;
  const fs::path result = work_folder / "colmap";
  const CapturePhotos photos = internal::look_at_photos(images, folders);
  const std::string key = search.text() + "\n" + photos.key();
  if (internal::StagedFolder::is_complete(result, key)) {
    if (progress) progress("colmap: using the model made earlier in " + result.string());
    return result;
  }
  const ColmapProgram colmap(cancel);
  make_writable_folder(work_folder);
  if (progress) {
    progress(fmt::format("colmap: finding the cameras of {} photos, camera model {}",
                         photos.photos.size(), search.camera_model));
  }
  MappedModel model;
  try {
    model = place_photos(colmap, photos, work_folder, search, progress, cancel);
  } catch (...) {
    remove_what_is_no_use(work_folder);
    throw;
  }
  const auto clear = [&] {  // large, and the model says it all
    std::error_code ignored;
    fs::remove_all(work_folder / "cameras", ignored);
  };
  if (model.photos == 0) {
    clear();
    throw Error("colmap could not place the photos in space", photos.folder.string(),
                "take more photos with much overlap, from different places, of things that do not "
                "move");
  }
  if (progress) {
    progress(fmt::format("colmap: placed {} of {} photos", model.photos, photos.photos.size()));
  }
  internal::StagedFolder staged(result);
  link_or_copy(photos, staged.path() / "images");
  fs::create_directory(staged.path() / "sparse");
  fs::rename(model.folder, staged.path() / "sparse" / "0");
  staged.commit(key);
  clear();
  return result;
}

}  // namespace nerf
