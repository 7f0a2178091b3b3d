#include "nerf/train/metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "nerf/base/error.h"

namespace nerf {
namespace {

constexpr int kWindow = 11, kHalf = kWindow / 2;
// Windows of a tile, whose filtered rows stay in a core's cache.
constexpr int kTileRows = 64, kTileColumns = 200;
// Moments of a window: a, b, a^2, b^2, a b; with a mask also the weight of what counts.
constexpr size_t kMoments = 5;

std::array<double, kWindow> window_weights() {
  std::array<double, kWindow> weights;
  double sum = 0;
  for (int i = 0; i < kWindow; ++i) {
    const double z = (i - kHalf) / 1.5;
    sum += weights[static_cast<size_t>(i)] = std::exp(-0.5 * z * z);
  }
  for (double& w : weights) w /= sum;
  return weights;
}

void check_alike(const Image8& a, const Image8& b, std::span<const uint8_t> mask) {
  NERF_CHECK_EQ(a.width, b.width);
  NERF_CHECK_EQ(a.height, b.height);
  NERF_CHECK_EQ(a.channels, b.channels);
  const size_t pixels = static_cast<size_t>(a.width) * static_cast<size_t>(a.height);
  NERF_CHECK_EQ(a.pixels.size(), pixels * static_cast<size_t>(a.channels));
  NERF_CHECK_EQ(b.pixels.size(), a.pixels.size());
  if (!mask.empty()) NERF_CHECK_EQ(mask.size(), pixels);
}

struct Sum {
  double value = 0;
  int64_t count = 0;
};

double similarity(const double* m) {
  constexpr double kC1 = 0.01 * 0.01, kC2 = 0.03 * 0.03;
  const double mu_ab = m[0] * m[1], mu_aa = m[0] * m[0], mu_bb = m[1] * m[1];
  const double var_a = std::max(0.0, m[2] - mu_aa), var_b = std::max(0.0, m[3] - mu_bb);
  const double most = std::sqrt(var_a * var_b);
  const double cov = std::clamp(m[4] - mu_ab, -most, most);
  return (2 * mu_ab + kC1) * (2 * cov + kC2) / ((mu_aa + mu_bb + kC1) * (var_a + var_b + kC2));
}

// out[i] = sum over k of weights[k] * in[i + k * step]. With the taps innermost and unrolled, the
// compiler keeps the sum in a register and takes several i at a time.
void filter(const double* __restrict in, size_t step, size_t count, double* __restrict out) {
  static const std::array<double, kWindow> kWeights = window_weights();
  const std::array<double, kWindow> w = kWeights;
  for (size_t i = 0; i < count; ++i) {
    const double* p = in + i;
    out[i] = w[0] * p[0] + w[1] * p[step] + w[2] * p[2 * step] + w[3] * p[3 * step] +
             w[4] * p[4 * step] + w[5] * p[5 * step] + w[6] * p[6 * step] + w[7] * p[7 * step] +
             w[8] * p[8 * step] + w[9] * p[9 * step] + w[10] * p[10 * step];
  }
}

struct Tile {
  int x0 = 0, x1 = 0, y0 = 0, y1 = 0;  // windows by their upper left pixel; ends excluded
};

Sum tile_sum(const Image8& a, const Image8& b, std::span<const uint8_t> mask, const Tile& tile) {
  const auto channels = static_cast<size_t>(a.channels);
  const auto rows = static_cast<size_t>(tile.y1 - tile.y0);
  const size_t count = static_cast<size_t>(tile.x1 - tile.x0) * channels;
  const size_t in_count = count + (kWindow - 1) * channels;
  const size_t in_rows = rows + kWindow - 1;
  const size_t filters = kMoments + (mask.empty() ? 0 : 1);
  // Along the rows first: moment k of image row r of the tile is filtered[(k * in_rows + r) *
  // count].
  std::vector<double> products(filters * in_count), filtered(filters * in_rows * count);
  for (size_t r = 0; r < in_rows; ++r) {
    const size_t pixel = (static_cast<size_t>(tile.y0) + r) * static_cast<size_t>(a.width) +
                         static_cast<size_t>(tile.x0);
    const uint8_t* row_a = a.pixels.data() + pixel * channels;
    const uint8_t* row_b = b.pixels.data() + pixel * channels;
    double* p = products.data();
    for (size_t i = 0; i < in_count; ++i) {
      const double va = row_a[i] * (1 / 255.0), vb = row_b[i] * (1 / 255.0);
      p[i] = va;
      p[in_count + i] = vb;
      p[2 * in_count + i] = va * va;
      p[3 * in_count + i] = vb * vb;
      p[4 * in_count + i] = va * vb;
    }
    for (size_t i = 0; i < in_count && !mask.empty(); ++i) {
      const bool counts = mask[pixel + i / channels] != 0;
      for (size_t k = 0; k < kMoments; ++k) p[k * in_count + i] *= counts;
      p[kMoments * in_count + i] = counts;
    }
    for (size_t k = 0; k < filters; ++k) {
      filter(p + k * in_count, channels, count, &filtered[(k * in_rows + r) * count]);
    }
  }
  std::vector<double> window(filters * count);
  Sum sum;
  for (size_t y = 0; y < rows; ++y) {
    for (size_t k = 0; k < filters; ++k) {
      filter(&filtered[(k * in_rows + y) * count], count, count, &window[k * count]);
    }
    const size_t centre =
        (static_cast<size_t>(tile.y0) + y + kHalf) * static_cast<size_t>(a.width) +
        static_cast<size_t>(tile.x0) + kHalf;
    for (size_t i = 0; i < count; ++i) {
      if (!mask.empty() && mask[centre + i / channels] == 0) continue;
      double moments[kMoments];
      const double weight = mask.empty() ? 1 : window[kMoments * count + i];
      for (size_t k = 0; k < kMoments; ++k) moments[k] = window[k * count + i] / weight;
      sum.value += similarity(moments);
      ++sum.count;
    }
  }
  return sum;
}

}  // namespace

std::optional<double> psnr(const Image8& a, const Image8& b, std::span<const uint8_t> mask) {
  check_alike(a, b, mask);
  const auto channels = static_cast<size_t>(a.channels);
  uint64_t squares = 0, count = 0;  // whole numbers: exact in any order
  for (size_t i = 0; i < a.pixels.size(); ++i) {
    if (!mask.empty() && mask[i / channels] == 0) continue;
    const int difference = int{a.pixels[i]} - int{b.pixels[i]};
    squares += static_cast<uint64_t>(difference * difference);
    ++count;
  }
  if (count == 0) return std::nullopt;
  if (squares == 0) return kHighestPsnr;
  const double mean = static_cast<double>(squares) / static_cast<double>(count) / (255.0 * 255.0);
  return std::min(kHighestPsnr, -10 * std::log10(mean));
}

std::optional<double> ssim(const Image8& a, const Image8& b, ThreadPool& pool,
                           std::span<const uint8_t> mask) {
  check_alike(a, b, mask);
  if (a.width < kWindow || a.height < kWindow || a.channels < 1) return std::nullopt;
  const int columns = a.width - kWindow + 1, rows = a.height - kWindow + 1;
  std::vector<Tile> tiles;
  for (int y = 0; y < rows; y += kTileRows) {
    for (int x = 0; x < columns; x += kTileColumns) {
      tiles.push_back({x, std::min(columns, x + kTileColumns), y, std::min(rows, y + kTileRows)});
    }
  }
  std::vector<Sum> sums(tiles.size());
  pool.parallel_for(static_cast<int64_t>(tiles.size()), [&](int64_t i) {
    sums[static_cast<size_t>(i)] = tile_sum(a, b, mask, tiles[static_cast<size_t>(i)]);
  });
  Sum total;
  for (const Sum& s : sums) {
    total.value += s.value;
    total.count += s.count;
  }
  if (total.count == 0) return std::nullopt;
  return total.value / static_cast<double>(total.count);
}

}  // namespace nerf
