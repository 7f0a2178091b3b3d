#include "train/error_map.h"

#include <algorithm>
#include <cmath>

namespace nerf {

namespace {
constexpr Real kUnseen = -1;
constexpr Real kShare = 0.1_r;  // of a tile's memory that one pixel replaces
}  // namespace

ErrorMap::ErrorMap(const PhotoSet& photos, std::span<const int> views, Real guidance)
    : guidance_(guidance) {
  if (keeps_all()) return;
  int32_t tiles = 0;
  for (const int v : views) {
    const Photo& photo = photos.photos[static_cast<size_t>(v)];
    const int32_t columns = (photo.width + kTile - 1) / kTile;
    grids_.push_back({tiles, columns});
    tiles += columns * ((photo.height + kTile - 1) / kTile);
  }
  errors_.resize(static_cast<size_t>(tiles));
  chances_.resize(errors_.size());
  reset();
}

void ErrorMap::reset() {
  std::ranges::fill(errors_, kUnseen);
  refresh();
}

void ErrorMap::observe(int32_t tile, Real squared_error) {
  Real& e = errors_[static_cast<size_t>(tile)];
  e = e < 0 ? squared_error : e + kShare * (squared_error - e);
}

void ErrorMap::refresh() {
  double sum = 0;
  int64_t seen = 0;
  for (const Real e : errors_) {
    if (e < 0) continue;
    sum += static_cast<double>(std::sqrt(e));
    ++seen;
  }
  const Real scale = sum > 0 ? static_cast<Real>(static_cast<double>(seen) / sum) : 0;
  for (size_t i = 0; i < errors_.size(); ++i) {
    const Real ratio = errors_[i] < 0 || scale == 0 ? 1 : std::sqrt(errors_[i]) * scale;
    const Real chance = ((1 - guidance_) + guidance_ * ratio) / kMostFavoured;
    chances_[i] = static_cast<uint8_t>(std::clamp(256 * chance - 1, 0.0_r, 255.0_r));
  }
}

}  // namespace nerf
