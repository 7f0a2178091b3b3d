// Cells of space that may hold a paper method's matter: samples in the others are not asked for.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "nerf/base/threads.h"
#include "nerf/math/vec.h"

namespace nerf::internal {

// Cells of the space that the networks' positions live in (warped, where the method warps it): one
// grid over [-1, 1]^3, a coarser one over [-2, 2]^3; for each network its own, since what a level
// draws from the weights of the one before is sensitive to the faintest of them.
class MatterCells {
 public:
  static constexpr int kCascades = 2;

  // Of the last level and of those before it, cells of one grid behind the other's, x fastest;
  // before: empty where all levels share one.
  MatterCells(int side, std::vector<uint8_t> last, std::vector<uint8_t> before)
      : side_(side), last_(std::move(last)), before_(std::move(before)) {}

  // Whether the density of the last level, or of those before it, may be above 0 at p. True outside
  // the grids.
  bool may_hold(const Vec3& p, bool last) const {
    const int64_t cell = cell_of(side_, p);
    return cell < 0 || may_hold(cell, last);
  }
  bool may_hold(int64_t cell, bool last) const {
    return (last || before_.empty() ? last_ : before_)[static_cast<size_t>(cell)] != 0;
  }
  double occupied_fraction() const;  // of the last level

  static constexpr int64_t cells_of(int side) { return int64_t{side} * side * side; }  // of a grid
  static Real width(int side, int cascade) {
    return std::ldexp(2.0_r / static_cast<Real>(side), cascade);
  }
  // Cell of p among those of all grids; below 0 outside them.
  static int64_t cell_of(int side, const Vec3& p) {
    const Real most = std::max({std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
    if (!(most < 2)) return -1;
    const int cascade = most < 1 ? 0 : 1;
    const Real scale = 1 / width(side, cascade);
    int64_t at[3];
    for (int k = 0; k < 3; ++k)
      at[k] = std::clamp<int64_t>(static_cast<int64_t>(std::floor(p[k] * scale)) + side / 2, 0,
                                  side - 1);
    return cascade * cells_of(side) + (at[2] * side + at[1]) * side + at[0];
  }

  // Each cell of the grid that begins at `first` becomes 1 where it or one of its 26 neighbours is.
  static void grow(std::vector<uint8_t>& cells, int side, int64_t first, ThreadPool& pool);

 private:
  int side_;
  std::vector<uint8_t> last_, before_;
};

}  // namespace nerf::internal
