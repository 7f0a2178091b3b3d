#include "nerf/io/depth_map.h"

#include <algorithm>
#include <cmath>

#include "half.h"

namespace nerf {

namespace {

// In pixels from the middle of the first to that of the last; on a middle but for rounding.
double place(double share, int size) {
  const double x = std::clamp(share * size - 0.5, 0.0, size - 1.0);
  const double middle = std::round(x);
  return std::abs(x - middle) < 1e-6 ? middle : x;
}

}  // namespace

double DepthMap::pixel(int x, int y) const {
  return static_cast<double>(internal::half_to_float(
      z[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)]));
}

double DepthMap::at(double u, double v) const {
  if (empty()) return 0;
  const double x = place(u, width), y = place(v, height);
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  // At the middle of a pixel its neighbours do not count.
  const int x1 = x > x0 ? x0 + 1 : x0, y1 = y > y0 ? y0 + 1 : y0;
  const double a = pixel(x0, y0), b = pixel(x1, y0), c = pixel(x0, y1), d = pixel(x1, y1);
  const double least = std::min({a, b, c, d}), most = std::max({a, b, c, d});
  if (!(least > 0) || most > least * (1 + kDepthEdge)) return 0;
  return 1 / std::lerp(std::lerp(1 / a, 1 / b, x - x0), std::lerp(1 / c, 1 / d, x - x0), y - y0);
}

}  // namespace nerf
