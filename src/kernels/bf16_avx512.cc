// Packing, and products on vdpbf16ps (AVX512-BF16).
#if defined(__x86_64__)

#include <immintrin.h>

#include "kernels/bf16_product.h"

namespace nerf::internal {

namespace {

__m512i load(const uint16_t* p) { return _mm512_load_si512(p); }
void store(uint16_t* p, __m512i v) { _mm512_store_si512(p, v); }

// 32 bf16: those of `low` first.
__m512i rounded(__m512 low, __m512 high) { return (__m512i)_mm512_cvtne2ps_pbh(high, low); }

int64_t blocks(int64_t n, int64_t unit) { return (n + unit - 1) / unit; }

// What becomes of R x NV finished sums; `end` where no depth is left.
template <int R, int NV>
inline __attribute__((always_inline)) void finish(const Bf16Product& p, __m512 (&acc)[R][NV],
                                                  int64_t row, int64_t column, bool end) {
  const __m512 zero = _mm512_setzero_ps();
  const int64_t rows = p.rows - row;
  float* out = p.out + row * p.ld + column;
  const auto each = [&](auto&& value) __attribute__((always_inline)) {
    for (int r = 0; r < R; ++r) {
      if (r >= rows) return;
      for (int v = 0; v < NV; ++v) _mm512_store_ps(out + r * p.ld + 16 * v, value(r, v, acc[r][v]));
    }
  };
  if (p.epilogue == Bf16Epilogue::kAdd) {
    each([&](int r, int v, __m512 y) {
      return _mm512_add_ps(_mm512_load_ps(out + r * p.ld + 16 * v), y);
    });
    return;
  }
  if (!end) {
    each([](int, int, __m512 y) { return y; });
    return;
  }
  if (p.bias)
    for (int r = 0; r < R; ++r)
      for (int v = 0; v < NV; ++v)
        acc[r][v] = _mm512_add_ps(acc[r][v], _mm512_set1_ps(r < rows ? p.bias[row + r] : 0));
  if (p.epilogue == Bf16Epilogue::kRelu) {
    each([&](int, int, __m512 y) { return _mm512_max_ps(y, zero); });  // 0 of NaN
  } else if (p.epilogue == Bf16Epilogue::kMask) {
    const float* mask = p.mask + row * p.ld + column;
    each([&](int r, int v, __m512 y) {
      const __m512 m = _mm512_load_ps(mask + r * p.ld + 16 * v);
      return _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(m, zero, _CMP_GT_OQ), y);
    });
  } else {
    each([](int, int, __m512 y) { return y; });
  }
}

// R rows x NV blocks of columns. With kResume the sums begin with what stands in out. Every loop
// over the sums has constant bounds and no way past it, or the compiler keeps them in memory.
template <int R, int NV, bool kResume>
void block(const uint16_t* a, const Bf16Product& p, const uint16_t* b, int64_t first, int64_t last,
           int64_t row, int64_t column) {
  const int64_t b_stride = p.depth_blocks * kBf16Block;
  // What finish() reads and writes comes from further caches while the sums are made.
  for (int r = 0; r < R; ++r)
    for (int v = 0; v < NV; ++v) {
      const int64_t at = (row + r) * p.ld + column + 16 * v;
      _mm_prefetch(reinterpret_cast<const char*>(p.out + at), _MM_HINT_ET0);
      if (p.mask) _mm_prefetch(reinterpret_cast<const char*>(p.mask + at), _MM_HINT_T0);
    }
  __m512 acc[R][NV];
  if constexpr (kResume) {
    const int64_t rows = p.rows - row;
    const float* out = p.out + row * p.ld + column;
    for (int r = 0; r < R; ++r) {
      const float* from = out + (r < rows ? r : 0) * p.ld;  // rows beyond: any, not stored
      for (int v = 0; v < NV; ++v) acc[r][v] = _mm512_load_ps(from + 16 * v);
    }
  } else {
    for (int r = 0; r < R; ++r)
      for (int v = 0; v < NV; ++v) acc[r][v] = _mm512_setzero_ps();
  }
  for (int64_t k = first; k < last; ++k) {
    const uint16_t* ak = a + k * kBf16Block;
    const uint16_t* bk = b + k * kBf16Block;
    const int64_t left = p.depth_pairs - 16 * k, pairs = left < 16 ? left : 16;
    for (int64_t pair = 0; pair < pairs; ++pair) {
      __m512bh x[NV];
      for (int v = 0; v < NV; ++v) x[v] = (__m512bh)load(bk + v * b_stride + pair * 32);
      for (int r = 0; r < R; ++r) {
        int w;
        __builtin_memcpy(&w, ak + r * 32 + pair * 2, sizeof w);
        const __m512bh ws = (__m512bh)_mm512_set1_epi32(w);
        for (int v = 0; v < NV; ++v) acc[r][v] = _mm512_dpbf16_ps(acc[r][v], ws, x[v]);
      }
    }
  }
  finish<R, NV>(p, acc, row, column, last == p.depth_blocks);
}

template <int R, int NV>
void block(const uint16_t* a, const Bf16Product& p, const uint16_t* b, int64_t first, int64_t last,
           int64_t row, int64_t column) {
  if (first > 0 && p.epilogue != Bf16Epilogue::kAdd)
    block<R, NV, true>(a, p, b, first, last, row, column);
  else
    block<R, NV, false>(a, p, b, first, last, row, column);
}

template <int NV>
void strip(const Bf16Product& p, const uint16_t* b, int64_t first, int64_t last, int64_t column) {
  for (int64_t row = 0; row < p.rows;) {
    const uint16_t* a =
        p.a + row / kBf16Rows * p.depth_blocks * kBf16Block + row % kBf16Rows * kBf16Depth;
    if (p.rows - row > 4) {
      block<8, NV>(a, p, b, first, last, row, column);
      row += 8;
    } else {
      block<4, NV>(a, p, b, first, last, row, column);
      row += 4;
    }
  }
}

}  // namespace

void bf16_product_avx512(const Bf16Product& p) {
  // Of depth, so that a strip of three blocks of columns leaves room in a first-level cache of 32
  // KB.
  constexpr int64_t kMostBlocks = 8;
  for (int64_t c = 0; c < p.column_blocks;) {
    const int64_t vectors = p.column_blocks - c < 3 ? p.column_blocks - c : 3;
    const uint16_t* b = p.b + c * p.depth_blocks * kBf16Block;
    for (int64_t k = 0; k < p.depth_blocks; k += kMostBlocks) {
      const int64_t end = k + kMostBlocks < p.depth_blocks ? k + kMostBlocks : p.depth_blocks;
      if (vectors == 3)
        strip<3>(p, b, k, end, c * kBf16Columns);
      else if (vectors == 2)
        strip<2>(p, b, k, end, c * kBf16Columns);
      else
        strip<1>(p, b, k, end, c * kBf16Columns);
    }
    c += vectors;
  }
}

void bf16_pack_rows(int64_t rows, int64_t depth, const float* x, int64_t ld, uint16_t* out) {
  const int64_t depth_blocks = blocks(depth, kBf16Depth), row_blocks = blocks(rows, kBf16Rows);
  for (int64_t rb = 0; rb < row_blocks; ++rb)
    for (int64_t r = 0; r < kBf16Rows; ++r) {
      const int64_t row = rb * kBf16Rows + r;
      uint16_t* to = out + rb * depth_blocks * kBf16Block + r * kBf16Depth;
      for (int64_t k = 0; k < depth_blocks; ++k, to += kBf16Block) {
        const float* from = x + row * ld + k * kBf16Depth;
        const bool second = k * kBf16Depth + 16 < depth;
        if (row < rows)
          store(to, rounded(_mm512_load_ps(from),
                            second ? _mm512_load_ps(from + 16) : _mm512_setzero_ps()));
        else
          store(to, _mm512_setzero_si512());
      }
    }
}

void bf16_pack_pairs(int64_t depth, int64_t column_blocks, const float* x, int64_t ld,
                     uint16_t* out) {
  alignas(64) static const uint16_t kInterleave[32] = {0,  16, 1,  17, 2,  18, 3,  19, 4,  20, 5,
                                                       21, 6,  22, 7,  23, 8,  24, 9,  25, 10, 26,
                                                       11, 27, 12, 28, 13, 29, 14, 30, 15, 31};
  const __m512i interleave = load(kInterleave);
  const int64_t pairs = blocks(depth, kBf16Depth) * 16;
  for (int64_t c = 0; c < column_blocks; ++c)
    for (int64_t p = 0; p < pairs; ++p, out += 32) {
      const float* from = x + 2 * p * ld + c * kBf16Columns;
      const __m512 even = 2 * p < depth ? _mm512_load_ps(from) : _mm512_setzero_ps();
      const __m512 odd = 2 * p + 1 < depth ? _mm512_load_ps(from + ld) : _mm512_setzero_ps();
      store(out, _mm512_permutexvar_epi16(interleave, rounded(even, odd)));
    }
}

namespace {

// Transposes 16 x 16 words of 32 bits.
void transpose(__m512i (&v)[16]) {
  __m512i t[16];
  for (int i = 0; i < 8; ++i) {
    t[2 * i] = _mm512_unpacklo_epi32(v[2 * i], v[2 * i + 1]);
    t[2 * i + 1] = _mm512_unpackhi_epi32(v[2 * i], v[2 * i + 1]);
  }
  for (int i = 0; i < 4; ++i)
    for (int h = 0; h < 2; ++h) {
      v[4 * i + 2 * h] = _mm512_unpacklo_epi64(t[4 * i + h], t[4 * i + 2 + h]);
      v[4 * i + 2 * h + 1] = _mm512_unpackhi_epi64(t[4 * i + h], t[4 * i + 2 + h]);
    }
  // v[4 i + j]: in each 128 bits b, column 4 b + j of rows 4 i .. 4 i + 3.
  for (int j = 0; j < 4; ++j) {
    const __m512i low = _mm512_shuffle_i32x4(v[j], v[4 + j], 0x44);
    const __m512i high = _mm512_shuffle_i32x4(v[j], v[4 + j], 0xee);
    const __m512i low2 = _mm512_shuffle_i32x4(v[8 + j], v[12 + j], 0x44);
    const __m512i high2 = _mm512_shuffle_i32x4(v[8 + j], v[12 + j], 0xee);
    t[j] = _mm512_shuffle_i32x4(low, low2, 0x88);
    t[4 + j] = _mm512_shuffle_i32x4(low, low2, 0xdd);
    t[8 + j] = _mm512_shuffle_i32x4(high, high2, 0x88);
    t[12 + j] = _mm512_shuffle_i32x4(high, high2, 0xdd);
  }
  for (int i = 0; i < 16; ++i) v[i] = t[i];
}

}  // namespace

void bf16_pack_pairs_transposed(int64_t columns, int64_t depth, const float* x, int64_t ld,
                                uint16_t* out) {
  const int64_t depth_blocks = blocks(depth, kBf16Depth);
  for (int64_t c = 0; c < columns; c += kBf16Columns)
    for (int64_t k = 0; k < depth_blocks; ++k, out += kBf16Block) {
      const bool second = k * kBf16Depth + 16 < depth;
      __m512i v[16];
      for (int64_t i = 0; i < 16; ++i) {
        const float* from = x + (c + i) * ld + k * kBf16Depth;
        if (c + i < columns)
          v[i] = rounded(_mm512_load_ps(from),
                         second ? _mm512_load_ps(from + 16) : _mm512_setzero_ps());
        else
          v[i] = _mm512_setzero_si512();
      }
      transpose(v);
      for (int64_t i = 0; i < 16; ++i) store(out + i * 32, v[i]);
    }
}

int64_t bf16_loop_avx512(int64_t rounds, float* sink) {
  // Short enough for the compiler to unroll each loop, so that the sums stay in registers.
  constexpr int kRows = 3, kColumns = 8;
  __m512 sum[kRows][kColumns];
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kColumns; ++c) sum[r][c] = _mm512_set1_ps(static_cast<float>(c));
  const __m512bh x = (__m512bh)_mm512_set1_epi16(0x3f80), w = (__m512bh)_mm512_set1_epi16(0x3a00);
  for (int64_t i = 0; i < rounds; ++i)
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kColumns; ++c) sum[r][c] = _mm512_dpbf16_ps(sum[r][c], w, x);
  __m512 all = _mm512_setzero_ps();
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kColumns; ++c) all = _mm512_add_ps(all, sum[r][c]);
  *sink = _mm512_reduce_add_ps(all);
  return int64_t{2 * 32 * kRows * kColumns} * rounds;
}

}  // namespace nerf::internal

#endif  // x86-64
