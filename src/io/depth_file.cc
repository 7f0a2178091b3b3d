#include "depth_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "half.h"
#include "image_decode.h"
#include "nerf/base/error.h"
#include "nerf/io/image.h"
#include "npy.h"
#include "orientation.h"
#include "paths.h"
#include "photo_plan.h"
#include "scene_limits.h"
#include "scene_statistics.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

constexpr double kMillimetre = 1e-3;
constexpr const char* kNoDepthHint =
    "a depth map has one channel of 16-bit integers or of floats; without it in the capture's file "
    "the photo is used without depth";

bool is_array(const fs::path& path) { return lower_extension(path) == ".npy"; }

DepthImage read_depth_array(const fs::path& path) {
  const NpyArray array = read_npy(path);
  std::vector<size_t> shape = array.shape;
  std::erase(shape, size_t{1});  // of a single channel
  if (shape.size() != 2 || shape[0] > static_cast<size_t>(kMaxImageSide) ||
      shape[1] > static_cast<size_t>(kMaxImageSide))
    throw Error(fmt::format("is an array of shape ({}), not of rows and columns",
                            fmt::join(array.shape, ", ")),
                path.string(), kNoDepthHint);
  DepthImage out{static_cast<int>(shape[1]), static_cast<int>(shape[0]), array.integers, {}};
  out.values.assign(array.values.begin(), array.values.end());
  return out;
}

bool is_known(float value) { return value > 0 && std::isfinite(value); }

// Median of what is known of a few maps, in the files' unit; none where nothing is.
std::optional<double> median_depth(const std::vector<const View*>& views) {
  constexpr size_t kLooks = 5, kPixels = 1000;
  std::vector<double> depths;
  for (size_t i = 0; i < std::min(kLooks, views.size()); ++i) {
    const DepthImage map = read_depth_image(views[i * views.size() / kLooks]->depth_path);
    const size_t every = std::max<size_t>(1, map.values.size() / kPixels);
    for (size_t p = 0; p < map.values.size(); p += every)
      if (is_known(map.values[p])) depths.push_back(static_cast<double>(map.values[p]));
  }
  if (depths.empty()) return {};
  return quantile(std::move(depths), 0.5);
}

// Half of the cameras stand nearer than that to the middle of all.
double usual_spread(const std::vector<View>& views) {
  std::vector<Vec3d> positions;
  for (const View& view : views) positions.push_back(view.pose.translation);
  const Vec3d middle = median_position(positions);
  std::vector<double> distances;
  for (const Vec3d& p : positions) distances.push_back(length(p - middle));
  return quantile(std::move(distances), 0.5);
}

// Floats are metres as often as millimetres. nerfstudio takes them for the latter; where the
// cameras would then stand 50 times further apart than what they see, they are the former.
void choose_unit_of_floats(SceneInput& input, SceneReport& report) {
  constexpr double kAbsurd = 50;
  std::vector<const View*> unsaid;
  for (const View& view : input.views)
    if (!view.depth_path.empty() && view.depth_unit == 0) unsaid.push_back(&view);
  if (unsaid.empty() || read_depth_image(unsaid[0]->depth_path).integers) return;
  const auto median = median_depth(unsaid);
  if (!median || *median * kMillimetre * kAbsurd >= usual_spread(input.views)) return;
  for (View& view : input.views)
    if (!view.depth_path.empty() && view.depth_unit == 0) view.depth_unit = 1;
  report.notes.push_back(
      fmt::format("depth maps of floats are in the capture's unit: in thousandths of it their "
                  "median, {:.3g}, would be nothing beside the distances of the cameras",
                  *median));
}

// Confidence of the pixel of `map` with that index, 0 to 255; ARKit's low, medium and high are 0, 1
// and 2, which Polycam writes as 0, 127 (or 54) and 255.
std::vector<uint8_t> read_confidence(const View& view, const DepthImage& map) {
  const Image8 image = read_image_8bit(view.depth_confidence_path);
  if (image.width != map.width || image.height != map.height)
    throw Error(fmt::format("is {} x {} pixels and its depth map {} x {}", image.width,
                            image.height, map.width, map.height),
                view.depth_confidence_path.string(), "export the capture again");
  std::vector<uint8_t> out;
  for (size_t i = 0; i < map.values.size(); ++i)
    out.push_back(image.pixels[i * static_cast<size_t>(image.channels)]);
  return out;
}

}  // namespace

DepthImage read_depth_image(const fs::path& path) {
  if (is_array(path)) return read_depth_array(path);
  StoredChannel stored = decode_channel(path);
  if (stored.integers && stored.channels > 1)
    throw Error(fmt::format("has {} channels: it is a picture, not a depth map", stored.channels),
                path.string(), kNoDepthHint);
  if (stored.bits < 16)
    throw Error("has 8 bits for each pixel: it is a picture of depth, not a depth map",
                path.string(), kNoDepthHint);
  return {stored.width, stored.height, stored.integers, std::move(stored.values)};
}

void resolve_depths(SceneInput& input, SceneReport& report) {
  std::vector<std::string> missing;
  size_t maps = 0;
  for (View& view : input.views) {
    if (view.depth_path.empty()) continue;
    if (!is_file(view.depth_path)) {
      missing.push_back(view.depth_path.filename().string());
      view.depth_path.clear();
      continue;
    }
    ++maps;
    if (!view.depth_confidence_path.empty() && !is_file(view.depth_confidence_path))
      view.depth_confidence_path.clear();
    if (is_array(view.depth_path)) {
      std::error_code ignored;
      report.memory_estimate_bytes += fs::file_size(view.depth_path, ignored);  // 2 bytes or more
    } else {
      const ImageInfo info = read_image_info(view.depth_path);
      report.memory_estimate_bytes +=
          sizeof(uint16_t) * static_cast<uint64_t>(info.width) * static_cast<uint64_t>(info.height);
    }
  }
  if (!missing.empty())
    report.warnings.push_back(fmt::format("{} of {} depth maps are missing: {}", missing.size(),
                                          missing.size() + maps, name_list(missing)));
  if (maps == 0) return;
  choose_unit_of_floats(input, report);
  for (View& view : input.views)
    if (view.depth_unit == 0) view.depth_unit = kMillimetre;
  report.notes.push_back(fmt::format("{} of {} photos have a depth map", maps, input.views.size()));
}

DepthMap read_depth_map(const View& view, int orientation, int width, int height, double scale) {
  constexpr float kLargestHalf = 65504;
  const std::string where = view.depth_path.string();
  const DepthImage image = read_depth_image(view.depth_path);
  std::vector<uint8_t> confidence;
  if (!view.depth_confidence_path.empty()) confidence = read_confidence(view, image);
  const bool as_shown = same_shape(image.width, image.height, width, height);
  const bool as_stored = orientation != 1 && same_shape(image.height, image.width, width, height);
  if (!as_shown && !as_stored)
    throw Error(fmt::format("the depth map is {} x {} pixels and its photo {} x {}: they do not "
                            "show the same",
                            image.width, image.height, width, height),
                where, "a depth map may be smaller than its photo, but has its shape");
  const ShownPixels shown = shown_pixels(as_shown ? 1 : orientation, image.width, image.height);
  DepthMap map{shown.width, shown.height, {}};
  map.z.reserve(image.values.size());
  for (int y = 0; y < shown.height; ++y)
    for (int x = 0; x < shown.width; ++x) {
      const size_t at = static_cast<size_t>(shown.at(x, y));
      const double depth = static_cast<double>(image.values[at]) * view.depth_unit;
      const float z = static_cast<float>(depth * scale);
      const bool known = is_known(image.values[at]) && depth <= view.depth_reach &&
                         z <= kLargestHalf && (confidence.empty() || confidence[at] > 0);
      map.z.push_back(known ? float_to_half(z) : uint16_t{0});
    }
  return map;
}

}  // namespace nerf::internal
