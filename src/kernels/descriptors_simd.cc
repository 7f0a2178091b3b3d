#include "kernels/descriptor_tiles.h"
#include "nerf/kernels/descriptors.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/descriptors_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using internal::ColumnsNearest;
using internal::DescriptorPanel;
using internal::DescriptorRows;
using internal::DescriptorTile;
using internal::kTileColumns;
using internal::kTileRows;
#define NERF_INLINE __attribute__((always_inline))
#include "kernels/unrolled.inc"

using D = hn::ScalableTag<int32_t>;
using D16 = hn::ScalableTag<int16_t>;
using V = hn::Vec<D>;
constexpr int kLanes = static_cast<int>(hn::MaxLanes(D()));
constexpr int kVectors = kTileColumns / kLanes;
constexpr int kSteps = kDescriptorBytes / 2;  // of depth, two at a time

// A vector holds two steps of depth of kLanes columns. On x86 its product with another adds
// neighbours; elsewhere Highway adds the product's lower half and its upper half.
#if HWY_ARCH_X86
constexpr int kColumnStride = 2, kStepStride = 1;
#else
constexpr int kColumnStride = 1, kStepStride = kLanes;
#endif

HWY_INLINE V multiply_add(V sum, hn::Vec<D16> x, hn::Vec<D16> y, V& sum2) {
  return hn::ReorderWidenMulAccumulate(D(), x, y, sum, sum2);
}

// Two steps of one row for all columns.
HWY_INLINE hn::Vec<D16> two_steps(const int16_t* row) {
#if HWY_ARCH_X86
  int32_t both;
  __builtin_memcpy(&both, row, sizeof both);
  return hn::BitCast(D16(), hn::Set(D(), both));
#else
  const hn::Half<D16> half;
  return hn::Combine(D16(), hn::Set(half, row[1]), hn::Set(half, row[0]));
#endif
}

void pack_rows(int64_t rows, const uint8_t* a, DescriptorRows& out) {
  const int64_t given = rows * kDescriptorBytes;
  for (int64_t i = 0; i < given; ++i) out.values[i] = a[i];
  for (int64_t i = given; i < kTileRows * kDescriptorBytes; ++i) out.values[i] = 0;
}

// values: of each vector of columns all steps.
void pack_columns(int64_t columns, const uint8_t* b, DescriptorPanel& panel) {
  for (int c = 0; c < kTileColumns; ++c) {
    uint16_t* to = panel.values + (c / kLanes) * kSteps * 2 * kLanes + c % kLanes * kColumnStride;
    const uint8_t* from = b + c * kDescriptorBytes;
    for (int k = 0; k < kSteps; ++k)
      for (int i = 0; i < 2; ++i)
        to[k * 2 * kLanes + i * kStepStride] = c < columns ? from[2 * k + i] : 0;
  }
}

// kRows x kColumns vectors of dot products stay in registers.
template <int kRows, int kColumns>
HWY_INLINE void block(const int16_t* a, const uint16_t* b, int32_t* out) {
  constexpr int kStride = kSteps * 2 * kLanes;
  const D d;
  const D16 d16;
  const hn::RebindToUnsigned<D16> d16u;
  V sum[kRows][kColumns], sum2[kRows][kColumns];
  unrolled<kRows>([&](auto r) NERF_INLINE {
    unrolled<kColumns>([&](auto v) NERF_INLINE { sum[r][v] = sum2[r][v] = hn::Zero(d); });
  });
  for (int k = 0; k < kSteps; ++k) {
    hn::Vec<D16> x[kColumns];
    unrolled<kColumns>([&](auto v) NERF_INLINE {
      x[v] = hn::BitCast(d16, hn::Load(d16u, b + v * kStride + k * 2 * kLanes));
    });
    unrolled<kRows>([&](auto r) NERF_INLINE {
      const hn::Vec<D16> y = two_steps(a + r * kDescriptorBytes + 2 * k);
      unrolled<kColumns>(
          [&](auto v) NERF_INLINE { sum[r][v] = multiply_add(sum[r][v], y, x[v], sum2[r][v]); });
    });
  }
  unrolled<kRows>([&](auto r) NERF_INLINE {
    unrolled<kColumns>([&](auto v) NERF_INLINE {
      hn::Store(hn::Add(sum[r][v], sum2[r][v]), d, out + r * kTileColumns + v * kLanes);
    });
  });
}

void multiply(const DescriptorRows& rows, const DescriptorPanel& panel, DescriptorTile& tile) {
  constexpr int kRows = 4, kColumns = 2;
  for (int v = 0; v < kVectors; v += kColumns)
    for (int r = 0; r < kTileRows; r += kRows)
      block<kRows, kColumns>(rows.values + r * kDescriptorBytes,
                             panel.values + v * kSteps * 2 * kLanes, &tile.dots[r][v * kLanes]);
}

// Few tiles hold anything larger than the second of a row or a column: a maximum tells.
void take_rows(int64_t rows, const DescriptorTile& tile, int64_t first_column,
               NearestTwo* of_rows) {
  const D d;
  for (int64_t r = 0; r < rows; ++r) {
    const int32_t* dots = tile.dots[r];
    NearestTwo two = of_rows[r];
    V most = hn::Load(d, dots);
    for (int v = 1; v < kVectors; ++v) most = hn::Max(most, hn::Load(d, dots + v * kLanes));
    if (hn::AllFalse(d, hn::Gt(most, hn::Set(d, two.second)))) continue;
    for (int v = 0; v < kVectors; ++v) {
      if (hn::AllFalse(d, hn::Gt(hn::Load(d, dots + v * kLanes), hn::Set(d, two.second)))) continue;
      for (int c = v * kLanes; c < (v + 1) * kLanes; ++c) {
        const int32_t dot = dots[c];
        if (dot > two.best)
          two = {dot, two.best, static_cast<int32_t>(first_column + c)};
        else if (dot > two.second)
          two.second = dot;
      }
    }
    of_rows[r] = two;
  }
}

void take_columns(const DescriptorTile& tile, int64_t first_row, ColumnsNearest& columns) {
  const D d;
  for (int c = 0; c < kTileColumns; c += kLanes) {
    V most = hn::Load(d, &tile.dots[0][c]);
    for (int r = 1; r < kTileRows; ++r) most = hn::Max(most, hn::Load(d, &tile.dots[r][c]));
    V second = hn::Load(d, columns.second + c);
    if (hn::AllFalse(d, hn::Gt(most, second))) continue;
    V best = hn::Load(d, columns.best + c), index = hn::Load(d, columns.index + c);
    for (int r = 0; r < kTileRows; ++r) {
      const V dot = hn::Load(d, &tile.dots[r][c]);
      second = hn::Max(second, hn::Min(best, dot));
      index =
          hn::IfThenElse(hn::Gt(dot, best), hn::Set(d, static_cast<int32_t>(first_row + r)), index);
      best = hn::Max(best, dot);
    }
    hn::Store(best, d, columns.best + c);
    hn::Store(second, d, columns.second + c);
    hn::Store(index, d, columns.index + c);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(pack_rows);
HWY_EXPORT(pack_columns);
HWY_EXPORT(multiply);
HWY_EXPORT(take_rows);
HWY_EXPORT(take_columns);

namespace internal {
const DescriptorProducts& word_products() {
  static constexpr DescriptorProducts kProducts{
      [](int64_t rows, const uint8_t* a, DescriptorRows& out) {
        HWY_DYNAMIC_DISPATCH(pack_rows)(rows, a, out);
      },
      [](int64_t columns, const uint8_t* b, DescriptorPanel& out) {
        HWY_DYNAMIC_DISPATCH(pack_columns)(columns, b, out);
      },
      [](const DescriptorRows& rows, const DescriptorPanel& panel, DescriptorTile& tile) {
        HWY_DYNAMIC_DISPATCH(multiply)(rows, panel, tile);
      }};
  return kProducts;
}
void take_tile_rows(int64_t rows, const DescriptorTile& tile, int64_t first_column,
                    NearestTwo* of_rows) {
  HWY_DYNAMIC_DISPATCH(take_rows)(rows, tile, first_column, of_rows);
}
void take_tile_columns(const DescriptorTile& tile, int64_t first_row, ColumnsNearest& columns) {
  HWY_DYNAMIC_DISPATCH(take_columns)(tile, first_row, columns);
}
}  // namespace internal
}  // namespace nerf
#endif
