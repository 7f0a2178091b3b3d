#include "nerf/io/depth_map.h"

#include <algorithm>
#include <cmath>

#include "half.h"

namespace nerf {

double DepthMap::pixel(int x, int y) const {
  return static_cast<double>(internal::half_to_float(
      z[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)]));
}

double DepthMap::at(double u, double v) const {
  if (empty()) return 0;
  const double x = std::clamp(u * width - 0.5, 0.0, width - 1.0);
  const double y = std::clamp(v * height - 0.5, 0.0, height - 1.0);
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, width - 1), y1 = std::min(y0 + 1, height - 1);
  const double a = pixel(x0, y0), b = pixel(x1, y0), c = pixel(x0, y1), d = pixel(x1, y1);
  const double least = std::min({a, b, c, d}), most = std::max({a, b, c, d});
  if (!(least > 0) || most > least * (1 + kDepthEdge)) return 0;
  return 1 / std::lerp(std::lerp(1 / a, 1 / b, x - x0), std::lerp(1 / c, 1 / d, x - x0), y - y0);
}

}  // namespace nerf
