// Packing, and products on vdpbf16ps (AVX512-BF16).
#if defined(__x86_64__)

#include "kernels/bf16_pairs-inl.h"
#include "kernels/bf16_product.h"

namespace nerf::internal {

namespace {

int64_t blocks(int64_t n, int64_t unit) { return (n + unit - 1) / unit; }

#define NERF_INLINE __attribute__((always_inline))
#include "kernels/unrolled.inc"

// R rows x NV blocks of columns of sums.
template <int R, int NV>
struct Sums {
  __m512 of[R][NV];
};

// What becomes of finished sums; `end` where no depth is left.
template <int R, int NV>
inline NERF_INLINE void finish(const Bf16Product& p, Sums<R, NV>& sums, int64_t row, int64_t column,
                               bool end) {
  const __m512 zero = _mm512_setzero_ps();
  const int64_t rows = p.rows - row;
  const auto store_rows = [&](const auto& value) NERF_INLINE {
    float* out = p.out + row * p.ld + column;
    unrolled<R>([&](auto r) NERF_INLINE {
      if (r < rows)
        unrolled<NV>([&](auto v) NERF_INLINE {
          _mm512_store_ps(out + r * p.ld + 16 * v, value(r, v, sums.of[r][v]));
        });
    });
  };
  if (p.epilogue == Bf16Epilogue::kAdd)
    return store_rows([&](auto r, auto v, __m512 y) NERF_INLINE {
      return _mm512_add_ps(_mm512_load_ps(p.out + (row + r) * p.ld + column + 16 * v), y);
    });
  const auto same = [](auto, auto, __m512 y) NERF_INLINE { return y; };
  if (!end) return store_rows(same);

  if (p.bias)
    unrolled<R>([&](auto r) NERF_INLINE {
      const __m512 bias = _mm512_set1_ps(p.bias[row + (r < rows ? r : 0)]);
      unrolled<NV>([&](auto v) NERF_INLINE { sums.of[r][v] = _mm512_add_ps(sums.of[r][v], bias); });
    });
  const int64_t pairs_at = column / 16 * p.pairs_stride + row * 16;
  const auto store = [&](const auto& value) NERF_INLINE {
    if (!p.out_pairs) return store_rows(value);
    uint16_t* out = p.out_pairs + pairs_at;
    unrolled<R / 2>([&](auto pair) NERF_INLINE {
      constexpr Index<2 * decltype(pair)()> even;
      constexpr Index<2 * decltype(pair)() + 1> odd;
      if (even < rows)
        unrolled<NV>([&](auto v) NERF_INLINE {
          const __m512 low = value(even, v, sums.of[even][v]);
          const __m512 high = value(odd, v, sums.of[odd][v]);
          internal::store(out + v * p.pairs_stride + pair * 32,
                          pairs_of(low, odd < rows ? high : zero));
        });
    });
  };
  if (p.epilogue == Bf16Epilogue::kRelu) {
    store([&](auto, auto, __m512 y) NERF_INLINE { return _mm512_max_ps(y, zero); });  // 0 of NaN
  } else if (p.epilogue == Bf16Epilogue::kMask && p.mask_pairs) {
    const uint16_t* mask = p.mask_pairs + pairs_at;
    store_rows([&](auto r, auto v, __m512 y) NERF_INLINE {
      const __m512i m = load(mask + v * p.pairs_stride + r / 2 * 32);
      return _mm512_maskz_mov_ps(not_zero(m, r % 2 == 1), y);
    });
  } else if (p.epilogue == Bf16Epilogue::kMask) {
    const float* mask = p.mask + row * p.ld + column;
    store_rows([&](auto r, auto v, __m512 y) NERF_INLINE {
      const __m512 m = _mm512_load_ps(mask + r * p.ld + 16 * v);
      return _mm512_maskz_mov_ps(_mm512_cmp_ps_mask(m, zero, _CMP_GT_OQ), y);
    });
  } else {
    store(same);
  }
}

// What finish() reads and writes comes from further caches while the sums are made.
template <int R, int NV>
inline NERF_INLINE void prefetch(const Bf16Product& p, int64_t row, int64_t column) {
  for (int v = 0; v < NV; ++v) {
    const int64_t pairs_at = (column / 16 + v) * p.pairs_stride + row * 16;
    const int64_t at = row * p.ld + column + 16 * v;
    for (int r = 0; r < R; ++r) {
      if (!p.out_pairs)
        _mm_prefetch(reinterpret_cast<const char*>(p.out + at + r * p.ld), _MM_HINT_ET0);
      else if (r % 2 == 0)
        _mm_prefetch(reinterpret_cast<const char*>(p.out_pairs + pairs_at + r * 16), _MM_HINT_ET0);
      if (p.mask)
        _mm_prefetch(reinterpret_cast<const char*>(p.mask + at + r * p.ld), _MM_HINT_T0);
      else if (p.mask_pairs && r % 2 == 0)
        _mm_prefetch(reinterpret_cast<const char*>(p.mask_pairs + pairs_at + r * 16), _MM_HINT_T0);
    }
  }
}

// R rows x NV blocks of columns. With kResume the sums begin with what stands in out.
template <int R, int NV, bool kResume>
void block(const uint16_t* a, const Bf16Product& p, const uint16_t* b, int64_t first, int64_t last,
           int64_t row, int64_t column) {
  const int64_t b_stride = p.depth_blocks * kBf16Block;
  prefetch<R, NV>(p, row, column);
  Sums<R, NV> sums;
  unrolled<R>([&](auto r) NERF_INLINE {
    unrolled<NV>([&](auto v) NERF_INLINE {
      if constexpr (kResume) {  // rows beyond: any, not stored
        const int64_t from = row + (r < p.rows - row ? r : 0);
        sums.of[r][v] = _mm512_load_ps(p.out + from * p.ld + column + 16 * v);
      } else {
        sums.of[r][v] = _mm512_setzero_ps();
      }
    });
  });
  for (int64_t k = first; k < last; ++k) {
    const uint16_t* ak = a + k * kBf16Block;
    const uint16_t* bk = b + k * kBf16Block;
    const int64_t left = p.depth_pairs - 16 * k, pairs = left < 16 ? left : 16;
    for (int64_t pair = 0; pair < pairs; ++pair) {
      Sums<1, NV> x;
      unrolled<NV>([&](auto v)
                       NERF_INLINE { x.of[0][v] = (__m512)load(bk + v * b_stride + pair * 32); });
      unrolled<R>([&](auto r) NERF_INLINE {
        int w;
        __builtin_memcpy(&w, ak + r * 32 + pair * 2, sizeof w);
        const __m512bh ws = (__m512bh)_mm512_set1_epi32(w);
        unrolled<NV>([&](auto v) NERF_INLINE {
          sums.of[r][v] = _mm512_dpbf16_ps(sums.of[r][v], ws, (__m512bh)x.of[0][v]);
        });
      });
    }
  }
  finish(p, sums, row, column, last == p.depth_blocks);
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
  for (int64_t c = 0; c < p.column_blocks;) {
    const int64_t vectors = p.column_blocks - c < 3 ? p.column_blocks - c : 3;
    const uint16_t* b = p.b + c * p.depth_blocks * kBf16Block;
    for (int64_t k = 0; k < p.depth_blocks; k += kBf16MostBlocks) {
      const int64_t end =
          k + kBf16MostBlocks < p.depth_blocks ? k + kBf16MostBlocks : p.depth_blocks;
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
  const int64_t pairs = blocks(depth, kBf16Depth) * 16;
  // The next strip is asked for: rows are too far apart for the processor to see what comes.
  const auto row = [&](int64_t k, const float* from) {
    if (k >= depth) return _mm512_setzero_ps();
    _mm_prefetch(reinterpret_cast<const char*>(from + column_blocks * kBf16Columns), _MM_HINT_T0);
    return _mm512_load_ps(from);
  };
  for (int64_t c = 0; c < column_blocks; ++c)
    for (int64_t p = 0; p < pairs; ++p, out += 32) {
      const float* from = x + 2 * p * ld + c * kBf16Columns;
      store(out, pairs_of(row(2 * p, from), row(2 * p + 1, from + ld)));
    }
}

namespace {

// Transposes 16 x 16 words of 32 bits.
inline NERF_INLINE void transpose(__m512i (&v)[16]) {
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

void bf16_transpose_pairs(int64_t rows, int64_t columns, const uint16_t* pairs, int64_t stride,
                          uint16_t* out) {
  alignas(64) static const uint16_t kEven[32] = {0,  2,  4,  6,  8,  10, 12, 14, 16, 18, 20,
                                                 22, 24, 26, 28, 30, 32, 34, 36, 38, 40, 42,
                                                 44, 46, 48, 50, 52, 54, 56, 58, 60, 62};
  const __m512i even = load(kEven), odd = _mm512_or_si512(even, _mm512_set1_epi16(1));
  for (int64_t r = 0; r < rows; r += 16)
    for (int64_t c = 0; c < columns; c += 32, out += kBf16Block) {
      const uint16_t* from = pairs + c / 16 * stride + r * 16;
      const bool second = c + 16 < columns;
      __m512i v[16];
      for (int64_t i = 0; i < 16; i += 2) {
        if (r + i < rows) {
          const __m512i low = load(from + i * 16);
          const __m512i high = second ? load(from + stride + i * 16) : _mm512_setzero_si512();
          v[i] = _mm512_permutex2var_epi16(low, even, high);
          v[i + 1] = _mm512_permutex2var_epi16(low, odd, high);
        } else {
          v[i] = v[i + 1] = _mm512_setzero_si512();
        }
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
