#include <algorithm>

#include "nerf/kernels/linear.h"
#include "nerf/kernels/sample_groups.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/sample_groups_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include "kernels/part_vectors-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, kLane>;
using DI = hn::RebindToSigned<D>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;
constexpr int64_t kLanes = static_cast<int64_t>(hn::MaxLanes(D()));

// Lanes whose group is that of the lane kBy before them.
template <int kBy>
HWY_INLINE M continues(const int32_t* of) {
  alignas(64) int32_t same[kLanes];
  for (int i = 0; i < kLanes; ++i) same[i] = i >= kBy && of[i] == of[i - kBy] ? -1 : 0;
  return hn::MaskFromVec(hn::BitCast(D(), hn::Load(DI(), same)));
}

constexpr int kRowsAtOnce = 32;

// Sums of share x over the groups of a vector of samples, row by row. Groups follow one another:
// their sums, at the last lane of each, are packed together and belong to successive columns. From
// the third vector of one group on its sum is kept in double: in float the sums of a million
// samples that are alike would be off by a thousandth.
void forward_rows(const SampleGroups& groups, int rows, const float* HWY_RESTRICT x, int64_t ldx,
                  float* HWY_RESTRICT y, int64_t ldy) {
  const D d;
  double sums[kRowsAtOnce] = {};
  bool in_double = false;  // what the vectors before have of the first group
  for (int64_t i = 0; i < groups.samples; i += kLanes) {
    const int32_t* of = groups.of + i;
    const int32_t first = of[0];
    const V share = hn::LoadU(d, groups.share + i);
    // By a permutation, found once for all rows: to compress has no instruction without AVX-512,
    // and Highway's way copies a table for each vector.
    alignas(64) int32_t last[kLanes] = {};
    for (int k = 0, packed = 0; k < kLanes; ++k)
      if (k + 1 == kLanes || of[k + 1] != of[k]) last[packed++] = k;
    const auto ends = hn::SetTableIndices(d, last);
    // What the vector before has of the first group.
    const bool begun = !in_double && i > 0 && of[-1] == first;
    const bool goes_on = (begun || in_double) && i + kLanes < groups.samples && of[kLanes] == first;
    const M same1 = continues<1>(of), same2 = continues<2>(of), same4 = continues<4>(of),
            same8 = continues<8>(of);
    for (int k = 0; k < rows; ++k) {
      float* to = y + k * ldy + first;
      V v = hn::Mul(share, hn::LoadU(d, x + k * ldx + i));
      if (begun) v = hn::Add(v, hn::IfThenElseZero(hn::FirstN(d, 1), hn::Set(d, *to)));
      if constexpr (kLanes > 1) v = hn::Add(v, hn::IfThenElseZero(same1, moved_lanes<-1>(d, v)));
      if constexpr (kLanes > 2) v = hn::Add(v, hn::IfThenElseZero(same2, moved_lanes<-2>(d, v)));
      if constexpr (kLanes > 4) v = hn::Add(v, hn::IfThenElseZero(same4, moved_lanes<-4>(d, v)));
      if constexpr (kLanes > 8) v = hn::Add(v, hn::IfThenElseZero(same8, moved_lanes<-8>(d, v)));
      v = hn::TableLookupLanes(v, ends);
      hn::StoreU(v, d, to);
      if (in_double) {
        sums[k] += static_cast<double>(hn::GetLane(v));
        *to = static_cast<float>(sums[k]);
      } else if (goes_on) {
        sums[k] = static_cast<double>(hn::GetLane(v));
      }
    }
    in_double = goes_on;
  }
  for (int k = 0; k < rows; ++k)
    std::fill(y + k * ldy + groups.count, y + k * ldy + round_up(groups.count, kLane), 0.0f);
}

void forward(const SampleGroups& groups, int rows, const float* HWY_RESTRICT x, int64_t ldx,
             float* HWY_RESTRICT y, int64_t ldy) {
  for (int k = 0; k < rows; k += kRowsAtOnce)
    forward_rows(groups, rows - k < kRowsAtOnce ? rows - k : kRowsAtOnce, x + k * ldx, ldx,
                 y + k * ldy, ldy);
}

void backward(const SampleGroups& groups, int rows, const float* HWY_RESTRICT x, int64_t ldx,
              const float* HWY_RESTRICT y, const float* HWY_RESTRICT dy, int64_t ldy,
              float* HWY_RESTRICT dw, float* HWY_RESTRICT dx) {
  const D d;
  for (int64_t i = 0; i < groups.samples; i += kLanes) {
    const int64_t first = groups.of[i];
    const auto at = hn::IndicesFromVec(
        d, hn::Sub(hn::LoadU(DI(), groups.of + i), hn::Set(DI(), static_cast<int32_t>(first))));
    const V share = hn::LoadU(d, groups.share + i);
    V toward = hn::Zero(d);
    for (int k = 0; k < rows; ++k) {
      const V slope = hn::TableLookupLanes(hn::LoadU(d, dy + k * ldy + first), at);
      if (dw) {
        const V mean = hn::TableLookupLanes(hn::LoadU(d, y + k * ldy + first), at);
        toward = hn::MulAdd(slope, hn::Sub(hn::LoadU(d, x + k * ldx + i), mean), toward);
      }
      if (dx) {
        float* to = dx + k * ldx + i;
        hn::StoreU(hn::MulAdd(share, slope, hn::LoadU(d, to)), d, to);
      }
    }
    if (dw)
      hn::StoreU(hn::MulAdd(hn::LoadU(d, groups.per_light + i), toward, hn::LoadU(d, dw + i)), d,
                 dw + i);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(forward);
HWY_EXPORT(backward);

void mean_of_groups_forward(const SampleGroups& groups, int rows, const float* x, int64_t ldx,
                            float* y, int64_t ldy) {
  HWY_DYNAMIC_DISPATCH(forward)(groups, rows, x, ldx, y, ldy);
}
void mean_of_groups_backward(const SampleGroups& groups, int rows, const float* x, int64_t ldx,
                             const float* y, const float* dy, int64_t ldy, float* dw, float* dx) {
  HWY_DYNAMIC_DISPATCH(backward)(groups, rows, x, ldx, y, dy, ldy, dw, dx);
}
}  // namespace nerf
#endif
