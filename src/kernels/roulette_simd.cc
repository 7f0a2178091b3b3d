#include "nerf/kernels/linear.h"
#include "nerf/kernels/roulette.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/roulette_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kLane>;
constexpr int64_t kLanes = static_cast<int64_t>(hn::MaxLanes(D()));

void norms(int rows, int64_t n, const float* HWY_RESTRICT x, int64_t ld, float* HWY_RESTRICT to) {
  const D d;
  for (int64_t i = 0; i < n; i += kLanes) {
    auto sum = hn::Zero(d);
    for (int k = 0; k < rows; ++k) sum = hn::Add(sum, hn::Abs(hn::LoadU(d, x + k * ld + i)));
    hn::StoreU(sum, d, to + i);
  }
}

// A vector of kept columns is written where the ones before it end, which is never behind what is
// still to be read. Without AVX-512, whose instruction it is, compressing a vector takes longer
// than to move its numbers one by one.
void keep(int rows, const int32_t* HWY_RESTRICT kept, int64_t count, float* x, int64_t ld) {
  if constexpr (kLanes < 16) {
    for (int k = 0; k < rows; ++k) {
      float* row = x + k * ld;
      for (int64_t j = 0; j < count; ++j) row[j] = row[kept[j]];
    }
    return;
  }
  const D d;
  for (int64_t j = 0, next = 0; j < count; j = next) {
    const int64_t first = kept[j] / kLanes * kLanes;
    uint64_t bits = 0;
    for (; next < count && kept[next] < first + kLanes; ++next)
      bits |= uint64_t{1} << (kept[next] - first);
    const auto mask = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&bits));
    for (int k = 0; k < rows; ++k) {
      float* row = x + k * ld;
      hn::StoreU(hn::Compress(hn::LoadU(d, row + first), mask), d, row + j);
    }
  }
}

// A pair is a word. A vector of kept columns comes from one vector or from several, each of which
// gives its own.
void keep_words(int rows, const int32_t* HWY_RESTRICT kept, int64_t count, uint32_t* pairs) {
  const int64_t used = (rows + 1) / 2, stride = round_up(rows, 32) / 2 * 16;
  const auto at = [&](int64_t column) { return pairs + column / 16 * stride + column % 16; };
  const hn::CappedTag<uint32_t, kLane> d;
  const hn::RebindToSigned<decltype(d)> di;
  for (int64_t j = 0; j < count; j += kLanes) {
    alignas(64) int32_t lanes[kLane], vectors[kLane];
    for (int64_t i = 0; i < kLanes; ++i) {
      const int32_t column = kept[j + i < count ? j + i : count - 1];
      lanes[i] = static_cast<int32_t>(column % kLanes);
      vectors[i] = static_cast<int32_t>(column / kLanes);
    }
    const auto order = hn::SetTableIndices(d, lanes);
    uint32_t* to = at(j);
    for (int32_t v = vectors[0]; v <= vectors[kLanes - 1]; ++v) {
      const uint32_t* from = at(v * kLanes);
      const auto here = hn::RebindMask(d, hn::Eq(hn::Load(di, vectors), hn::Set(di, v)));
      for (int64_t p = 0; p < used; ++p) {
        const auto moved = hn::TableLookupLanes(hn::Load(d, from + 16 * p), order);
        if (v == vectors[0])
          hn::Store(moved, d, to + 16 * p);
        else
          hn::BlendedStore(moved, here, d, to + 16 * p);
      }
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(norms);
HWY_EXPORT(keep);
HWY_EXPORT(keep_words);

void column_norms(int rows, int64_t n, const float* x, int64_t ld, float* to) {
  HWY_DYNAMIC_DISPATCH(norms)(rows, n, x, ld, to);
}
void keep_columns(int rows, const int32_t* kept, int64_t count, float* x, int64_t ld) {
  HWY_DYNAMIC_DISPATCH(keep)(rows, kept, count, x, ld);
}
void keep_pairs(int rows, const int32_t* kept, int64_t count, uint16_t* pairs) {
  HWY_DYNAMIC_DISPATCH(keep_words)(rows, kept, count, reinterpret_cast<uint32_t*>(pairs));
}
}  // namespace nerf
#endif
