// Where a paper method's trained network has matter, found once by asking it everywhere, so that
// pictures skip the rest.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
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
  static constexpr int kCascades = 2;
  static constexpr int kPoints = 2;  // asked for in each cell
  // Cells across each grid: for all pictures of a scene that stands still, for one of a moment.
  static constexpr int kSide = 128, kMomentSide = 64;

  // Of the last level and of those before it, cells of one grid behind the other's, x fastest;
  // before: empty where all levels share one network.
  BakedOccupancy(int side, std::vector<uint8_t> last, std::vector<uint8_t> before)
      : side_(side), last_(std::move(last)), before_(std::move(before)) {}

  // Whether the density of the last level, or of those before it, may be above 0 at p. True outside
  // the grids.
  bool may_hold(const Vec3& p, bool last) const {
    const Real most = std::max({std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
    if (!(most < 2)) return true;
    const int cascade = most < 1 ? 0 : 1;
    const std::vector<uint8_t>& cells = last || before_.empty() ? last_ : before_;
    return cells[static_cast<size_t>(cascade * cells_of(side_) + cell_of(p, cascade))] != 0;
  }
  double occupied_fraction() const;  // of the last level

  // Whether to find out saves more than half of the evaluations of so many rays.
  static bool pays(const NetworkField& field, uint64_t rays, int side) {
    const uint64_t points =
        static_cast<uint64_t>(kPoints * (cells_of(side) + cells_of(side) * 7 / 8));
    return rays * static_cast<uint64_t>(field.options.sampling.all_samples()) >
           2 * field.networks.size() * points;
  }
  static constexpr int64_t cells_of(int side) { return int64_t{side} * side * side; }

 private:
  int64_t cell_of(const Vec3& p, int cascade) const {
    const Real scale = 1 / baked_cell_width(side_, cascade);
    int64_t at[3];
    for (int k = 0; k < 3; ++k)
      at[k] = std::clamp<int64_t>(static_cast<int64_t>(std::floor(p[k] * scale)) + side_ / 2, 0,
                                  side_ - 1);
    return (at[2] * side_ + at[1]) * side_ + at[0];
  }
  int side_;
  std::vector<uint8_t> last_, before_;
};

// Points, and cones where neither space nor distance is warped and the photos' cameras are known:
// around each point a Gaussian of a random photo's cone is asked for, as long as an interval of the
// first level or shorter. (In warped space cells are too coarse beside its intervals to save
// anything.) Not of a scene that moves: a cell would have to be asked at every moment.
bool can_bake(const NetworkField& field, const ModelInfo& info);

// A cell counts as empty where none of its points, nor of its 26 neighbours', would stop as much as
// a thousandth of the light: over a cell's width, of a cone over an interval of the first level.
// Throws Cancelled.
BakedOccupancy bake_occupancy(const NetworkField& field, const ModelInfo& info, ThreadPool& pool,
                              const Cancel* cancel);

// Of a scene that moves, as it is at `time`. No value where the scene stands still, where a point
// is not what its method asks for, and where finding out does not pay in a picture of so many rays.
// Throws Cancelled.
std::optional<BakedOccupancy> occupancy_at(const NetworkField& field, const ModelInfo& info,
                                           Real time, int64_t rays, ThreadPool& pool,
                                           const Cancel* cancel);

}  // namespace nerf::internal
