// Multiresolution hash grid (Mueller et al. 2022, section 3; level scale and stagger as in
// tiny-cuda-nn's grid.h): trilinear interpolation of feature rows at L resolutions.
//
// Level l has cells of width 1 / scale(l), scale(l) = base * growth^l - 1, and is sampled at
// x * scale + 0.5. A level whose resolution^3 vertices fit into the table is indexed densely,
// a finer one by the hash x ^ y * 2654435761 ^ z * 805459861 modulo the table size (a power of
// two).
#pragma once

#include <cstdint>
#include <vector>

#include "nerf/base/real.h"
#include "nerf/kernels/adam.h"

namespace nerf {

struct HashGridLevel {
  float scale = 0;          // cells per unit; in every build the same, as a table is made for it
  uint32_t resolution = 0;  // vertices per axis
  uint32_t entries = 0;     // rows of this level's table
  uint64_t offset = 0;      // first row of this level in the whole table
  int features = 4;         // of an entry, 2 or 4
  bool dense = false;

  // This level's first float in the whole table, which holds the rows of all levels.
  uint64_t begin() const { return offset * static_cast<uint64_t>(features); }
};

struct HashGridShape {
  std::vector<HashGridLevel> levels;
  uint64_t rows = 0;  // of all levels

  int features_per_entry() const { return levels.empty() ? 0 : levels.front().features; }
  int features() const { return static_cast<int>(levels.size()) * features_per_entry(); }
  uint64_t size() const { return rows * static_cast<uint64_t>(features_per_entry()); }  // floats
};

// Resolutions that grow geometrically from base to finest (cells across the unit cube), each with a
// table of at most 2^log2_entries rows of 2 or 4 features. levels >= 1.
HashGridShape hash_grid_shape(int levels, int log2_entries, int base_resolution,
                              double finest_resolution, int features_per_entry = 4);

// features[f][s] for the features of one level. x, y, z: n positions in [0, 1] (clamped);
// table: the level's rows, aligned to one row; ld: floats from one feature to the next. n is
// rounded up to kLane (linear.h).
void hash_grid_forward(const HashGridLevel& level, const Real* table, const Real* x, const Real* y,
                       const Real* z, int64_t n, Real* features, int64_t ld);
// The same for a table of half floats (IEEE 754, 16 bits), aligned to one row.
void hash_grid_forward(const HashGridLevel& level, const uint16_t* table, const Real* x,
                       const Real* y, const Real* z, int64_t n, Real* features, int64_t ld);

// Adds the features' gradient to that of the level's rows ([entries][features], aligned to 64
// bytes) and sets the marks (a byte for each row, adam.h) of those that it adds to. Samples whose
// gradient is exactly 0 are skipped. One caller at a time per level; sums are in the order of the
// samples.
void hash_grid_backward(const HashGridLevel& level, const Real* x, const Real* y, const Real* z,
                        int64_t n, const Real* d_features, int64_t ld, Real* gradient,
                        uint8_t* marks);

// Adds the gradient by position to dx, dy and dz (n each), given that of the level's features: d_x
// = sum over f of d_features[f] times the derivative of feature f along x. Derivatives are those of
// the cell that hash_grid_forward() interpolates in, and 0 along an axis where the position is not
// in (0, 1), since it is clamped there. With the gradient of a density by the features as
// d_features, the sum over levels is the gradient of the density. table, n, ld: as of
// hash_grid_forward().
void hash_grid_position_backward(const HashGridLevel& level, const Real* table, const Real* x,
                                 const Real* y, const Real* z, int64_t n, const Real* d_features,
                                 int64_t ld, Real* dx, Real* dy, Real* dz);
void hash_grid_position_backward(const HashGridLevel& level, const uint16_t* table, const Real* x,
                                 const Real* y, const Real* z, int64_t n, const Real* d_features,
                                 int64_t ld, Real* dx, Real* dy, Real* dz);

}  // namespace nerf
