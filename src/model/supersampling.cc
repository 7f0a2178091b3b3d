#include "model/supersampling.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "nerf/model/model_info.h"

namespace nerf {

Frame internal::reduced(const Frame& from, int n) {
  Frame out{from.width / n, from.height / n, {}, {}, {}, from.statistics};
  const float share = 1.0f / static_cast<float>(n * n);
  std::vector<float> depths;
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x) {
      float rgb[3] = {0, 0, 0}, alpha = 0;
      depths.clear();
      for (int i = 0; i < n * n; ++i) {
        const size_t at = static_cast<size_t>(y * n + i / n) * static_cast<size_t>(from.width) +
                          static_cast<size_t>(x * n + i % n);
        for (size_t k = 0; k < 3; ++k) rgb[k] += from.rgb[3 * at + k];
        alpha += from.alpha[at];
        if (from.depth_z[at] > 0) depths.push_back(from.depth_z[at]);
      }
      for (const float c : rgb) out.rgb.push_back(c * share);
      out.alpha.push_back(alpha * share);
      const auto middle = depths.begin() + static_cast<ptrdiff_t>(depths.size() / 2);
      if (!depths.empty()) std::nth_element(depths.begin(), middle, depths.end());
      out.depth_z.push_back(2 * static_cast<int>(depths.size()) > n * n ? *middle : 0.0f);
    }
  return out;
}

int automatic_supersampling(const ModelInfo& info, const Camera& camera,
                            const Pose& camera_to_world) {
  // Width of a pixel where the scene is: one unit behind its middle, so that cameras in the middle
  // count too.
  const auto width = [&](const Camera& c, const Pose& pose) {
    const Vec2d centre{0.5 * c.width, 0.5 * c.height};
    return pixel_cone_radius(c, centre) * (1 + length(info.to_engine.apply(pose.translation)));
  };
  std::vector<double> widths;
  for (const ModelView& view : info.views)
    if (!view.held_out) widths.push_back(width(view.camera, view.pose));
  const double own = width(camera, camera_to_world);
  if (widths.empty() || !std::isfinite(own)) return 1;
  const auto middle = widths.begin() + static_cast<ptrdiff_t>(widths.size() / 2);
  std::nth_element(widths.begin(), middle, widths.end());
  if (!(*middle > 0)) return 1;
  const int most =
      std::max(1, std::min(kMostSupersampling, (1 << 14) / std::max(camera.width, camera.height)));
  return static_cast<int>(std::clamp(std::round(own / *middle), 1.0, static_cast<double>(most)));
}

}  // namespace nerf
