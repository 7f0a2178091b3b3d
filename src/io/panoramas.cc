#include "panoramas.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <set>

#include "colmap.h"
#include "io/cameras/find_cameras.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/io/image.h"
#include "panorama_cuts.h"
#include "paths.h"
#include "scene_limits.h"
#include "staged_folder.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

using Progress = std::function<void(const std::string&)>;

constexpr size_t kLooks = 5;  // at how many panoramas' edges
constexpr size_t kNamesShown = 5;

bool says_panorama(const fs::path& photo) {
  std::string head(256 * 1024, '\0');  // XMP stands before the picture
  std::ifstream in(photo, std::ios::binary);
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<size_t>(std::max<std::streamsize>(0, in.gcount())));
  const size_t at = head.find("GPano:ProjectionType");
  return at != std::string::npos &&
         head.find("equirectangular", at) - at < 64;  // as attribute or as element
}

// Mean difference of pixels of two places, in 8-bit levels.
class EdgeStatistics {
 public:
  explicit EdgeStatistics(const Image8& image) : image_(image) {}

  double columns_differ(int a, int b) const {
    double sum = 0;
    for (int y = 0; y < image_.height; ++y) sum += differ(a, y, b, y);
    return sum / image_.height;
  }
  double column_varies(int x) const {
    return varies(image_.height, [&](int i) { return at(x, i); });
  }
  double row_varies(int y) const {
    return varies(image_.width, [&](int i) { return at(i, y); });
  }

 private:
  const uint8_t* at(int x, int y) const {
    return image_.pixels.data() +
           (static_cast<size_t>(y) * static_cast<size_t>(image_.width) + static_cast<size_t>(x)) *
               static_cast<size_t>(image_.channels);
  }
  double differ(int x0, int y0, int x1, int y1) const {
    double sum = 0;
    for (int c = 0; c < image_.channels; ++c) sum += std::abs(at(x0, y0)[c] - at(x1, y1)[c]);
    return sum / image_.channels;
  }
  template <class PixelAt>
  double varies(int count, const PixelAt& pixel) const {
    double sum = 0;
    for (int c = 0; c < image_.channels; ++c) {
      double mean = 0;
      for (int i = 0; i < count; ++i) mean += static_cast<double>(pixel(i)[c]) / count;
      for (int i = 0; i < count; ++i) sum += std::abs(pixel(i)[c] - mean) / count;
    }
    return sum / image_.channels;
  }

  const Image8& image_;
};

bool made_like_a_sphere(const Image8& image) {
  const EdgeStatistics edges(image);
  double neighbours = 0;  // how much a column differs from the next
  constexpr int kColumns = 16;
  for (int i = 0; i < kColumns; ++i) {
    const int x = i * (image.width - 1) / kColumns;
    neighbours += edges.columns_differ(x, x + 1) / kColumns;
  }
  const double even = std::max(6.0, 0.3 * edges.row_varies(image.height / 2));
  // A studio's white edges meet as well, but show nothing that could fail to.
  return edges.columns_differ(0, image.width - 1) <= 2 * neighbours + 1 &&
         edges.column_varies(0) >= 5 && edges.row_varies(0) <= even &&
         edges.row_varies(image.height - 1) <= even;
}

Camera whole_panorama(const fs::path& photo) {
  const ImageInfo info = read_image_info(photo);
  const Camera camera = panorama(info.width, info.height);
  if (const auto problem = camera_problem(camera)) throw Error("it " + *problem, photo.string());
  return camera;
}

// Where the cuts are, made now or earlier.
fs::path cut_all(const fs::path& photos, const std::vector<std::string>& names,
                 const fs::path& work, const Progress& progress, const Cancel* cancel) {
  std::string key = fmt::format("{} cuts\n{}\n", kCutsPerPanorama, fs::absolute(photos).string());
  for (const std::string& name : names) {
    std::error_code ignored;
    key += fmt::format("{} {} {}\n", name, fs::file_size(photos / name, ignored),
                       fs::last_write_time(photos / name, ignored).time_since_epoch().count());
  }
  const fs::path result = work / "cuts";
  if (StagedFolder::is_complete(result, key)) return result;
  make_writable_folder(work);
  StagedFolder staged(result);
  ThreadPool pool;
  for (size_t i = 0; i < names.size(); ++i) {
    if (cancel && cancel->requested()) throw Cancelled();
    check_image_complete(photos / names[i]);
    whole_panorama(photos / names[i]);
    const Image8 image = read_image_8bit(photos / names[i]);
    for (int k = 0; k < kCutsPerPanorama; ++k) {
      const fs::path file = staged.path() / cut_name(i, k);
      make_writable_folder(file.parent_path());
      write_cut(file, k, cut_panorama(image, k, pool));
    }
    if (progress)
      progress(fmt::format("panoramas: cut {} of {} into {} perspective views", i + 1, names.size(),
                           kCutsPerPanorama));
  }
  staged.commit(key);
  return result;
}

struct CutId {
  size_t panorama;
  int cut;
};

std::map<std::string, CutId> cuts_by_name(size_t panoramas) {
  std::map<std::string, CutId> out;
  for (size_t i = 0; i < panoramas; ++i)
    for (int k = 0; k < kCutsPerPanorama; ++k) out[cut_name(i, k)] = {i, k};
  return out;
}

struct PlacedView {
  std::string name;
  Pose pose;
};

// [panoramas]; observations are by the views' indices.
std::vector<std::vector<PlacedCut>> cuts_by_panorama(const std::vector<PlacedView>& views,
                                                     const std::vector<Observation>& observations,
                                                     size_t panoramas) {
  const std::map<std::string, CutId> cut_of = cuts_by_name(panoramas);
  std::vector<int> points_seen(views.size());
  for (const Observation& o : observations) ++points_seen[static_cast<size_t>(o.image)];
  std::vector<std::vector<PlacedCut>> out(panoramas);
  for (size_t v = 0; v < views.size(); ++v) {
    const CutId id = cut_of.at(views[v].name);
    out[id.panorama].push_back({id.cut, views[v].pose, points_seen[v]});
  }
  return out;
}

// The points that the model of the cuts has, seen by the panoramas instead.
void take_points(SceneInput& model, const std::vector<int>& panorama_of_cut, SceneInput& input) {
  std::set<std::pair<int32_t, int32_t>> seen;  // point, view
  for (const Observation& o : model.observations)
    if (const int view = panorama_of_cut[static_cast<size_t>(o.image)]; view >= 0)
      seen.emplace(o.point, view);
  input.points = std::move(model.points);
  for (ScenePoint& point : input.points) point.views = 0;
  for (const auto& [point, view] : seen) {
    ++input.points[static_cast<size_t>(point)].views;
    input.observations.push_back({view, point});
  }
}

}  // namespace

std::string cut_name(size_t i, int k) {
  // A folder for each lens, as run_colmap_on_photos() takes it.
  return fmt::format("{}/{:05}_{}.jpg", k < kLevelCuts ? "level" : "poles", i, k);
}

bool are_panoramas(const fs::path& folder, const std::vector<std::string>& names) {
  if (names.size() < 2) return false;
  for (const std::string& name : names) {
    const ImageInfo info = read_image_info(folder / name);
    if (std::abs(info.width - 2 * info.height) > 2) return false;
  }
  if (says_panorama(folder / names.front())) return true;
  const size_t looks = std::min(kLooks, names.size());
  size_t like = 0;
  for (size_t i = 0; i < looks; ++i)
    like += made_like_a_sphere(
        read_image_8bit(folder / names[i * (names.size() - 1) / std::max<size_t>(1, looks - 1)]));
  return 2 * like > looks;
}

SceneInput read_panoramas(const fs::path& photos, const std::vector<std::string>& names,
                          const CaptureFolders& folders, const Progress& progress,
                          const Cancel* cancel) {
  if (progress)
    progress(
        fmt::format("panoramas: {} photos of 360 x 180 degrees, whose cameras are found "
                    "through perspective views cut from them",
                    names.size()));
  const fs::path cuts = cut_all(photos, names, folders.work, progress, cancel);
  CameraSearch search;
  search.camera_model = camera_model_name(CameraModel::kSimplePinhole);
  search.lenses_are_known = true;
  // Panoramas count, not cuts, of which some show sky alone.
  search.placed = [&](const fs::path& folder) {
    const ColmapModel model = read_colmap_model(folder);
    std::vector<PlacedView> views;
    for (const ColmapImage& image : model.images) views.push_back({image.name, image.pose});
    const auto placed = cuts_by_panorama(views, model.observations, names.size());
    const auto count = std::ranges::count_if(
        placed, [](const auto& cuts) { return pose_from_cuts(cuts).has_value(); });
    return static_cast<double>(count) / static_cast<double>(names.size());
  };
  return panoramas_of_cuts(read_colmap_scene(find_cameras(cuts, folders, search, progress, cancel)),
                           photos, names);
}

SceneInput panoramas_of_cuts(SceneInput cuts, const fs::path& photos,
                             const std::vector<std::string>& names) {
  const std::map<std::string, CutId> cut_of = cuts_by_name(names.size());
  std::vector<PlacedView> views;
  for (const View& view : cuts.views) views.push_back({view.name, view.pose});
  const auto placed = cuts_by_panorama(views, cuts.observations, names.size());
  SceneInput input;
  std::vector<int> view_of(names.size(), -1);
  std::vector<std::string> lost;
  size_t lost_count = 0;
  for (size_t i = 0; i < names.size(); ++i) {
    const auto pose = pose_from_cuts(placed[i]);
    if (!pose) {
      if (++lost_count <= kNamesShown) lost.push_back(printable(names[i]));
      continue;
    }
    View view;
    view.name = names[i];
    view.image_path = photos / names[i];
    view.pose = *pose;
    view.camera = static_cast<int>(input.cameras.size());
    input.cameras.push_back(whole_panorama(view.image_path));
    view_of[i] = static_cast<int>(input.views.size());
    input.views.push_back(std::move(view));
  }
  if (lost_count > 0)
    input.warnings.push_back(fmt::format("{} of {} panoramas could not be placed: {}{}", lost_count,
                                         names.size(), fmt::join(lost, ", "),
                                         lost_count > kNamesShown ? ", ..." : ""));
  std::vector<int> panorama_of_cut;
  for (const View& view : cuts.views)
    panorama_of_cut.push_back(view_of[cut_of.at(view.name).panorama]);
  take_points(cuts, panorama_of_cut, input);
  input.image_folder = photos;
  input.images_total = static_cast<int>(names.size());
  input.format =
      fmt::format("panoramas by {} perspective views each, {}", kCutsPerPanorama, cuts.format);
  return input;
}

}  // namespace nerf::internal
