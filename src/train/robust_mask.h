// What moved while the photos were taken: pixels whose error stays large where their surroundings'
// does too teach nothing.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "nerf/base/real.h"
#include "nerf/io/photos.h"

namespace nerf {

struct RayBatch;

// Trimmed least squares (Sabour et al. 2023, section 4.2) for pixels that are drawn one by one: a
// pixel is left out where its error is among the largest `share` of all recent ones and so are many
// recent errors of its tile and the tiles around it, which take the place of the paper's patch:
// what passes by has an outline, and parts that happen to look like what they hide. Beside such a
// tile it takes some of the tile's own errors: what passes by ends within tiles. The histogram
// of errors decays as in SpotLessSplats (Sabour et al. 2024, its robust filter), and pixels are
// left out little by little from the first steps on. Of no photo more than kMostOfPhoto of its
// tiles are left out: then its light is another, or its camera is wrong.
class RobustMask {
 public:
  static constexpr double kMostOfPhoto = 0.4;

  // views: indices of the training photos.
  RobustMask(const PhotoSet& photos, std::span<const int> views, double share);

  // Of pixel (x, y) of the i-th training photo.
  int32_t tile_of(size_t source, int x, int y) const;
  // Whether a pixel with this error (absolute, mean over channels) teaches nothing in step `step`;
  // `chance` in [0, 1) is its random number.
  bool leaves_out(int32_t tile, Real error, int64_t step, Real chance) const;
  // Takes in the error of every ray of a step's chunks, [chunk][kChunkRays], in their order.
  void observe(const RayBatch& batch, std::span<const Real> errors, double progress);
  // Whether the tile of pixel (x, y) of the i-th training photo is.
  bool is_left_out(size_t source, int x, int y) const {
    return trusted_[source] && is_out(tile_of(source, x, y));
  }

  // Between steps, for a checkpoint.
  template <class T, class Visit>
  static void visit_arrays(T& t, Visit&& visit) {
    visit("robust_errors", std::span(t.histogram_));
    visit("robust_tiles", std::span(t.outliers_));
  }
  void find_threshold(double progress);  // behind loading
  void reset();

 private:
  struct Tiles {
    int width = 0, height = 0;
    int32_t first = 0;
  };
  bool is_out(int32_t tile) const { return out_[static_cast<size_t>(tile)] == kOut; }
  void find_tiles(const Tiles& t);
  void grow_tiles(const Tiles& t);
  void find_photos();

  double share_;
  int side_ = 8;  // of a tile, pixels
  std::vector<Tiles> tiles_;
  std::vector<int32_t> photo_of_;            // of each tile
  std::vector<uint8_t> trusted_;             // photos of which tiles may be left out
  std::vector<Real> outliers_;               // running share of a tile's errors above the threshold
  enum : uint8_t { kIn, kOut, kBesideOut };  // kOut: around which they are many
  std::vector<uint8_t> out_;                 // of each tile
  std::vector<Real> histogram_;              // of errors, decaying
  Real threshold_ = 1;
};

}  // namespace nerf
