// Dot products of descriptors on vpdpbusd (AVX512-VNNI): bytes without sign times bytes with one,
// four at a time. Rows are shifted by 128 into the range of the latter; what the shift takes from a
// product, 128 times the sum of the column, is in the panel.
#if defined(__x86_64__)

#include <immintrin.h>

#include "kernels/descriptor_tiles.h"

namespace nerf::internal {

namespace {

#define NERF_INLINE __attribute__((always_inline))
#include "kernels/unrolled.inc"

constexpr int kLanes = 16;
constexpr int kShift = 128;
constexpr int kSteps = kDescriptorBytes / 4;  // of depth, four at a time

// kRows x kColumns vectors of dot products stay in registers.
template <int kRows, int kColumns>
inline NERF_INLINE void block(const int8_t* a, const uint8_t* b, const int32_t* offsets,
                              int32_t* out) {
  constexpr int kStride = kSteps * 4 * kLanes;
  __m512i sum[kRows][kColumns];
  unrolled<kRows>([&](auto r) NERF_INLINE {
    unrolled<kColumns>([&](auto v)
                           NERF_INLINE { sum[r][v] = _mm512_load_si512(offsets + v * kLanes); });
  });
  for (int k = 0; k < kSteps; ++k) {
    __m512i x[kColumns];
    unrolled<kColumns>(
        [&](auto v) NERF_INLINE { x[v] = _mm512_load_si512(b + v * kStride + k * 4 * kLanes); });
    unrolled<kRows>([&](auto r) NERF_INLINE {
      int four;
      __builtin_memcpy(&four, a + r * kDescriptorBytes + 4 * k, sizeof four);
      const __m512i y = _mm512_set1_epi32(four);
      unrolled<kColumns>([&](auto v)
                             NERF_INLINE { sum[r][v] = _mm512_dpbusd_epi32(sum[r][v], x[v], y); });
    });
  }
  unrolled<kRows>([&](auto r) NERF_INLINE {
    unrolled<kColumns>([&](auto v) NERF_INLINE {
      _mm512_store_si512(out + r * kTileColumns + v * kLanes, sum[r][v]);
    });
  });
}

void pack_rows(int64_t rows, const uint8_t* a, DescriptorRows& out) {
  int8_t* shifted = reinterpret_cast<int8_t*>(out.values);
  const int64_t given = rows * kDescriptorBytes;
  const __m512i shift = _mm512_set1_epi8(-kShift);
  for (int64_t i = 0; i < kTileRows * kDescriptorBytes; i += 64) {
    const __m512i bytes = i < given ? _mm512_loadu_si512(a + i) : _mm512_setzero_si512();
    _mm512_store_si512(shifted + i, _mm512_xor_si512(bytes, shift));
  }
}

void pack_columns(int64_t columns, const uint8_t* b, DescriptorPanel& out) {
  pack_descriptor_bytes(columns, b, kLanes, kShift, out);
}

void multiply(const DescriptorRows& rows, const DescriptorPanel& panel, DescriptorTile& tile) {
  constexpr int kRows = 4, kColumns = 4;
  const int8_t* shifted = reinterpret_cast<const int8_t*>(rows.values);
  const uint8_t* values = reinterpret_cast<const uint8_t*>(panel.values);
  for (int v = 0; v < kTileColumns / kLanes; v += kColumns)
    for (int r = 0; r < kTileRows; r += kRows)
      block<kRows, kColumns>(shifted + r * kDescriptorBytes, values + v * kSteps * 4 * kLanes,
                             panel.offsets + v * kLanes, &tile.dots[r][v * kLanes]);
}

}  // namespace

const DescriptorProducts& byte_products() {
  static constexpr DescriptorProducts kProducts{pack_rows, pack_columns, multiply};
  return kProducts;
}

}  // namespace nerf::internal

#endif  // x86-64
