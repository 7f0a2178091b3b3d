#include "nerf/kernels/peak.h"

#include <cstddef>

namespace nerf {

int64_t fma_loop(int64_t rounds, Real* sink) {
  constexpr int kChains = 16;
  // Every chain runs towards 1, so that no value leaves the normal numbers.
  Real chain[kChains], sum = 0;
  for (int c = 0; c < kChains; ++c) chain[c] = static_cast<Real>(c);
  for (int64_t r = 0; r < rounds; ++r)
    for (Real& c : chain) c = c * 0.75_r + 0.25_r;
  for (const Real c : chain) sum += c;
  *sink = sum;
  return 2 * kChains * rounds;
}

Real read_loop(int64_t n, const Real* x) {
  constexpr int kSums = 16;
  Real sums[kSums] = {}, all = 0;
  for (int64_t i = 0; i < n; i += kSums)
    for (int k = 0; k < kSums; ++k) sums[k] += x[i + k];
  for (const Real sum : sums) all += sum;
  return all;
}

Real random_row_loop(int64_t rows, const Real* table, int64_t reads, uint32_t salt) {
  const uint32_t mask = static_cast<uint32_t>(rows - 1);
  Real sums[4] = {};
  for (int64_t i = 0; i < reads; ++i) {
    uint32_t h = (salt + static_cast<uint32_t>(i)) * 2654435761u;
    h = (h ^ h >> 15) * 805459861u;
    h = (h ^ h >> 13) & mask;
    for (size_t k = 0; k < 4; ++k) sums[k] += table[size_t{h} * 4 + k];
  }
  return sums[0] + sums[1] + sums[2] + sums[3];
}

}  // namespace nerf
