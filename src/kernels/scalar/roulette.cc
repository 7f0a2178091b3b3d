#include "nerf/kernels/roulette.h"

#include <cmath>

#include "nerf/kernels/linear_bf16.h"

namespace nerf {

void column_norms(int rows, int64_t n, const Real* x, int64_t ld, Real* norms) {
  for (int64_t i = 0; i < n; ++i) {
    Real sum = 0;
    for (int k = 0; k < rows; ++k) sum += std::fabs(x[k * ld + i]);
    norms[i] = sum;
  }
}

void keep_columns(int rows, const int32_t* kept, int64_t count, Real* x, int64_t ld) {
  for (int k = 0; k < rows; ++k)
    for (int64_t j = 0; j < count; ++j) x[k * ld + j] = x[k * ld + kept[j]];
}

void keep_pairs(int rows, const int32_t* kept, int64_t count, uint16_t* pairs) {
  for (int k = 0; k < rows; ++k)
    for (int64_t j = 0; j < count; ++j)
      pairs[pair_index(rows, k, j)] = pairs[pair_index(rows, k, kept[j])];
}

}  // namespace nerf
