// Pairs (nerf/kernels/linear_bf16.h) in registers. For the sources that see bf16 instructions, each
// of which has these functions to itself (kernels/bf16_product.h).
#pragma once

#include <immintrin.h>

#include <cstdint>

namespace nerf::internal {
namespace {

inline __m512i load(const uint16_t* p) { return _mm512_load_si512(p); }
inline void store(uint16_t* p, __m512i v) { _mm512_store_si512(p, v); }

// 32 bf16: those of `low` first.
inline __m512i rounded(__m512 low, __m512 high) { return (__m512i)_mm512_cvtne2ps_pbh(high, low); }

// 16 columns of two rows.
inline __m512i pairs_of(__m512 even, __m512 odd) {
  alignas(64) static const uint16_t kInterleave[32] = {0,  16, 1,  17, 2,  18, 3,  19, 4,  20, 5,
                                                       21, 6,  22, 7,  23, 8,  24, 9,  25, 10, 26,
                                                       11, 27, 12, 28, 13, 29, 14, 30, 15, 31};
  return _mm512_permutexvar_epi16(load(kInterleave), rounded(even, odd));
}

// Where one row of pairs is not 0, which in a ReLU's output is above it.
inline __mmask16 not_zero(__m512i pairs, bool odd) {
  return _mm512_test_epi32_mask(pairs, _mm512_set1_epi32(odd ? -0x10000 : 0xffff));
}

}  // namespace
}  // namespace nerf::internal
