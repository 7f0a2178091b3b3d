#include "nerf/io/depth_image.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "nerf/base/error.h"

namespace nerf {
namespace {

bool has_depth(float depth, float alpha) {
  return depth > 0 && std::isfinite(depth) && alpha > 0 && std::isfinite(alpha);
}

}  // namespace

Vec3 turbo_color(float x) {
  // Entries 0, 15, 30, ..., 255 of the published table of 256.
  constexpr int kKnots = 18;
  constexpr float kTable[kKnots][3] = {
      {0.18995f, 0.07176f, 0.23217f}, {0.24830f, 0.24143f, 0.61286f},
      {0.27509f, 0.40072f, 0.86692f}, {0.26878f, 0.54995f, 0.99303f},
      {0.18625f, 0.69775f, 0.95498f}, {0.10026f, 0.82955f, 0.81389f},
      {0.13526f, 0.92197f, 0.66556f}, {0.32006f, 0.97974f, 0.47654f},
      {0.54658f, 0.99907f, 0.29581f}, {0.71577f, 0.96875f, 0.20815f},
      {0.85868f, 0.88655f, 0.21230f}, {0.96049f, 0.77181f, 0.22811f},
      {0.99654f, 0.63193f, 0.18738f}, {0.97545f, 0.45740f, 0.11305f},
      {0.91024f, 0.29599f, 0.04814f}, {0.80799f, 0.17753f, 0.01660f},
      {0.66449f, 0.08436f, 0.00424f}, {0.47960f, 0.01583f, 0.01055f}};
  const float place = (x >= 0 ? std::min(x, 1.0f) : 0.0f) * (kKnots - 1);
  const int below = std::min(static_cast<int>(place), kKnots - 2);
  const float u = place - static_cast<float>(below);
  Vec3 color;
  for (int c = 0; c < 3; ++c) color[c] = kTable[below][c] * (1 - u) + kTable[below + 1][c] * u;
  return color;
}

DepthRange depth_range(std::span<const float> depth, std::span<const float> alpha, double low,
                       double high) {
  NERF_CHECK_EQ(depth.size(), alpha.size());
  std::vector<std::pair<float, float>> seen;  // depth and its weight
  seen.reserve(depth.size());
  double whole = 0;
  for (size_t i = 0; i < depth.size(); ++i)
    if (has_depth(depth[i], alpha[i])) {
      seen.emplace_back(depth[i], alpha[i]);
      whole += static_cast<double>(alpha[i]);
    }
  if (seen.empty()) return {};
  std::sort(seen.begin(), seen.end());
  DepthRange range{seen.back().first, seen.back().first};
  double sum = 0;
  bool found_near = false;
  for (const auto& [d, weight] : seen) {
    sum += static_cast<double>(weight);
    if (!found_near && sum >= low * whole) {
      range.near = d;
      found_near = true;
    }
    if (sum >= high * whole) {
      range.far = d;
      break;
    }
  }
  return range;
}

DepthRange merged(std::span<const DepthRange> ranges) {
  DepthRange all;
  for (const DepthRange& r : ranges) {
    if (r.empty()) continue;
    all = all.empty() ? r : DepthRange{std::min(all.near, r.near), std::max(all.far, r.far)};
  }
  return all;
}

Image8 depth_image(int width, int height, std::span<const float> depth,
                   std::span<const float> alpha, const DepthRange& range) {
  const size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
  NERF_CHECK_EQ(depth.size(), pixels);
  NERF_CHECK_EQ(alpha.size(), pixels);
  Image8 image;
  image.width = width;
  image.height = height;
  image.channels = 3;
  image.pixels.assign(3 * pixels, 0);
  if (range.empty()) return image;
  const double lowest = 1 / range.far;
  const double span = 1 / std::max(range.near, 1e-12) - lowest;
  for (size_t i = 0; i < pixels; ++i) {
    if (!has_depth(depth[i], alpha[i])) continue;
    // A flat scene has no span: all of it is near.
    const double x = span > 0 ? (1 / static_cast<double>(depth[i]) - lowest) / span : 1.0;
    const Vec3 color = turbo_color(static_cast<float>(x)) * std::min(alpha[i], 1.0f);
    for (int c = 0; c < 3; ++c)
      image.pixels[3 * i + static_cast<size_t>(c)] =
          static_cast<uint8_t>(std::lround(color[c] * 255.0f));
  }
  return image;
}

}  // namespace nerf
