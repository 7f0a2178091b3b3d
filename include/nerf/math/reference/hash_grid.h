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

// Along one axis: p in a cell, clamped to [0, 1]. The grid stands half a cell off: p is sampled at
// p * scale + 1/2.
template <class T>
struct GridPlace {
  GridPlace(double scale, T p) {
    const double inside = static_cast<double>(real_part(p));
    moves = inside > 0 && inside < 1;
    const T at = (inside <= 0 ? T(0) : inside >= 1 ? T(1) : p) * T(scale) + T(0.5);
    cell = static_cast<uint32_t>(std::floor(real_part(at)));
    far = at - T(cell);
  }
  T weight(uint32_t bit) const { return bit ? far : T(1) - far; }

  uint32_t cell;  // its lower vertex
  T far;          // share of the upper one
  bool moves;     // with p: it is not clamped
};

// The eight vertices around p (clamped to [0, 1]^3) and their trilinear weights, which add up to 1.
template <class T>
std::array<GridCorner<T>, 8> grid_corners(const GridLevel& level, const std::array<T, 3>& p) {
  const GridPlace<T> at[3] = {{level.scale, p[0]}, {level.scale, p[1]}, {level.scale, p[2]}};
  std::array<GridCorner<T>, 8> out;
  for (uint32_t c = 0; c < 8; ++c) {
    const uint32_t bit[3] = {c & 1, c >> 1 & 1, c >> 2};
    T weight = T(1);
    for (size_t i = 0; i < 3; ++i) weight *= at[i].weight(bit[i]);
    out[c] = {grid_row(level, at[0].cell + bit[0], at[1].cell + bit[1], at[2].cell + bit[2]),
              weight};
  }
  return out;
}

// The same vertices and the derivatives of their weights by p: of the cell that p is in, which
// contains its lower faces, and 0 along an axis where p is clamped or at the border.
template <class T>
std::array<GridCorner<std::array<T, 3>>, 8> grid_corner_slopes(const GridLevel& level,
                                                               const std::array<T, 3>& p) {
  const GridPlace<T> at[3] = {{level.scale, p[0]}, {level.scale, p[1]}, {level.scale, p[2]}};
  std::array<GridCorner<std::array<T, 3>>, 8> out;
  for (uint32_t c = 0; c < 8; ++c) {
    const uint32_t bit[3] = {c & 1, c >> 1 & 1, c >> 2};
    out[c].row = grid_row(level, at[0].cell + bit[0], at[1].cell + bit[1], at[2].cell + bit[2]);
    for (size_t i = 0; i < 3; ++i) {
      const size_t j = (i + 1) % 3, k = (i + 2) % 3;
      const T slope = at[i].moves ? T(bit[i] ? level.scale : -level.scale) : T(0);
      out[c].weight[i] = slope * at[j].weight(bit[j]) * at[k].weight(bit[k]);
    }
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

// Gradient with respect to p, given that of the features at p.
template <class T>
std::array<T, 3> grid_position_backward(const GridLevel& level, const std::vector<T>& table,
                                        const std::array<T, 3>& p,
                                        const std::vector<T>& d_features) {
  std::array<T, 3> d_p{};
  for (const auto& c : grid_corner_slopes(level, p))
    for (size_t f = 0; f < level.features; ++f)
      for (size_t i = 0; i < 3; ++i)
        if (c.weight[i] != T(0))  // else nothing, even of infinity
          d_p[i] += c.weight[i] * table[c.row * level.features + f] * d_features[f];
  return d_p;
}

}  // namespace nerf::reference
