// Occupancy with a memory of density: cascades of 128^3 cells, each remembering how opaque it is.
//
// Cascade c covers [-2^c, 2^c]^3 in engine coordinates with cells 2^c / 64 wide; a point belongs to
// the finest cascade that holds it. A cell's opacity is the mean of 1 - exp(-density * width) at
// random points in it: the share of light that one cell width of its matter stops. Cells whose
// opacity stays under a threshold are empty and skipped; the others give rays a coarse distribution
// of where matter is without asking the network.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/math/vec.h"

namespace nerf {

class OccupancyGrid {
 public:
  static constexpr int kSide = 128;          // cells per axis
  static constexpr int kBricks = kSide / 4;  // bricks of 4^3 cells per axis: one 64-bit mask
  static constexpr int64_t kCells = int64_t{kSide} * kSide * kSide;

  explicit OccupancyGrid(int cascades = 1);

  int cascades() const { return cascades_; }
  static float cell_width(int cascade) { return static_cast<float>(1 << cascade) / (kSide / 2); }

  // Finest cascade that holds p; cascades() where none does.
  int cascade_of(const Vec3& p) const;
  // Cell of p, which cascade c must hold. Cells are stored brick by brick.
  static int64_t cell_of(const Vec3& p, int cascade);
  static Vec3 cell_corner(int64_t cell, int cascade);  // its least corner

  // Training state. A cell that is off is never refreshed: no camera sees it.
  void switch_off(int cascade, int64_t cell) { opacity_[index(cascade, cell)] = -1.0f; }
  bool is_off(int cascade, int64_t cell) const { return opacity_[index(cascade, cell)] < 0; }
  float opacity(int cascade, int64_t cell) const { return opacity_[index(cascade, cell)]; }

  // Takes in the opacity seen at one random point of a cell: quickly upwards, slowly downwards, so
  // that matter which fills little of a cell is not lost between two hits.
  void observe(int cascade, int64_t cell, float seen);

  // Rebuilds the quantised opacities and brick masks that rays are marched through: empty are cells
  // below min(threshold, mean opacity of those switched on), except the neighbours of solid ones.
  void rebuild(float threshold);

  // As of the last rebuild.
  uint64_t brick_mask(int cascade, int64_t brick) const {
    return masks_[static_cast<size_t>(cascade * kBricks * kBricks * kBricks + brick)];
  }
  // Optical thickness of one cell width, > 0 for occupied cells.
  float thickness(int cascade, int64_t cell) const {
    return thickness_of_level_[levels_[index(cascade, cell)]];
  }
  double occupied_fraction() const { return occupied_fraction_; }
  // Around all occupied bricks; empty where there are none.
  const Box3& occupied_box() const { return occupied_box_; }

  // Everything that training needs to go on, and what rendering needs.
  std::span<float> training_state() { return opacity_.span(); }
  std::span<const float> training_state() const { return opacity_.span(); }
  std::span<const uint8_t> levels() const { return levels_.span(); }
  void set_levels(std::span<const uint8_t> levels);

 private:
  static size_t index(int cascade, int64_t cell) {
    return static_cast<size_t>(cascade) * static_cast<size_t>(kCells) + static_cast<size_t>(cell);
  }
  void keep_neighbours_of_solid();
  void build_masks();

  int cascades_;
  AlignedArray<float> opacity_;
  AlignedArray<uint8_t> levels_;  // 0 = empty; else opacity = (level / 255)^2
  std::vector<uint64_t> masks_;
  std::array<float, 256> thickness_of_level_;
  double occupied_fraction_ = 1;
  Box3 occupied_box_;
};

}  // namespace nerf
