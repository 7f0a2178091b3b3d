// Occupancy with a memory of density: cascades of side^3 cells, each remembering how opaque it is.
//
// Cascade c covers [-2^c, 2^c]^3 in engine coordinates with cells 2^(c+1) / side wide; a point
// belongs to the finest cascade that holds it. A cell's opacity is the mean of 1 - exp(-density *
// width) at random points in it: the share of light that one cell width of its matter stops. Cells
// whose opacity stays under a threshold are empty and skipped; the others give rays a coarse
// distribution of where matter is without asking the network.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/base/real.h"
#include "nerf/base/threads.h"
#include "nerf/math/vec.h"

namespace nerf {

// std::floor() of what fits into an int, without the many steps that older instructions need for
// it.
inline int floor_int(Real x) {
  const int truncated = static_cast<int>(x);
  return truncated - (x < static_cast<Real>(truncated));
}

class OccupancyGrid {
 public:
  static constexpr int kDefaultSide = 128;

  // `side`, the cells per axis of each cascade, is a multiple of 16 in [16, kMostSide].
  static constexpr int kMostSide = 512;
  explicit OccupancyGrid(int cascades = 1, int side = kDefaultSide);
  static uint64_t memory_bytes(int cascades, int side);

  int cascades() const { return cascades_; }
  int side() const { return side_; }
  // Bricks of 4^3 cells per axis: the occupancy of one is a 64-bit mask.
  int bricks() const { return side_ / 4; }
  int64_t cells() const { return int64_t{side_} * side_ * side_; }  // of one cascade
  Real cell_width(int cascade) const { return cell_widths_[static_cast<size_t>(cascade)]; }
  Real brick_width(int cascade) const { return 4 * cell_width(cascade); }

  // Finest cascade that holds p; cascades() where none does.
  int cascade_of(const Vec3& p) const {
    int c = 0;
    Real half = 1;
    // Lower borders belong to a cascade, upper ones do not: the same rule by which a cell holds
    // points.
    const auto holds = [&](Real v) { return v >= -half && v < half; };
    while (c < cascades_ && !(holds(p.x) && holds(p.y) && holds(p.z))) {
      half *= 2;
      ++c;
    }
    return c;
  }
  // Cell of p, which cascade c must hold. Cells are stored brick by brick.
  int64_t cell_of(const Vec3& p, int cascade) const {
    const Real scale = 1.0_r / cell_width(cascade), half = static_cast<Real>(side_ / 2);
    std::array<int, 3> at;
    for (size_t i = 0; i < 3; ++i)
      at[i] =
          std::clamp(floor_int(std::clamp(p[static_cast<int>(i)] * scale, -half, half)) + side_ / 2,
                     0, side_ - 1);
    return cell_at(at);
  }
  // Cell by its place along each axis, each in [0, side()).
  int64_t cell_at(const std::array<int, 3>& at) const {
    const int64_t n = bricks();
    const int64_t brick = ((at[2] >> 2) * n + (at[1] >> 2)) * n + (at[0] >> 2);
    return brick * 64 + ((at[2] & 3) * 16 + (at[1] & 3) * 4 + (at[0] & 3));
  }
  Vec3 cell_corner(int64_t cell, int cascade) const;  // its least corner

  // Training state. A cell that is off is never refreshed: no camera sees it.
  void switch_off(int cascade, int64_t cell) { opacity_[index(cascade, cell)] = kOff; }
  bool is_off(int cascade, int64_t cell) const { return opacity_[index(cascade, cell)] < 0; }
  Real opacity(int cascade, int64_t cell) const { return opacity_[index(cascade, cell)]; }

  // Takes in the opacity seen at one random point of a cell: a running mean over its points, so
  // that matter which fills little of a cell is not lost between two hits.
  void observe(int cascade, int64_t cell, Real seen) { observe(index(cascade, cell), seen); }
  // The same for a cell numbered among those of all cascades: cascade * cells() + cell.
  void observe(size_t cell_of_all, Real seen) {
    Real& a = opacity_[cell_of_all];
    if (a < 0 || !(seen >= 0)) return;
    a += kShare * (seen - a);
    if (most_.size() == 0) return;
    Real& most = most_[cell_of_all];
    most = std::max(seen, most * (most < kSolid ? kThinKept : kSolidKept));
  }
  // Of a scene that moves a cell is in use where any moment's points hold matter: beside the mean
  // over its points and moments the most of them is remembered, which fades slowly where it was
  // much.
  void remember_moments();
  // Asks for the memory that observe() will change.
  void prefetch_memory(size_t cell_of_all) const {
    __builtin_prefetch(opacity_.data() + cell_of_all, 1, 3);
  }

  // Rebuilds the quantised opacities and brick masks that rays are marched through: empty are cells
  // below min(threshold, mean opacity of those switched on), except the neighbours of solid ones.
  // The same bits with and without a pool.
  void rebuild(Real threshold, ThreadPool* pool = nullptr);

  // As of the last rebuild.
  uint64_t brick_mask(int cascade, int64_t brick) const {
    return masks_[static_cast<size_t>(cascade) * bricks_of_cascade() + static_cast<size_t>(brick)];
  }
  // How many bricks away, along the axis where it is farthest, the nearest brick is that holds
  // matter or that a finer cascade answers for: 0 is such a one itself, kMostClearance means at
  // least so many.
  static constexpr int kMostClearance = 8;
  int clearance(int cascade, int64_t brick) const {
    return clearance_[static_cast<size_t>(cascade) * bricks_of_cascade() +
                      static_cast<size_t>(brick)];
  }
  // Asks for the memory that brick_mask() and thickness() of a brick will read.
  void prefetch(int cascade, int64_t brick) const {
    const size_t b =
        static_cast<size_t>(cascade) * bricks_of_cascade() + static_cast<size_t>(brick);
    __builtin_prefetch(masks_.data() + b);
    __builtin_prefetch(levels_.data() + b * 64);
  }
  // Optical thickness of one cell width: > 0 for occupied cells, 0 for empty ones.
  Real thickness(int cascade, int64_t cell) const {
    return thickness_of_level_[levels_[index(cascade, cell)]];
  }
  // Whether the cell of p may hold matter, as of the last rebuild; false outside all cascades.
  bool occupied(const Vec3& p) const;
  double occupied_fraction() const { return occupied_fraction_; }
  // Around all occupied bricks; empty where there are none.
  const Box3& occupied_box() const { return occupied_box_; }

  // Everything that training needs to go on, and what rendering needs.
  std::span<Real> training_state() { return opacity_.span(); }
  std::span<const Real> training_state() const { return opacity_.span(); }
  std::span<Real> moments_state() { return most_.span(); }  // empty without remember_moments()
  std::span<const Real> moments_state() const { return most_.span(); }
  std::span<const uint8_t> levels() const { return levels_.span(); }
  void set_levels(std::span<const uint8_t> levels);
  // The same cells with other levels, without what only training needs.
  OccupancyGrid with_levels(std::span<const uint8_t> levels) const;
  // Frees what only training needs, at least 4 of about 5 bytes per cell.
  void forget_training();

 private:
  struct WithoutTraining {};
  OccupancyGrid(int cascades, int side, WithoutTraining);
  static constexpr Real kOff = -1;
  static constexpr Real kShare = 0.15_r;  // of a cell's memory that one point replaces
  static constexpr Real kSolid = 0.1_r;   // opacity from which a cell keeps its neighbours on
  // Of what remember_moments() asks for, by each point.
  static constexpr Real kSolidKept = 0.97_r, kThinKept = 0.8_r;
  static constexpr int kMostCascades = 16;
  size_t index(int cascade, int64_t cell) const {
    return static_cast<size_t>(cascade) * static_cast<size_t>(cells()) + static_cast<size_t>(cell);
  }
  size_t bricks_of_cascade() const { return static_cast<size_t>(cells() / 64); }
  bool brick_is_off(size_t brick) const;
  void keep_neighbours_of_solid(size_t brick);
  void measure_occupied();
  void measure_clearance(int cascade);

  int cascades_, side_;
  std::array<Real, kMostCascades> cell_widths_{};
  AlignedArray<Real> opacity_;
  AlignedArray<Real> most_;       // see remember_moments()
  AlignedArray<uint8_t> levels_;  // 0 = empty; else opacity = (level / 255)^2
  std::vector<uint64_t> masks_, solid_;
  std::vector<uint8_t> clearance_;  // of each brick
  std::array<Real, 256> thickness_of_level_;
  double occupied_fraction_ = 1;
  Box3 occupied_box_;
};

}  // namespace nerf
