#include "train/skyline.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <numbers>

namespace nerf {

namespace {

// Sine of the elevation. Cameras that look up from one side tell little of what is level: by the
// statue's own axis those of `liberty` are off by 7 degrees.
constexpr double kHorizon = -0.15;

// Of the horizon, in equal parts: photos that show little of it tell its parts better apart.
size_t bins_of(const Camera& camera) {
  constexpr double kBinsAcross = 48, kWidest = 0.025, kNarrowest = 0.0025;  // radians
  const auto towards = [&](double share) {
    return unproject(camera, {share * (camera.width - 1) + 0.5, 0.5 * camera.height});
  };
  double across = 0;  // in two parts, since a panorama's ends look the same way
  for (const double share : {0.0, 0.5}) {
    const auto left = towards(share), right = towards(share + 0.5);
    if (!left || !right) return static_cast<size_t>(2 * std::numbers::pi / kWidest);
    across += std::acos(std::clamp(dot(normalized(*left), normalized(*right)), -1.0, 1.0));
  }
  const double width = std::clamp(across / kBinsAcross, kNarrowest, kWidest);
  return static_cast<size_t>(2 * std::numbers::pi / width);
}

// Where so many distances lie, but for those at either end, which may be wrong.
SampleRange reach_of(std::vector<double> distances) {
  constexpr double kWrong = 0.02, kNearer = 0.9, kFarther = 1.25;
  const auto wrong =
      static_cast<std::ptrdiff_t>(kWrong * static_cast<double>(distances.size() - 1));
  const auto at = [&](std::ptrdiff_t i) {
    std::ranges::nth_element(distances, distances.begin() + i);
    return distances[static_cast<size_t>(i)];
  };
  return {kNearer * at(wrong), kFarther * at(std::ssize(distances) - 1 - wrong)};
}

}  // namespace

size_t Skylines::Line::bin_of(const Vec3d& d) const {
  const double turn = std::atan2(d.y, d.x) / (2 * std::numbers::pi) + 0.5;
  const size_t bin = static_cast<size_t>(turn * static_cast<double>(height.size()));
  return std::min(bin, height.size() - 1);
}

Skylines::Skylines(const Scene& scene) {
  constexpr int kSureViews = 2;  // of a point
  // A photo at other scales has no points of its own.
  std::map<std::filesystem::path, size_t> line_of_file;
  std::map<int32_t, size_t> line_of_view;
  for (const int v : scene.train) {
    const View& view = scene.views[static_cast<size_t>(v)];
    const auto file = view.image_path.empty() ? std::filesystem::path(view.name) : view.image_path;
    const auto [line, is_new] = line_of_file.try_emplace(file, lines_.size());
    if (is_new) {
      const size_t bins = bins_of(scene.cameras[static_cast<size_t>(view.camera)]);
      lines_.push_back({.height = std::vector<double>(bins, kHorizon)});
    }
    line_of_view[v] = line->second;
    line_of_.push_back(line->second);
  }
  std::vector<std::vector<double>> highest, distances(lines_.size());
  for (const Line& line : lines_) highest.push_back(line.height);
  for (const Observation& seen : scene.observations) {
    const ScenePoint& point = scene.points[static_cast<size_t>(seen.point)];
    const auto at = line_of_view.find(seen.image);
    if (point.views < kSureViews || at == line_of_view.end()) continue;
    const Pose& pose = scene.views[static_cast<size_t>(seen.image)].pose;
    const Vec3d away =
        scene.to_engine.apply(point.position) - scene.to_engine.apply(pose).translation;
    distances[at->second].push_back(length(away));
    const double height = normalized(away).z;
    Line& line = lines_[at->second];
    ++line.points;
    const size_t bins = line.height.size(), middle = line.bin_of(away);
    for (const size_t bin : {middle + bins - 1, middle, middle + 1}) {
      double& first = highest[at->second][bin % bins];
      double& second = line.height[bin % bins];
      second = std::max(second, std::min(first, height));
      first = std::max(first, height);
    }
  }
  for (size_t i = 0; i < lines_.size(); ++i)
    if (lines_[i].points >= kEnoughPoints) lines_[i].reach = reach_of(std::move(distances[i]));
}

std::optional<SampleRange> Skylines::matter(size_t photo, const Vec3d& direction) const {
  constexpr double kMargin = 0.02;  // matter ends somewhat above its highest point
  constexpr double kNoEnd = std::numeric_limits<double>::infinity();
  if (!is_known(photo)) return SampleRange{0, kNoEnd};
  const Line& line = lines_[line_of_[photo]];
  if (direction.z > line.height[line.bin_of(direction)] + kMargin) return std::nullopt;
  SampleRange reach = line.reach;
  if (direction.z <= kHorizon) reach.far = kNoEnd;
  return reach;
}

std::optional<double> share_above_points(const Scene& scene, const PhotoSet& photos) {
  constexpr int kSide = 32;  // of a lattice over each photo
  const Skylines skylines(scene);
  int above = 0, all = 0;
  for (size_t i = 0; i < scene.train.size(); ++i) {
    if (!skylines.is_known(i)) continue;
    const size_t v = static_cast<size_t>(scene.train[i]);
    const auto rotation = scene.to_engine.apply(scene.views[v].pose).rotation;
    const Camera& camera = photos.cameras[v];
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const Vec2d at{(x + 0.5) * camera.width / kSide, (y + 0.5) * camera.height / kSide};
        const auto direction = unproject(camera, at);
        if (!direction) continue;
        ++all;
        above += !photos.photos[v].masked_out(static_cast<int>(at.x), static_cast<int>(at.y)) &&
                 !skylines.matter(i, normalized(rotation * *direction));
      }
  }
  if (all == 0) return std::nullopt;
  return static_cast<double>(above) / all;
}

}  // namespace nerf
