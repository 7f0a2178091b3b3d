#include "io/cameras/capture_photos.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "io/scene_input.h"
#include "nerf/base/error.h"
#include "nerf/io/image.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

bool lies_below(const fs::path& path, const fs::path& folder) {
  const fs::path relative =
      fs::weakly_canonical(path).lexically_relative(fs::weakly_canonical(folder));
  return !relative.empty() && *relative.begin() != "..";
}

// Folders below the photos' own that hold a run's pictures instead of photos. The frames of a video
// lie in the work folder themselves.
std::vector<fs::path> not_photos(const fs::path& folder, const CaptureFolders& run) {
  std::vector<fs::path> out;
  if (run.work.empty()) return out;
  if (!lies_below(folder, run.work)) out.push_back(run.work);
  if (run.run.empty()) return out;
  if (!lies_below(folder, run.run))
    out.push_back(run.run);
  else if (!lies_below(folder, run.work))
    out.push_back(run.run / "eval");
  return out;
}

}  // namespace

std::vector<std::vector<int>> CapturePhotos::cameras() const {
  std::map<std::string, std::vector<int>> groups;
  for (size_t i = 0; i < photos.size(); ++i) {
    const PhotoTags& tags = photos[i].tags;
    const std::string origin = tags.device.empty()
                                   ? "folder " + fs::path(photos[i].name).parent_path().string()
                                   : "device " + tags.device;
    groups[fmt::format("{}\n{} {} {}", origin, tags.width, tags.height, tags.orientation)]
        .push_back(static_cast<int>(i));
  }
  std::vector<std::vector<int>> out;
  for (auto& [key, group] : groups) out.push_back(std::move(group));
  return out;
}

std::string CapturePhotos::key() const {
  std::string key = folder.string() + "\n";
  for (const CapturePhoto& photo : photos) {
    std::error_code ignored;
    const auto size = fs::file_size(folder / photo.name, ignored);
    const auto time = fs::last_write_time(folder / photo.name, ignored).time_since_epoch().count();
    key += fmt::format("{} {} {}\n", photo.name, size, time);
  }
  return key;
}

std::string CapturePhotos::names(const std::vector<int>& which) const {
  std::string list;
  for (const int i : which) list += photos[static_cast<size_t>(i)].name + "\n";
  return list;
}

std::string CapturePhotos::names() const {
  std::string list;
  for (const CapturePhoto& photo : photos) list += photo.name + "\n";
  return list;
}

std::vector<std::string> capture_photo_names(const fs::path& folder, const CaptureFolders& run) {
  std::vector<std::string> names = list_images(folder);
  for (const fs::path& own : not_photos(folder, run))
    std::erase_if(names, [&](const std::string& name) { return lies_below(folder / name, own); });
  return names;
}

CapturePhotos look_at_photos(const fs::path& folder, const CaptureFolders& run) {
  CapturePhotos out{fs::absolute(folder), {}};
  for (const std::string& name : capture_photo_names(folder, run)) {
    const fs::path path = folder / name;
    check_image_complete(path);
    out.photos.push_back({name, read_photo_tags(path)});
  }
  if (out.photos.size() < 2) {
    throw Error(fmt::format("there are {} photos", out.photos.size()), folder.string(),
                "a scene needs photos from many places, some 20 or more");
  }
  return out;
}

}  // namespace nerf::internal
