#include "nerf/io/depth_image.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "nerf/base/error.h"

namespace nerf {
namespace {

bool has_depth(Real depth, Real alpha) {
  return depth > 0 && std::isfinite(depth) && alpha > 0 && std::isfinite(alpha);
}

constexpr int kKnots = 18;

Vec3 between(const Real (&table)[kKnots][3], Real x) {
  const Real place = (x >= 0 ? std::min(x, 1.0_r) : 0.0_r) * (kKnots - 1);
  const int below = std::min(static_cast<int>(place), kKnots - 2);
  const Real u = place - static_cast<Real>(below);
  Vec3 color;
  for (int c = 0; c < 3; ++c) color[c] = table[below][c] * (1 - u) + table[below + 1][c] * u;
  return color;
}

Image8 black(int width, int height) {
  const size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
  return {width, height, 3, std::vector<uint8_t>(3 * pixels)};
}

void put(const Vec3& color, Real alpha, uint8_t* pixel) {
  const Vec3 over_black = color * std::min(alpha, 1.0_r);
  for (int c = 0; c < 3; ++c) pixel[c] = static_cast<uint8_t>(std::lround(over_black[c] * 255.0_r));
}

}  // namespace

Vec3 turbo_color(Real x) {
  // Entries 0, 15, 30, ..., 255 of the published table of 256.
  constexpr Real kTable[kKnots][3] = {
      {0.18995_r, 0.07176_r, 0.23217_r}, {0.24830_r, 0.24143_r, 0.61286_r},
      {0.27509_r, 0.40072_r, 0.86692_r}, {0.26878_r, 0.54995_r, 0.99303_r},
      {0.18625_r, 0.69775_r, 0.95498_r}, {0.10026_r, 0.82955_r, 0.81389_r},
      {0.13526_r, 0.92197_r, 0.66556_r}, {0.32006_r, 0.97974_r, 0.47654_r},
      {0.54658_r, 0.99907_r, 0.29581_r}, {0.71577_r, 0.96875_r, 0.20815_r},
      {0.85868_r, 0.88655_r, 0.21230_r}, {0.96049_r, 0.77181_r, 0.22811_r},
      {0.99654_r, 0.63193_r, 0.18738_r}, {0.97545_r, 0.45740_r, 0.11305_r},
      {0.91024_r, 0.29599_r, 0.04814_r}, {0.80799_r, 0.17753_r, 0.01660_r},
      {0.66449_r, 0.08436_r, 0.00424_r}, {0.47960_r, 0.01583_r, 0.01055_r}};
  return between(kTable, x);
}

Vec3 viridis_color(Real x) {
  // Likewise.
  constexpr Real kTable[kKnots][3] = {
      {0.267004_r, 0.004874_r, 0.329415_r}, {0.281924_r, 0.089666_r, 0.412415_r},
      {0.280255_r, 0.165693_r, 0.476498_r}, {0.263663_r, 0.237631_r, 0.518762_r},
      {0.237441_r, 0.305202_r, 0.541921_r}, {0.208623_r, 0.367752_r, 0.552675_r},
      {0.182256_r, 0.426184_r, 0.557120_r}, {0.159194_r, 0.482237_r, 0.558073_r},
      {0.137770_r, 0.537492_r, 0.554906_r}, {0.121148_r, 0.592739_r, 0.544641_r},
      {0.128087_r, 0.647749_r, 0.523491_r}, {0.180653_r, 0.701402_r, 0.488189_r},
      {0.274149_r, 0.751988_r, 0.436601_r}, {0.395174_r, 0.797475_r, 0.367757_r},
      {0.535621_r, 0.835785_r, 0.281908_r}, {0.688944_r, 0.865448_r, 0.182725_r},
      {0.845561_r, 0.887322_r, 0.099702_r}, {0.993248_r, 0.906157_r, 0.143936_r}};
  return between(kTable, x);
}

Vec3 depth_color(DepthLook map, Real x) {
  if (map == DepthLook::kTurbo) return turbo_color(x);
  if (map == DepthLook::kViridis) return viridis_color(x);
  const Real grey = x >= 0 ? std::min(x, 1.0_r) : 0.0_r;
  return {grey, grey, grey};
}

DepthRange depth_range(std::span<const Real> depth, std::span<const Real> alpha, double low,
                       double high) {
  NERF_CHECK_EQ(depth.size(), alpha.size());
  std::vector<std::pair<Real, Real>> seen;  // depth and its weight
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

Image8 depth_image(int width, int height, std::span<const Real> depth, std::span<const Real> alpha,
                   const DepthRange& range, DepthLook map) {
  Image8 image = black(width, height);
  const size_t pixels = image.pixels.size() / 3;
  NERF_CHECK_EQ(depth.size(), pixels);
  NERF_CHECK_EQ(alpha.size(), pixels);
  if (range.empty()) return image;
  const double lowest = 1 / range.far;
  const double span = 1 / std::max(range.near, 1e-12) - lowest;
  for (size_t i = 0; i < pixels; ++i) {
    if (!has_depth(depth[i], alpha[i])) continue;
    // A flat scene has no span: all of it is near.
    const double x = span > 0 ? (1 / static_cast<double>(depth[i]) - lowest) / span : 1.0;
    put(depth_color(map, static_cast<Real>(x)), alpha[i], image.pixels.data() + 3 * i);
  }
  return image;
}

Image8 normal_image(int width, int height, std::span<const Real> normals,
                    std::span<const Real> alpha) {
  Image8 image = black(width, height);
  NERF_CHECK_EQ(normals.size(), image.pixels.size());
  NERF_CHECK_EQ(3 * alpha.size(), image.pixels.size());
  for (size_t i = 0; i < alpha.size(); ++i) {
    const Vec3 n{normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]};
    if (n == Vec3() || !(alpha[i] > 0)) continue;
    put((n + Vec3{1, 1, 1}) * 0.5_r, alpha[i], image.pixels.data() + 3 * i);
  }
  return image;
}

}  // namespace nerf
