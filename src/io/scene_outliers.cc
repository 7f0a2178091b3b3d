#include "scene_outliers.h"

#include <fmt/format.h>

#include <algorithm>

#include "scene_statistics.h"

namespace nerf::internal {

void drop_far_cameras(SceneInput& input, SceneReport& report) {
  std::vector<Vec3d> positions;
  for (const View& view : input.views) positions.push_back(view.pose.translation);
  const Vec3d middle = median_position(positions);
  std::vector<double> distances, depths;
  for (const Vec3d& p : positions) distances.push_back(length(p - middle));
  double reach = quantile(distances, 0.8);
  // Four fifths of the photos may be a series from one place: what they look at has a size too.
  constexpr size_t kEnough = 50;
  const std::vector<char> good = supported_points(input.points);
  for (size_t i = 0; i < good.size(); ++i) {
    if (good[i]) depths.push_back(length(input.points[i].position - middle));
  }
  if (depths.size() >= kEnough) reach = std::max(reach, quantile(std::move(depths), 0.5));
  if (!(reach > 0)) return;

  std::vector<char> keep(distances.size());
  std::vector<std::string> names;
  for (size_t i = 0; i < distances.size(); ++i) {
    keep[i] = distances[i] <= kFarOut * reach;
    if (!keep[i]) names.push_back(input.views[i].name);
  }
  if (names.empty()) return;
  report.warnings.push_back(
      fmt::format("{} of {} cameras stand more than {:.0f} times as far out as the others and are "
                  "left out, as badly placed: {}",
                  names.size(), distances.size(), kFarOut, name_list(names)));
  keep_views(input, keep);
}

}  // namespace nerf::internal
