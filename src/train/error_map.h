// Where the training photos are not learnt yet: a running mean of the squared error over small
// tiles, and from it how often a pixel is drawn.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "nerf/io/photos.h"

namespace nerf {

// A pixel that is drawn uniformly is kept with a chance that grows with the root of its tile's
// error against the mean of those roots: with guidance g and a tile of average error, (1 - g) + g
// times that ratio, over kMostFavoured and at most 1. Tiles that were never seen count as average.
class ErrorMap {
 public:
  static constexpr Real kMostFavoured = 2;

  // Of the photos `views` of the set, in that order. guidance in [0, 1]; 0 keeps every pixel.
  ErrorMap(const PhotoSet& photos, std::span<const int> views, Real guidance);

  bool keeps_all() const { return guidance_ == 0; }
  // Tile of pixel (x, y) of the i-th of the views.
  int32_t tile_of(size_t i, int x, int y) const {
    const Grid& g = grids_[i];
    return g.first + (y / kTile) * g.columns + x / kTile;
  }
  // In (0, 1].
  Real chance(int32_t tile) const {
    return static_cast<Real>(chances_[static_cast<size_t>(tile)] + 1) * (1.0_r / 256);
  }

  // Asks for the memory that chance() will read.
  void prefetch(int32_t tile) const {
    if (!keeps_all()) __builtin_prefetch(chances_.data() + tile);
  }

  // Squared error of one drawn pixel, summed over channels.
  void observe(int32_t tile, Real squared_error);
  // Makes the chances follow what was observed.
  void refresh();
  void reset();

  // What a checkpoint keeps.
  std::span<Real> errors() { return errors_; }
  std::span<const Real> errors() const { return errors_; }
  std::span<uint8_t> chances() { return chances_; }
  std::span<const uint8_t> chances() const { return chances_; }

 private:
  static constexpr int kTile = 8;  // pixels across
  struct Grid {
    int32_t first, columns;
  };
  Real guidance_;
  std::vector<Grid> grids_;
  std::vector<Real> errors_;  // < 0: never seen
  std::vector<uint8_t> chances_;
};

}  // namespace nerf
