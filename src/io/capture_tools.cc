// Photos to a COLMAP model: feature extraction, matching, mapping. Frames of a video are in
// video_frames.cc.
#include "nerf/io/capture_tools.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/nearest_name.h"
#include "nerf/base/process.h"
#include "nerf/base/threads.h"
#include "nerf/io/image.h"
#include "nerf/math/camera.h"
#include "paths.h"
#include "scene_input.h"
#include "staged_folder.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;

// Pairs grow with the square: 150 photos are 11,175 pairs, about 20 minutes on two cores.
constexpr size_t kMostForEveryPair = 150;
// Extraction doubles the size of a photo and keeps a dozen copies: 300 MB per thread.
constexpr int kLongestSide = 1600;

using Progress = std::function<void(const std::string&)>;

struct Photos {
  fs::path folder;
  std::vector<std::string> names;
  bool one_size_per_folder = true;
};

bool lies_below(const fs::path& path, const fs::path& folder) {
  const fs::path relative =
      fs::weakly_canonical(path).lexically_relative(fs::weakly_canonical(folder));
  return !relative.empty() && *relative.begin() != "..";
}

// Folders below the photos' own that hold a run's pictures instead of photos. The frames of a video
// lie in the work folder themselves.
std::vector<fs::path> not_photos(const fs::path& folder, const CaptureFolders& run) {
  std::vector<fs::path> out;
  if (!lies_below(folder, run.work)) out.push_back(run.work);
  if (run.run.empty()) return out;
  if (!lies_below(folder, run.run))
    out.push_back(run.run);
  else if (!lies_below(folder, run.work))
    out.push_back(run.run / "eval");
  return out;
}

Photos look_at_photos(const fs::path& folder, const CaptureFolders& run) {
  Photos photos{fs::absolute(folder), {}, true};
  const std::vector<fs::path> excluded = not_photos(folder, run);
  std::map<fs::path, std::pair<int, int>> size_of;
  for (const std::string& name : internal::list_images(folder)) {
    const fs::path path = folder / name;
    if (std::ranges::any_of(excluded, [&](const auto& e) { return lies_below(path, e); })) continue;
    check_image_complete(path);
    const ImageInfo info = read_image_info(path);
    const auto [it, is_new] =
        size_of.emplace(path.parent_path(), std::pair{info.width, info.height});
    if (it->second != std::pair{info.width, info.height}) photos.one_size_per_folder = false;
    photos.names.push_back(name);
  }
  if (photos.names.size() < 2) {
    throw Error(fmt::format("there are {} photos", photos.names.size()), folder.string(),
                "a scene needs photos from many places, some 20 or more");
  }
  return photos;
}

std::string key_of(const Photos& photos, const std::string& camera_model) {
  std::string key = camera_model + "\n" + photos.folder.string() + "\n";
  for (const std::string& name : photos.names) {
    std::error_code ignored;
    const auto size = fs::file_size(photos.folder / name, ignored);
    const auto time = fs::last_write_time(photos.folder / name, ignored).time_since_epoch().count();
    key += fmt::format("{} {} {}\n", name, size, time);
  }
  return key;
}

// Newer versions keep some options under other groups (SiftExtraction, FeatureExtraction): the
// program's own help tells. Empty where it has no such option.
std::string option_ending_in(const std::string& help, const std::string& ending) {
  for (size_t at = help.find("--"); at != std::string::npos; at = help.find("--", at + 2)) {
    const size_t end = std::min(help.find_first_of(" =\n\r\t", at), help.size());
    const std::string option = help.substr(at, end - at);
    if (option.ends_with("." + ending)) return option;
  }
  return "";
}

class Colmap {
 public:
  Colmap(const Progress& progress, const Cancel* cancel)
      : program_(require_program("colmap", "colmap", "finds the cameras of photos").string()),
        progress_(progress),
        cancel_(cancel) {}

  using Arguments = std::vector<std::string>;

  // Adds --<Group>.<name> value for every pair whose option this command has.
  void run(const std::string& command, Arguments arguments,
           const std::vector<std::pair<std::string, std::string>>& settings,
           const std::function<std::string(std::string_view)>& tell) {
    const std::string help = help_of(command);
    for (const auto& [name, value] : settings) {
      const std::string option = option_ending_in(help, name);
      if (option.empty()) continue;
      arguments.insert(arguments.end(), {option, value});
    }
    arguments.insert(arguments.begin(), {program_, command});
    run_process_or_throw(arguments, options([&](std::string_view line) {
                           const std::string text = tell(line);
                           if (progress_ && !text.empty()) progress_(text);
                         }),
                         "look at the photos: sharp, well lit, much overlap from one to the next");
  }

 private:
  std::string help_of(const std::string& command) const {
    std::string help;
    run_process({program_, command, "-h"},
                options([&](std::string_view line) { help.append(line) += '\n'; }));
    return help;
  }
  ProcessOptions options(const std::function<void(std::string_view)>& on_line) const {
    ProcessOptions result;
    result.environment = {"QT_QPA_PLATFORM=offscreen"};  // no display is needed
    result.on_line = on_line;
    result.cancel = cancel_;
    return result;
  }

  std::string program_;
  const Progress& progress_;
  const Cancel* cancel_;
};

// What stands between `before` and the next `after`, without spaces around.
std::string between(std::string_view line, std::string_view before, std::string_view after) {
  const size_t at = line.find(before);
  if (at == std::string_view::npos) return "";
  line.remove_prefix(at + before.size());
  return std::string(line.substr(0, line.find(after)));
}

std::string extraction_line(std::string_view line) {
  const std::string done = between(line, "Processed file [", "]");
  return done.empty() ? "" : "colmap: looked for features in " + done + " photos";
}

std::string matching_line(std::string_view line) {
  const std::string block = between(line, "Matching block [", "]");
  if (!block.empty()) return "colmap: matched block " + block;
  const std::string image = between(line, "Matching image [", "]");
  return image.empty() ? "" : "colmap: matched photo " + image;
}

std::string threads() { return std::to_string(available_processors()); }

void extract_features(Colmap& colmap, const Photos& photos, const fs::path& folder,
                      const std::string& camera_model) {
  std::string list;
  for (const std::string& name : photos.names) list += name + "\n";
  write_file_atomically(folder / "photos.txt", list);
  colmap.run("feature_extractor",
             {"--database_path", (folder / "database.db").string(), "--image_path",
              photos.folder.string(), "--image_list_path", (folder / "photos.txt").string(),
              "--ImageReader.camera_model", camera_model, "--ImageReader.single_camera_per_folder",
              photos.one_size_per_folder ? "1" : "0"},
             {{"use_gpu", "0"},
              {"num_threads", threads()},
              {"max_image_size", std::to_string(kLongestSide)}},
             extraction_line);
}

void match_features(Colmap& colmap, const Photos& photos, const fs::path& folder,
                    const Progress& progress) {
  const Colmap::Arguments database{"--database_path", (folder / "database.db").string()};
  std::vector<std::pair<std::string, std::string>> settings{{"use_gpu", "0"},
                                                            {"num_threads", threads()}};
  if (photos.names.size() <= kMostForEveryPair) {
    settings.emplace_back("block_size", "10");  // for lines of progress in between
    colmap.run("exhaustive_matcher", database, settings, matching_line);
    return;
  }
  if (progress) {
    progress(fmt::format(
        "colmap: {} photos are too many to match every pair; each is matched with those near it in "
        "the order of names (for unordered photos run colmap's vocab_tree_matcher yourself)",
        photos.names.size()));
  }
  settings.emplace_back("overlap", "15");
  settings.emplace_back("quadratic_overlap", "1");  // and with those 16, 32, 64, ... further on
  colmap.run("sequential_matcher", database, settings, matching_line);
}

void map_photos(Colmap& colmap, const Photos& photos, const fs::path& folder) {
  fs::create_directory(folder / "sparse");
  const size_t count = photos.names.size();
  colmap.run("mapper",
             {"--database_path", (folder / "database.db").string(), "--image_path",
              photos.folder.string(), "--output_path", (folder / "sparse").string()},
             {{"num_threads", threads()},
              {"min_model_size", std::to_string(std::clamp<size_t>(count / 2, 2, 10))},
              // Stops the adjustment where it no longer changes anything: half of the time.
              {"ba_global_function_tolerance", "1e-6"}},
             [count](std::string_view line) -> std::string {
               const std::string placed = between(line, "Registering image #", ")");
               const size_t open = placed.find('(');
               if (open == std::string::npos) return "";
               return fmt::format("colmap: placed photo {} of {}", placed.substr(open + 1), count);
             });
  if (!internal::is_folder(folder / "sparse" / "0")) {
    throw Error("colmap could not place the photos in space", photos.folder.string(),
                "take more photos with much overlap, from different places, of things that do not "
                "move");
  }
}

void link_or_copy(const fs::path& photos, const fs::path& link) {
  std::error_code failed;
  fs::create_directory_symlink(fs::weakly_canonical(photos), link, failed);
  if (!failed) return;
  // Some file systems have no links.
  fs::copy(photos, link, fs::copy_options::recursive, failed);
  if (failed) throw errno_error(failed.value(), "cannot link or copy the photos to", link);
}

}  // namespace

void check_camera_model(const std::string& name) {
  if (camera_model_from_name(name)) return;
  std::vector<std::string> known;
  for (int id = 0; const auto model = camera_model_from_id(id); ++id)
    known.emplace_back(camera_model_name(*model));
  throw Error(fmt::format("there is no camera model {}", name), "--camera-model",
              nearest_name_hint(name, known));
}

fs::path run_colmap_on_photos(const fs::path& images, const CaptureFolders& folders,
                              const std::string& camera_model, const Progress& progress,
                              const Cancel* cancel) {
  const fs::path& work_folder = folders.work;
  const fs::path result = work_folder / "colmap";
  const Photos photos = look_at_photos(images, folders);
  const std::string key = key_of(photos, camera_model);
  if (internal::StagedFolder::is_complete(result, key)) {
    if (progress) progress("colmap: using the model made earlier in " + result.string());
    return result;
  }
  Colmap colmap(progress, cancel);
  make_writable_folder(work_folder);
  internal::StagedFolder staged(result);
  if (progress) {
    progress(fmt::format("colmap: finding the cameras of {} photos, camera model {}",
                         photos.names.size(), camera_model));
  }
  extract_features(colmap, photos, staged.path(), camera_model);
  match_features(colmap, photos, staged.path(), progress);
  map_photos(colmap, photos, staged.path());
  fs::remove(staged.path() / "photos.txt");
  fs::remove(staged.path() / "database.db");  // large, and the model says it all
  link_or_copy(photos.folder, staged.path() / "images");
  staged.commit(key);
  return result;
}

}  // namespace nerf
