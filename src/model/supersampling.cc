#include "model/supersampling.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "model/layer_reduction.h"
#include "nerf/base/error.h"
#include "nerf/model/model_info.h"
#include "nerf/model/radiance_field.h"

namespace nerf {

namespace {

constexpr int64_t kBandPixels = int64_t{1} << 22;

using internal::append_reduced_layers;

// Appends the pixels of n x n of `from` each.
void append_reduced(const Frame& from, int n, Frame& out) {
  const Real share = 1.0_r / static_cast<Real>(n * n);
  std::vector<Real> depths;
  for (int y = 0; y < from.height / n; ++y)
    for (int x = 0; x < from.width / n; ++x) {
      Real rgb[3] = {0, 0, 0}, alpha = 0;
      depths.clear();
      for (int i = 0; i < n * n; ++i) {
        const size_t at = static_cast<size_t>(y * n + i / n) * static_cast<size_t>(from.width) +
                          static_cast<size_t>(x * n + i % n);
        for (size_t k = 0; k < 3; ++k) rgb[k] += from.rgb[3 * at + k];
        alpha += from.alpha[at];
        if (from.depth_z[at] > 0) depths.push_back(from.depth_z[at]);
      }
      for (const Real c : rgb) out.rgb.push_back(c * share);
      out.alpha.push_back(alpha * share);
      const auto middle = depths.begin() + static_cast<ptrdiff_t>(depths.size() / 2);
      if (!depths.empty()) std::nth_element(depths.begin(), middle, depths.end());
      out.depth_z.push_back(2 * static_cast<int>(depths.size()) > n * n ? *middle : 0.0_r);
    }
  out.statistics += from.statistics;
  append_reduced_layers(from, n, out.layers);
}

int automatic(const ModelInfo& info, const Camera& camera, const Pose& camera_to_world) {
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
  return static_cast<int>(std::clamp(std::round(own / *middle), 1.0, double{kMostSupersampling}));
}

}  // namespace

Frame internal::render_supersampled(int n, const Camera& camera,
                                    const std::function<void(double)>& progress,
                                    const RenderPart& render) {
  const Camera large = camera.scaled_to(n * camera.width, n * camera.height);
  const int rows = static_cast<int>(
      std::clamp<int64_t>(kBandPixels / (int64_t{n} * large.width), 1, camera.height));
  Frame out{camera.width, camera.height, {}, {}, {}};
  for (int y = 0; y < camera.height; y += rows) {
    const int count = std::min(rows, camera.height - y);
    const std::function<void(double)> band_progress = [&](double share) {
      progress((y + share * count) / camera.height);
    };
    append_reduced(render(large.rows(n * y, n * count),
                          progress ? band_progress : std::function<void(double)>()),
                   n, out);
  }
  return out;
}

int rays_per_side(const RadianceField& field, const RenderOptions& options, const Camera& camera,
                  const Pose& camera_to_world) {
  NERF_CHECK(options.supersample >= 0 && options.supersample <= kMostSupersampling);
  if (options.supersample > 0) return options.supersample;
  return field.is_grid() ? automatic(field.info(), camera, camera_to_world) : 1;
}

}  // namespace nerf
