// Dot products of descriptors on vpmaddubsw (AVX2): bytes without sign times bytes with one, whose
// neighbouring products are added to 16 bits. Rows are shifted by kShift into the range of the
// latter; what the shift takes from a product, kShift times the sum of the column, is in the panel.
//
// Two such sums, the products of four bytes, are added before they are widened. They fit where
// |a| |b| < 2^15 for the lengths of the four (Cauchy and Schwarz). `largest` is the square of the
// greatest length among the rows or the columns of a tile. SIFT's descriptors stay below it, with
// hardly an exception; other tiles are multiplied as 16-bit words.
#if defined(__x86_64__)

#include <immintrin.h>

#include <algorithm>
#include <limits>

#include "kernels/descriptor_tiles.h"

namespace nerf::internal {

namespace {

#define NERF_INLINE __attribute__((always_inline))
#include "kernels/unrolled.inc"

constexpr int kLanes = 8;
constexpr int kSteps = kDescriptorBytes / 4;  // of depth, four at a time
constexpr int kShift = 48;                    // with it the lengths of SIFT's rows are least

inline NERF_INLINE __m256i load(const void* from) {
  return _mm256_load_si256(static_cast<const __m256i*>(from));
}

// Keeps a value in a register, which g++ 12 otherwise reads again and copies.
inline NERF_INLINE void keep(__m256i& x) { asm("" : "+x"(x)); }

// The same four bytes of a row for all columns.
inline NERF_INLINE __m256i four_bytes(const void* from) {
  int four;
  __builtin_memcpy(&four, from, sizeof four);
  return _mm256_set1_epi32(four);
}

// The sum of products of two times four bytes; rows `y` are shifted.
struct Bytes {
  static constexpr bool kShifted = true;
  static NERF_INLINE __m256i add(__m256i sum, __m256i x0, __m256i y0, __m256i x1, __m256i y1) {
    const __m256i fours =
        _mm256_add_epi16(_mm256_maddubs_epi16(x0, y0), _mm256_maddubs_epi16(x1, y1));
    const __m256i t = _mm256_madd_epi16(fours, _mm256_set1_epi16(1));
    // In place: of a sum that is added by an intrinsic g++ 12 keeps copies, and spills.
    asm("vpaddd %1, %0, %0" : "+x"(sum) : "x"(t));
    return sum;
  }
};

// The same for bytes of any size; rows are shifted back.
struct Words {
  static constexpr bool kShifted = false;
  static NERF_INLINE __m256i add(__m256i sum, __m256i x0, __m256i y0, __m256i x1, __m256i y1) {
    return add_four(add_four(sum, x0, y0), x1, y1);
  }

  static NERF_INLINE __m256i add_four(__m256i sum, __m256i x, __m256i y) {
    y = _mm256_add_epi8(y, _mm256_set1_epi8(kShift));
    const __m256i low = _mm256_set1_epi16(255);
    sum = _mm256_add_epi32(sum,
                           _mm256_madd_epi16(_mm256_and_si256(x, low), _mm256_and_si256(y, low)));
    return _mm256_add_epi32(sum,
                            _mm256_madd_epi16(_mm256_srli_epi16(x, 8), _mm256_srli_epi16(y, 8)));
  }
};

// kRows x kColumns vectors of dot products stay in registers.
template <class Products, int kRows, int kColumns>
inline NERF_INLINE void block(const int8_t* a, const uint8_t* b, const int32_t* offsets,
                              int32_t* out) {
  constexpr int kStride = kSteps * 4 * kLanes;
  __m256i sum[kRows][kColumns];
  unrolled<kRows>([&](auto r) NERF_INLINE {
    unrolled<kColumns>([&](auto v) NERF_INLINE {
      sum[r][v] = Products::kShifted ? load(offsets + v * kLanes) : _mm256_setzero_si256();
    });
  });
  for (int k = 0; k < kSteps; k += 2) {
    __m256i x0[kColumns], x1[kColumns];
    unrolled<kColumns>([&](auto v) NERF_INLINE {
      x0[v] = load(b + v * kStride + k * 4 * kLanes);
      x1[v] = load(b + v * kStride + (k + 1) * 4 * kLanes);
      keep(x0[v]);
      keep(x1[v]);
    });
    unrolled<kRows>([&](auto r) NERF_INLINE {
      const __m256i y0 = four_bytes(a + r * kDescriptorBytes + 4 * k);
      const __m256i y1 = four_bytes(a + r * kDescriptorBytes + 4 * (k + 1));
      unrolled<kColumns>(
          [&](auto v) NERF_INLINE { sum[r][v] = Products::add(sum[r][v], x0[v], y0, x1[v], y1); });
    });
  }
  unrolled<kRows>([&](auto r) NERF_INLINE {
    unrolled<kColumns>([&](auto v) NERF_INLINE {
      _mm256_store_si256(reinterpret_cast<__m256i*>(out + r * kTileColumns + v * kLanes),
                         sum[r][v]);
    });
  });
}

template <class Products>
void multiply_tile(const DescriptorRows& rows, const DescriptorPanel& panel, DescriptorTile& tile) {
  constexpr int kRows = 8, kColumns = 1;
  const int8_t* shifted = reinterpret_cast<const int8_t*>(rows.values);
  const uint8_t* values = reinterpret_cast<const uint8_t*>(panel.values);
  for (int v = 0; v < kTileColumns / kLanes; v += kColumns)
    for (int r = 0; r < kTileRows; r += kRows)
      block<Products, kRows, kColumns>(shifted + r * kDescriptorBytes,
                                       values + v * kSteps * 4 * kLanes, panel.offsets + v * kLanes,
                                       &tile.dots[r][v * kLanes]);
}

// The greatest sum of squares of four bytes whose products are added before they are widened.
int32_t largest_four(int64_t count, const uint8_t* bytes, int shift) {
  int32_t largest = 0;
  for (int64_t i = 0; i < count; i += 8)
    for (int64_t j = i; j < i + 4; j += 2) {
      int32_t sum = 0;
      for (const int64_t k : {j, j + 1, j + 4, j + 5})
        sum += (bytes[k] - shift) * (bytes[k] - shift);
      largest = std::max(largest, sum);
    }
  return largest;
}

void pack_rows(int64_t rows, const uint8_t* a, DescriptorRows& out) {
  constexpr int kMost = std::numeric_limits<int8_t>::max() + kShift;
  int8_t* shifted = reinterpret_cast<int8_t*>(out.values);
  const int64_t given = rows * kDescriptorBytes;
  bool fits = true;
  for (int64_t i = 0; i < kTileRows * kDescriptorBytes; ++i) {
    const int value = i < given ? a[i] : 0;
    fits &= value <= kMost;
    shifted[i] = static_cast<int8_t>(value - kShift);
  }
  const int32_t empty = rows < kTileRows ? 4 * kShift * kShift : 0;
  out.largest =
      fits ? std::max(empty, largest_four(given, a, kShift)) : std::numeric_limits<int32_t>::max();
}

void pack_columns(int64_t columns, const uint8_t* b, DescriptorPanel& out) {
  pack_descriptor_bytes(columns, b, kLanes, kShift, out);
  out.largest = std::max(1, largest_four(columns * kDescriptorBytes, b, 0));
}

void multiply(const DescriptorRows& rows, const DescriptorPanel& panel, DescriptorTile& tile) {
  constexpr int64_t kMost = std::numeric_limits<int16_t>::max();
  if (int64_t{rows.largest} * panel.largest <= kMost * kMost)
    multiply_tile<Bytes>(rows, panel, tile);
  else
    multiply_tile<Words>(rows, panel, tile);
}

}  // namespace

const DescriptorProducts& byte_pair_products() {
  static constexpr DescriptorProducts kProducts{pack_rows, pack_columns, multiply};
  return kProducts;
}

}  // namespace nerf::internal

#endif  // x86-64
