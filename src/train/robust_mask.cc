#include "train/robust_mask.h"

#include <algorithm>
#include <cmath>

#include "train/ray_batch.h"

namespace nerf {

namespace {

constexpr size_t kBins = 1024;       // of errors, by their root, in [0, 1]
constexpr Real kDecay = 0.95_r;      // of the histogram, from step to step
constexpr Real kTileMemory = 0.7_r;  // of a tile, from pixel to pixel
// An error that is none of a field which has learnt; at last no less is left out. At first any is,
// or the field would learn what passes by.
constexpr Real kCertain = 0.1_r;
// Weight of a tile beside another (across a corner its square), and the mean share of errors above
// the threshold from which on a tile is out.
constexpr Real kBeside = 0.5_r, kMany = 0.4_r;
// The share of a tile's own errors from which on it is out beside one that is: what passes by ends
// within tiles.
constexpr Real kSome = 0.2_r;
constexpr int64_t kMostTiles = 1 << 16;
constexpr double kWarmUp = 0.1;  // Bernoulli schedule: share exp(-kWarmUp step) teaches anyway

size_t bin_of(Real error) {
  const Real place = std::sqrt(std::clamp(error, 0.0_r, 1.0_r)) * static_cast<Real>(kBins);
  return std::min(kBins - 1, static_cast<size_t>(place));
}

}  // namespace

RobustMask::RobustMask(const PhotoSet& photos, std::span<const int> views, double share)
    : share_(share), trusted_(views.size(), 1), histogram_(kBins) {
  int64_t pixels = 0;
  for (const int v : views) {
    const Photo& p = photos.photos[static_cast<size_t>(v)];
    pixels += int64_t{p.width} * p.height;
  }
  // Few enough for each to be met every few steps.
  while (pixels / (int64_t{side_} * side_) > kMostTiles) ++side_;
  int32_t first = 0;
  for (size_t i = 0; i < views.size(); ++i) {
    const Photo& p = photos.photos[static_cast<size_t>(views[i])];
    Tiles t{(p.width + side_ - 1) / side_, (p.height + side_ - 1) / side_, first};
    first += t.width * t.height;
    photo_of_.resize(static_cast<size_t>(first), static_cast<int32_t>(i));
    tiles_.push_back(t);
  }
  outliers_.resize(static_cast<size_t>(first));
  out_.resize(outliers_.size());
}

int32_t RobustMask::tile_of(size_t source, int x, int y) const {
  const Tiles& t = tiles_[source];
  return t.first + (y / side_) * t.width + x / side_;
}

bool RobustMask::leaves_out(int32_t tile, Real error, int64_t step, Real chance) const {
  if (tile < 0 || !(error > threshold_) || out_[static_cast<size_t>(tile)] == kIn) return false;
  if (!trusted_[static_cast<size_t>(photo_of_[static_cast<size_t>(tile)])]) return false;
  return static_cast<double>(chance) >= std::exp(-kWarmUp * static_cast<double>(step));
}

void RobustMask::observe(const RayBatch& batch, std::span<const Real> errors, double progress) {
  for (Real& count : histogram_) count *= kDecay;
  for (int c = 0; c < batch.chunks; ++c)
    for (int r = 0; r < batch.rays[static_cast<size_t>(c)]; ++r) {
      const size_t i = static_cast<size_t>(c) * kChunkRays + static_cast<size_t>(r);
      if (batch.tile[i] < 0) continue;
      histogram_[bin_of(errors[i])] += 1;
      Real& share = outliers_[static_cast<size_t>(batch.tile[i])];
      share += (1 - kTileMemory) * ((errors[i] > threshold_ ? 1.0_r : 0.0_r) - share);
    }
  find_threshold(progress);
}

void RobustMask::find_threshold(double progress) {
  double all = 0;
  for (const Real count : histogram_) all += static_cast<double>(count);
  double above = 0;
  size_t bin = kBins;
  while (bin > 0 && above + static_cast<double>(histogram_[bin - 1]) <= share_ * all)
    above += static_cast<double>(histogram_[--bin]);
  const Real root = static_cast<Real>(bin) / static_cast<Real>(kBins);
  threshold_ = all > 0 ? std::max(root * root, kCertain * static_cast<Real>(progress)) : 1.0_r;
  find_photos();
}

void RobustMask::find_tiles(const Tiles& t) {
  const Real* const share = outliers_.data() + t.first;
  uint8_t* const out = out_.data() + t.first;
  for (int y = 0; y < t.height; ++y)
    for (int x = 0; x < t.width; ++x) {
      Real sum = 0, weights = 0;
      for (int v = std::max(0, y - 1); v <= std::min(t.height - 1, y + 1); ++v)
        for (int u = std::max(0, x - 1); u <= std::min(t.width - 1, x + 1); ++u) {
          const Real weight = (u == x ? 1 : kBeside) * (v == y ? 1 : kBeside);
          sum += weight * share[v * t.width + u];
          weights += weight;
        }
      out[y * t.width + x] = sum > kMany * weights ? kOut : kIn;
    }
}

void RobustMask::grow_tiles(const Tiles& t) {
  const Real* const share = outliers_.data() + t.first;
  uint8_t* const out = out_.data() + t.first;
  for (int y = 0; y < t.height; ++y)
    for (int x = 0; x < t.width; ++x) {
      if (out[y * t.width + x] != kIn || !(share[y * t.width + x] > kSome)) continue;
      for (int v = std::max(0, y - 1); v <= std::min(t.height - 1, y + 1); ++v)
        for (int u = std::max(0, x - 1); u <= std::min(t.width - 1, x + 1); ++u)
          if (out[v * t.width + u] == kOut) out[y * t.width + x] = kBesideOut;
    }
}

void RobustMask::find_photos() {
  for (size_t i = 0; i < tiles_.size(); ++i) {
    const Tiles& t = tiles_[i];
    find_tiles(t);
    const auto begin = out_.begin() + t.first;
    const auto out = std::count(begin, begin + t.width * t.height, uint8_t{kOut});
    trusted_[i] = static_cast<double>(out) <= kMostOfPhoto * t.width * t.height;
    grow_tiles(t);
  }
}

void RobustMask::reset() {
  std::ranges::fill(outliers_, 0.0_r);
  std::ranges::fill(out_, uint8_t{kIn});
  std::ranges::fill(histogram_, 0.0_r);
  std::ranges::fill(trusted_, uint8_t{1});
  threshold_ = 1;
}

}  // namespace nerf
