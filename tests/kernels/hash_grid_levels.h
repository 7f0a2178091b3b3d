// What the tests of the hash grid's kernels share: levels, positions and their rounding.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/kernels/hash_grid.h"
#include "nerf/math/random.h"
#include "nerf/math/reference/hash_grid.h"

namespace nerf {

inline reference::GridLevel reference_level(const HashGridLevel& l) {
  return {l.scale, l.resolution, l.entries, l.dense, static_cast<size_t>(l.features)};
}

// Dense and hashed levels, coarse to so fine that float places have few digits left in a cell, and
// one so large that its rows are fetched ahead, with entries of either size.
inline std::vector<HashGridLevel> levels() {
  std::vector<HashGridLevel> out;
  for (int features : {4, 2})
    for (const HashGridShape& shape :
         {hash_grid_shape(4, 12, 4, 100, features), hash_grid_shape(3, 8, 16, 5000, features),
          hash_grid_shape(1, 17, 400, 400, features)})
      out.insert(out.end(), shape.levels.begin(), shape.levels.end());
  return out;
}

inline size_t size_of(const HashGridLevel& level) {
  return size_t{level.entries} * static_cast<size_t>(level.features);
}

struct Positions {
  Positions(int64_t n, Random& random) : p(3, n, random, -0.05, 1.05) {
    for (int i = 0; i < 3 && n > 2; ++i) {
      p.at(i, 0) = 0;
      p.at(i, 1) = 1;
      p.at(i, 2) = 0.5_r;
    }
  }
  const Real* row(int i) const { return p.data.data() + i * p.ld; }
  std::array<double, 3> at(int64_t s) const { return {p.at(0, s), p.at(1, s), p.at(2, s)}; }
  Matrix p;
};

// A place x scale + 1/2 is rounded once; distances to both vertices once more at most. An error of
// place moves the weights along one axis by as much, up on one side and down on the other, so the
// sum over corners of all weights' errors is at most twice the sum over axes of this.
inline double place_error(const HashGridLevel& level) {
  return 3 * (kRoundoff * (level.scale + 1.5) + kRoundoff);
}

}  // namespace nerf
