// Where a paper method's trained network has matter, found once by asking it everywhere, so that
// pictures skip the rest.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/threads.h"
#include "nerf/math/vec.h"
#include "nerf/model/model_info.h"
#include "nerf/model/network_field.h"

namespace nerf::internal {

inline Real baked_cell_width(int side, int cascade) {
  return std::ldexp(2.0_r / static_cast<Real>(side), cascade);
}

// Cells of the space that the networks' positions live in (warped, where the method warps it): one
// grid over [-1, 1]^3, a coarser one over [-2, 2]^3; for each network its own, since what a level
// draws from the weights of the one before is sensitive to the faintest of them.
class BakedOccupancy {
 public:
  static constexpr int kSide = 128;  // cells across each grid
  static constexpr int kCascades = 2;
  static constexpr int kPoints = 2;  // asked for in each cell
  static constexpr int64_t kCells = int64_t{kSide} * kSide * kSide;

  // Whether the density of the last level, or of those before it, may be above 0 at p. True outside
  // the grids.
  bool may_hold(const Vec3& p, bool last) const {
    const Real most = std::max({std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
    if (!(most < 2)) return true;
    const int cascade = most < 1 ? 0 : 1;
    const std::vector<uint8_t>& cells = last || before_.empty() ? last_ : before_;
    return cells[static_cast<size_t>(cascade * kCells + cell_of(p, cascade))] != 0;
  }
  double occupied_fraction() const;  // of the last level

  // Points that a bake asks a network for.
  static constexpr int64_t kEvaluations = kPoints * (kCells + kCells * 7 / 8);

 private:
  friend BakedOccupancy bake_occupancy(const NetworkField&, const ModelInfo&, ThreadPool&,
                                       const Cancel*);
  static int64_t cell_of(const Vec3& p, int cascade) {
    const Real scale = 1 / baked_cell_width(kSide, cascade);
    int64_t at[3];
    for (int k = 0; k < 3; ++k)
      at[k] = std::clamp<int64_t>(static_cast<int64_t>(std::floor(p[k] * scale)) + kSide / 2, 0,
                                  kSide - 1);
    return (at[2] * kSide + at[1]) * kSide + at[0];
  }
  std::vector<uint8_t> last_, before_;  // before_: empty where all levels share one network
};

// Points, and cones where neither space nor distance is warped and the photos' cameras are known:
// around each point a Gaussian of a random photo's cone is asked for, as long as an interval of the
// first level or shorter. (In warped space cells are too coarse beside its intervals to save
// anything.)
bool can_bake(const NetworkField& field, const ModelInfo& info);

// A cell counts as empty where none of its points, nor of its 26 neighbours', would stop as much as
// a thousandth of the light: over a cell's width, of a cone over an interval of the first level.
// Throws Cancelled.
BakedOccupancy bake_occupancy(const NetworkField& field, const ModelInfo& info, ThreadPool& pool,
                              const Cancel* cancel);

}  // namespace nerf::internal
