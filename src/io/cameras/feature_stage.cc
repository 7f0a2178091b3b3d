#include "io/cameras/feature_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "io/cameras/feature_database.h"
#include "io/paths.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/threads.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

// Photos of one call of colmap.
struct Batch {
  std::vector<int> photos;
  bool one_camera = false;  // for all of them, else one for each
  bool doubled = false;
};

int longest_side(const PhotoTags& tags) { return std::max(tags.width, tags.height); }

// Cameras with several photos each have a call of their own, since colmap knows one camera for all
// photos of a call and one for each, but no groups. The others go together, so that threads have
// something to share.
std::vector<Batch> batches_of(const CapturePhotos& photos, const FeatureSettings& settings) {
  std::vector<Batch> out;
  Batch single, single_doubled{{}, false, true};
  for (const std::vector<int>& group : photos.cameras()) {
    const PhotoTags& tags = photos.photos[static_cast<size_t>(group.front())].tags;
    const bool doubled = longest_side(tags) < settings.doubled_below;
    if (group.size() > 1)
      out.push_back({group, true, doubled});
    else
      (doubled ? single_doubled : single).photos.push_back(group.front());
  }
  for (Batch* batch : {&single, &single_doubled}) {
    std::ranges::sort(batch->photos);
    if (!batch->photos.empty()) out.push_back(*batch);
  }
  return out;
}

std::string model_for(const Batch& batch, const std::string& wanted,
                      const FeatureSettings& settings) {
  if (wanted != kAutoCameraModel) return wanted;
  // 50 photos of a phone: 0.02 degrees from colmap's own poses with OPENCV, 0.17 with the other.
  return batch.one_camera && batch.photos.size() >= settings.photos_for_opencv ? "OPENCV"
                                                                               : "SIMPLE_RADIAL";
}

// What an earlier run that was stopped has in the database: a camera for each name.
std::map<std::string, int64_t> cameras_found(const fs::path& file) {
  std::map<std::string, int64_t> out;
  if (!is_file(file)) return out;
  try {
    FeatureDatabase database(file);
    for (const FeatureDatabase::Image& image : database.images()) out[image.name] = image.camera;
  } catch (const Error&) {  // stopped while it was made
    std::error_code ignored;
    for (const char* ending : {"", "-wal", "-shm", "-journal"})
      fs::remove(file.string() + ending, ignored);
    out.clear();
  }
  return out;
}

}  // namespace

std::string FeatureSettings::text() const {
  return fmt::format("{} {} {} {}", longest_side, doubled_below, peak_threshold, photos_for_opencv);
}

void find_features(const ColmapProgram& colmap, const CapturePhotos& photos,
                   const fs::path& database, const std::string& camera_model,
                   const FeatureSettings& settings, const Tell& tell) {
  const std::map<std::string, int64_t> found = cameras_found(database);
  const auto camera_of = [&](int i) {
    const auto it = found.find(photos.photos[static_cast<size_t>(i)].name);
    return it == found.end() ? -1 : it->second;
  };
  const fs::path list = database.parent_path() / "photos.txt";
  const auto total = static_cast<int64_t>(photos.photos.size());
  int64_t done = 0;
  for (int i = 0; i < total; ++i) done += camera_of(i) >= 0;
  StageProgress progress(tell, "colmap: looked for features in", "photos", total, done);
  for (Batch& batch : batches_of(photos, settings)) {
    int64_t camera = -1;
    std::vector<int> missing;
    for (const int i : batch.photos) {
      if (camera_of(i) < 0)
        missing.push_back(i);
      else
        camera = camera_of(i);
    }
    if (missing.empty()) continue;
    write_file_atomically(list, photos.names(missing));
    ColmapProgram::Arguments arguments{"--database_path",
                                       database.string(),
                                       "--image_path",
                                       photos.folder.string(),
                                       "--image_list_path",
                                       list.string(),
                                       "--ImageReader.camera_model",
                                       model_for(batch, camera_model, settings)};
    if (batch.one_camera && camera >= 0)
      arguments.insert(arguments.end(),
                       {"--ImageReader.existing_camera_id", std::to_string(camera)});
    else
      arguments.insert(arguments.end(), {batch.one_camera ? "--ImageReader.single_camera"
                                                          : "--ImageReader.single_camera_per_image",
                                         "1"});
    colmap.run("feature_extractor", std::move(arguments),
               {{"use_gpu", "0"},
                {"num_threads", std::to_string(available_processors())},
                {"max_image_size", std::to_string(settings.longest_side)},
                {"first_octave", batch.doubled ? "-1" : "0"},
                {"peak_threshold", fmt::format("{}", settings.peak_threshold)}},
               [&](std::string_view line) {
                 const std::string_view at = between(line, "Processed file [", "/");
                 if (!at.empty()) progress.update(done + leading_number(at));
               });
    done += static_cast<int64_t>(missing.size());
  }
  std::error_code ignored;
  fs::remove(list, ignored);
}

}  // namespace nerf::internal
