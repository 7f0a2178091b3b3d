// Specification of one level of the multiresolution hash grid (kernels/hash_grid.h).
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

struct GridLevel {
  double scale = 1;      // cells per unit
  uint32_t side = 2;     // vertices per axis of a dense level
  uint32_t entries = 8;  // rows; a power of two where the level is hashed
  bool dense = true;
  size_t features = 4;  // of an entry
};

// Row of the vertex (x, y, z), by place or by hash; all arithmetic modulo 2^32.
inline uint32_t grid_row(const GridLevel& level, uint32_t x, uint32_t y, uint32_t z) {
  if (level.dense) return x + level.side * (y + level.side * z);
  return (x ^ (y * 2654435761u) ^ (z * 805459861u)) % level.entries;
}

template <class T>
struct GridCorner {
  uint32_t row;
  T weight;
};

// The eight vertices around p (clamped to [0, 1]^3) and their trilinear weights, which add up to 1.
// The grid stands half a cell off: p is sampled at p * scale + 1/2.
template <class T>
std::array<GridCorner<T>, 8> grid_corners(const GridLevel& level, const std::array<T, 3>& p) {
  uint32_t cell[3];
  T far[3];
  for (size_t i = 0; i < 3; ++i) {
    const double inside = static_cast<double>(real_part(p[i]));
    const T at = (inside <= 0 ? T(0) : inside >= 1 ? T(1) : p[i]) * T(level.scale) + T(0.5);
    cell[i] = static_cast<uint32_t>(std::floor(real_part(at)));
    far[i] = at - T(cell[i]);
  }
  std::array<GridCorner<T>, 8> out;
  for (uint32_t c = 0; c < 8; ++c) {
    const uint32_t bit[3] = {c & 1, c >> 1 & 1, c >> 2};
    T weight = T(1);
    for (size_t i = 0; i < 3; ++i) weight *= bit[i] ? far[i] : T(1) - far[i];
    out[c] = {grid_row(level, cell[0] + bit[0], cell[1] + bit[1], cell[2] + bit[2]), weight};
  }
  return out;
}

// Features at p. table: [entries x features].
template <class T>
std::vector<T> grid_interpolate(const GridLevel& level, const std::vector<T>& table,
                                const std::array<T, 3>& p) {
  const size_t features = level.features;
  std::vector<T> out(features);
  for (const GridCorner<T>& c : grid_corners(level, p))
    for (size_t f = 0; f < features; ++f) out[f] += c.weight * table[c.row * features + f];
  return out;
}

// Adds the gradient with respect to the table, given that of the features at p.
template <class T>
void grid_interpolate_backward(const GridLevel& level, const std::array<T, 3>& p,
                               const std::vector<T>& d_features, std::vector<T>& d_table) {
  const size_t features = level.features;
  for (const GridCorner<T>& c : grid_corners(level, p))
    for (size_t f = 0; f < features; ++f) d_table[c.row * features + f] += c.weight * d_features[f];
}

}  // namespace nerf::reference
