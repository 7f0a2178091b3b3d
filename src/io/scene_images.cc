// The files behind the views: do they exist, what size are they, are there masks and alpha.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <span>
#include <tuple>

#include "image_decode.h"
#include "nerf/io/image.h"
#include "orientation.h"
#include "paths.h"
#include "photo_plan.h"
#include "scene_input.h"
#include "shot_tags.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

constexpr size_t kNamesKept = 5;
// Longest side of photos that are learnt as they are, where nobody says by how much they shrink:
// what a field of some minutes resolves. A panorama shows four times the angle of a photo.
constexpr int kLongestSide = 2048, kLongestPanorama = 4 * kLongestSide;

void drop_missing(SceneInput& input, SceneReport& report) {
  std::vector<char> exists(input.views.size());
  std::vector<std::string> missing;
  for (size_t i = 0; i < input.views.size(); ++i) {
    exists[i] = is_file(input.views[i].image_path);
    if (exists[i]) continue;
    missing.push_back(input.views[i].name);
    if (report.missing_names.size() < kNamesKept)
      report.missing_names.push_back(printable(missing.back()));
  }
  keep_views(input, exists);
  report.images_missing = static_cast<int>(missing.size());
  if (missing.empty()) return;
  const std::string what = fmt::format("{} of {} registered images are missing: {}", missing.size(),
                                       report.images_registered, name_list(missing));
  if (2 * input.views.size() < static_cast<size_t>(report.images_registered)) {
    const fs::path& where = input.listing.empty() ? input.image_folder : input.listing;
    throw Error(what, where.string(),
                input.listing.empty() ? "put the images back under these names"
                                      : "put the images under these names beside the file");
  }
  report.warnings.push_back(what);
}

// The smallest whole number by which the median photo comes below the longest side.
int fitting_downscale(const SceneInput& input, std::span<const ImageInfo> infos,
                      SceneReport& report) {
  const auto times_too_long = [&](size_t i) {
    const Camera& camera = input.cameras[static_cast<size_t>(input.views[i].camera)];
    const int most = is_panorama(camera) ? kLongestPanorama : kLongestSide;
    return (std::max(infos[i].width, infos[i].height) + most - 1) / most;
  };
  std::vector<std::pair<int, size_t>> factors;
  for (size_t i = 0; i < infos.size(); ++i) factors.emplace_back(times_too_long(i), i);
  if (factors.empty()) return 1;
  const auto middle = factors.begin() + static_cast<std::ptrdiff_t>(factors.size() / 2);
  std::nth_element(factors.begin(), middle, factors.end());
  const auto [downscale, photo] = *middle;
  if (downscale == 1) return 1;
  const ImageInfo& info = infos[photo];
  report.notes.push_back(
      fmt::format("photos of {} x {} pixels are learnt at 1/{} of their size, {} x {} "
                  "(--downscale 1: as they are)",
                  info.width, info.height, downscale, downscaled(info.width, downscale),
                  downscaled(info.height, downscale)));
  return downscale;
}

// Cameras at the size of the images; only those that a view uses, each once. Counts images with an
// alpha channel.
int fit_cameras(SceneInput& input, std::span<const ImageInfo> infos, int downscale,
                PhotoMemory& memory, SceneReport& report) {
  int with_alpha = 0, turned = 0;
  std::vector<Camera> cameras;
  std::map<std::tuple<int, int, int>, int> index;
  std::vector<ShotTags> shots;
  for (size_t i = 0; i < infos.size(); ++i) {
    View& view = input.views[i];
    const ImageInfo& info = infos[i];
    shots.push_back(info.shot);
    if (downscale > std::min(info.width, info.height)) {
      throw Error(fmt::format("--downscale {} leaves nothing of {} x {} pixels", downscale,
                              info.width, info.height),
                  view.image_path.string(), "give a smaller number");
    }
    add_photo(memory, info, !view.mask_path.empty(), downscale);
    with_alpha += info.channels % 2 == 0;
    const Camera& camera = input.cameras[static_cast<size_t>(view.camera)];
    const int orientation = orientation_for(camera, info);
    turned += orientation != 1;
    const ShownPixels shown = shown_pixels(orientation, info.width, info.height);
    const auto [it, is_new] = index.emplace(std::tuple{view.camera, shown.width, shown.height},
                                            static_cast<int>(cameras.size()));
    if (is_new) {
      cameras.push_back(
          camera_of_photo(camera, view, shown.width, shown.height, shown.width, shown.height));
    }
    view.camera = it->second;
    // A photo that is turned to fit its camera is read upright.
    const Camera& own = cameras[static_cast<size_t>(view.camera)];
    const bool as_stored = own.width == info.width && own.height == info.height;
    view.orientation = as_stored ? info.orientation : 1;
  }
  input.cameras = std::move(cameras);
  find_exposures(shots, input.views, report);
  if (turned > 0) {
    report.notes.push_back(
        fmt::format("{} of {} photos are turned as their EXIF orientation says: their cameras have "
                    "the size of the turned picture",
                    turned, input.views.size()));
  }
  return with_alpha;
}

// Screenshots and some converters store an alpha channel that is opaque everywhere: a few pictures
// tell.
bool any_transparency(const SceneInput& input) {
  constexpr size_t kLooks = 5;
  for (size_t i = 0; i < kLooks; ++i) {
    const Image8 image =
        read_image_8bit(input.views[i * (input.views.size() - 1) / (kLooks - 1)].image_path);
    if (image.channels % 2 != 0) continue;
    const auto channels = static_cast<size_t>(image.channels);
    for (size_t at = channels - 1; at < image.pixels.size(); at += channels) {
      if (image.pixels[at] != 255) return true;
    }
  }
  return false;
}

void find_masks(SceneInput& input, SceneReport& report) {
  for (View& view : input.views) {
    if (!view.mask_path.empty()) {
      if (is_file(view.mask_path)) continue;
      report.warnings.push_back(fmt::format("mask {} does not exist: {} is used whole",
                                            printable(view.mask_path.string()),
                                            printable(view.name)));
      view.mask_path.clear();
      continue;
    }
    const fs::path name = view.image_path.lexically_relative(input.image_folder).lexically_normal();
    if (name.empty() || *name.begin() == "..") continue;
    fs::path with_png = name, other_extension = name;
    with_png += ".png";
    other_extension.replace_extension(".png");
    for (const fs::path& folder : input.mask_folders) {
      for (const fs::path& candidate : {name, with_png, other_extension}) {
        if (view.mask_path.empty() && is_file(folder / candidate)) {
          view.mask_path = folder / candidate;
        }
      }
    }
  }
  const auto masks = std::count_if(input.views.begin(), input.views.end(),
                                   [](const View& view) { return !view.mask_path.empty(); });
  report.masks = static_cast<int>(masks);
  if (masks > 0 && masks < static_cast<std::ptrdiff_t>(input.views.size())) {
    report.warnings.push_back(fmt::format("{} of {} images have no mask and are used whole",
                                          input.views.size() - static_cast<size_t>(masks),
                                          input.views.size()));
  }
  if (masks == 0) {
    for (const fs::path& folder : input.mask_folders) {
      const size_t files = list_images(folder).size();
      if (files == 0) continue;
      report.warnings.push_back(
          fmt::format("{} holds {} files, none named after an image: masks are not used",
                      folder.string(), files));
      break;
    }
  }
}

}  // namespace

void keep_views(SceneInput& input, const std::vector<char>& keep) {
  std::vector<int32_t> new_index(input.views.size(), -1);
  std::vector<View> views;
  std::vector<char> is_test;
  for (size_t i = 0; i < input.views.size(); ++i) {
    if (!keep[i]) continue;
    new_index[i] = static_cast<int32_t>(views.size());
    views.push_back(std::move(input.views[i]));
    if (!input.is_test.empty()) is_test.push_back(input.is_test[i]);
  }
  input.views = std::move(views);
  input.is_test = std::move(is_test);
  std::vector<Observation> seen;
  for (const Observation& o : input.observations) {
    const int32_t view = new_index[static_cast<size_t>(o.image)];
    if (view >= 0) seen.push_back({view, o.point});
  }
  input.observations = std::move(seen);
}

bool is_image_file(const fs::path& path) {
  static const std::set<std::string> kExtensions = [] {
    std::set<std::string> known{".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr",
                                ".bmp", ".webp", ".hdr", ".ppm", ".tga"};
    known.merge(readable_camera_formats());
    return known;
  }();
  const std::string name = path.filename().string();
  return !name.empty() && name.front() != '.' && kExtensions.count(lower_extension(path)) > 0;
}

std::vector<std::string> list_images(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code problem;
  fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied,
                                      problem);
  for (const fs::recursive_directory_iterator end; !problem && it != end; it.increment(problem)) {
    // Small copies of the photos that file managers (.thumbnails) and Synology's disks keep.
    const std::string name = it->path().filename().string();
    if ((name.starts_with(".") || name == "@eaDir") && is_folder(it->path())) {
      it.disable_recursion_pending();
      continue;
    }
    if (is_file(it->path()) && is_image_file(it->path())) {
      names.push_back(clean_image_name(it->path().lexically_relative(folder).generic_string()));
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

void resolve_images(SceneInput& input, int& downscale, SceneReport& report, bool* alpha) {
  report.images_registered = static_cast<int>(input.views.size());
  report.images_total = std::max(input.images_total, report.images_registered);
  drop_missing(input, report);
  find_masks(input, report);
  std::vector<ImageInfo> infos;
  for (const View& view : input.views) infos.push_back(read_image_info(view.image_path));
  if (downscale == 0) downscale = fitting_downscale(input, infos, report);
  PhotoMemory memory;
  const int with_alpha = fit_cameras(input, infos, downscale, memory, report);
  report.memory_estimate_bytes = memory.kept + memory.largest;
  *alpha = with_alpha > 0 && any_transparency(input);
  if (*alpha && with_alpha < static_cast<int>(input.views.size())) {
    report.warnings.push_back(fmt::format("{} of {} images have no alpha and count as opaque",
                                          input.views.size() - static_cast<size_t>(with_alpha),
                                          input.views.size()));
  }
}

}  // namespace nerf::internal
