#include "train/sample_range.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include "nerf/base/error.h"

namespace nerf {

namespace {

constexpr double kShare = 0.001;      // of the points, left out at either end
constexpr size_t kEnoughPoints = 20;  // in a view, to tell where its content lies

double quantile(std::vector<double>& sorted, double share) {
  const double last = static_cast<double>(sorted.size() - 1);
  return sorted[static_cast<size_t>(std::lround(share * last))];
}

}  // namespace

SampleRange range_of(const Scene& scene, const TrainOptions& o) {
  if (o.network.space == Space::kNdc) return {0, 1};
  const auto first_of = [](double given, double published, double own) {
    return given > 0 ? given : published > 0 ? published : own;
  };
  return {first_of(o.recipe.near, scene.published_near, scene.near),
          first_of(o.recipe.far, scene.published_far, scene.far)};
}

std::vector<SampleRange> ranges_of_views(const Scene& scene, const TrainOptions& o) {
  if (!o.recipe.photo_range || o.network.space == Space::kNdc) return {};
  std::vector<SampleRange> ranges(scene.views.size(), range_of(scene, o));
  std::vector<std::vector<double>> seen(scene.views.size());
  for (const Observation& seen_point : scene.observations) {
    const size_t v = static_cast<size_t>(seen_point.image);
    const Vec3d& p = scene.points[static_cast<size_t>(seen_point.point)].position;
    seen[v].push_back(length(p - scene.views[v].pose.translation) * scene.to_engine.scale);
  }
  for (size_t v = 0; v < seen.size(); ++v) {
    if (seen[v].size() < kEnoughPoints) continue;
    std::ranges::sort(seen[v]);
    SampleRange own{quantile(seen[v], kShare), quantile(seen[v], 1 - kShare)};
    if (o.recipe.near > 0) own.near = o.recipe.near;
    if (o.recipe.far > 0) own.far = o.recipe.far;
    if (own.near > 0 && static_cast<Real>(own.near) < static_cast<Real>(own.far)) ranges[v] = own;
  }
  // A photo at another scale stands behind the one that points were seen in.
  std::map<std::filesystem::path, SampleRange> of_file;
  for (size_t v = 0; v < ranges.size(); ++v) {
    const View& view = scene.views[v];
    if (view.image_path.empty()) continue;
    if (view.scale == 1)
      of_file.try_emplace(view.image_path, ranges[v]);
    else if (const auto it = of_file.find(view.image_path); it != of_file.end())
      ranges[v] = it->second;
  }
  return ranges;
}

SampleRange range_of_field(const Scene& scene, const TrainOptions& o,
                           const std::vector<SampleRange>& views) {
  SampleRange all = range_of(scene, o);
  if (!views.empty() && !scene.train.empty()) all = views[static_cast<size_t>(scene.train.front())];
  for (size_t i = 0; i < scene.train.size() && !views.empty(); ++i) {
    const SampleRange& own = views[static_cast<size_t>(scene.train[i])];
    all = {std::min(all.near, own.near), std::max(all.far, own.far)};
  }
  if (static_cast<Real>(all.near) < static_cast<Real>(all.far)) return all;
  throw Error(fmt::format("samples would begin at {:.4g} and end at {:.4g} engine units", all.near,
                          all.far),
              "--recipe-near, --recipe-far",
              "give a near distance below the far one; without them they come from the capture");
}

}  // namespace nerf
