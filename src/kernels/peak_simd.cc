#include "nerf/kernels/peak.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/peak_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

int64_t fma(int64_t rounds, float* sink) {
  // Two units with a latency of 4 cycles need 8 chains; 12 and two constants fit into 16 registers.
  constexpr int kChains = 12;
  const D d;
  // Every chain runs towards 1, so that no value leaves the normal numbers.
  const V a = hn::Set(d, 0.75f), b = hn::Set(d, 0.25f);
  V chain[kChains];
  for (int c = 0; c < kChains; ++c) chain[c] = hn::Set(d, static_cast<float>(c));
  for (int64_t r = 0; r < rounds; ++r)
    for (int c = 0; c < kChains; ++c) chain[c] = hn::MulAdd(chain[c], a, b);
  V sum = chain[0];
  for (int c = 1; c < kChains; ++c) sum = hn::Add(sum, chain[c]);
  *sink = hn::GetLane(hn::SumOfLanes(d, sum));
  return 2 * kChains * static_cast<int64_t>(hn::Lanes(d)) * rounds;
}

float read(int64_t n, const float* HWY_RESTRICT x) {
  constexpr int kSums = 8;
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  V sum[kSums];
  for (int v = 0; v < kSums; ++v) sum[v] = hn::Zero(d);
  for (int64_t i = 0; i < n; i += kSums * lanes)
    for (int v = 0; v < kSums; ++v) sum[v] = hn::Add(sum[v], hn::Load(d, x + i + v * lanes));
  for (int v = 1; v < kSums; ++v) sum[0] = hn::Add(sum[0], sum[v]);
  return hn::GetLane(hn::SumOfLanes(d, sum[0]));
}

// Places of the kRowUnit reads from `first` on.
HWY_INLINE void places(uint32_t first, uint32_t mask, uint32_t* out) {
  const hn::ScalableTag<uint32_t> d;
  const uint32_t lanes = static_cast<uint32_t>(hn::Lanes(d));
  for (uint32_t i = 0; i < kRowUnit; i += lanes) {
    auto h = hn::Mul(hn::Iota(d, first + i), hn::Set(d, 2654435761u));
    h = hn::Mul(hn::Xor(h, hn::ShiftRight<15>(h)), hn::Set(d, 805459861u));
    h = hn::Xor(h, hn::ShiftRight<13>(h));
    hn::Store(hn::And(h, hn::Set(d, mask)), d, out + i);
  }
}

float random_rows(int64_t rows, const float* HWY_RESTRICT table, int64_t reads, uint32_t salt) {
  const hn::CappedTag<float, 4> d4;
  const uint32_t mask = static_cast<uint32_t>(rows - 1);
  auto sum0 = hn::Zero(d4), sum1 = hn::Zero(d4);
  // The next rows are asked for while these are summed, as the hash grid does it.
  alignas(64) uint32_t at[2][kRowUnit];
  places(salt, mask, at[0]);
  for (int64_t i = 0; i < reads; i += kRowUnit) {
    const uint32_t* now = at[(i / kRowUnit) & 1];
    uint32_t* next = at[(i / kRowUnit + 1) & 1];
    places(salt + static_cast<uint32_t>(i + kRowUnit), mask, next);
    for (int k = 0; k < kRowUnit; ++k)
      __builtin_prefetch(table + static_cast<size_t>(next[k]) * 4, 0, 3);
    for (int k = 0; k < kRowUnit; k += 2) {
      sum0 = hn::Add(sum0, hn::Load(d4, table + static_cast<size_t>(now[k]) * 4));
      sum1 = hn::Add(sum1, hn::Load(d4, table + static_cast<size_t>(now[k + 1]) * 4));
    }
  }
  return hn::GetLane(hn::SumOfLanes(d4, hn::Add(sum0, sum1)));
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(fma);
HWY_EXPORT(read);
HWY_EXPORT(random_rows);

int64_t fma_loop(int64_t rounds, float* sink) { return HWY_DYNAMIC_DISPATCH(fma)(rounds, sink); }
float read_loop(int64_t n, const float* x) { return HWY_DYNAMIC_DISPATCH(read)(n, x); }
float random_row_loop(int64_t rows, const float* table, int64_t reads, uint32_t salt) {
  return HWY_DYNAMIC_DISPATCH(random_rows)(rows, table, reads, salt);
}
}  // namespace nerf
#endif
