#include <algorithm>

#include "nerf/kernels/bf16.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/bf16_convert_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using DU = hn::ScalableTag<uint32_t>;
using DI = hn::RebindToSigned<DU>;
using DN = hn::Rebind<uint16_t, DU>;
constexpr int64_t kLanes = static_cast<int64_t>(hn::MaxLanes(DU()));

// Integers alone: flushed denormals change nothing.
HWY_INLINE hn::Vec<DN> rounded(hn::Vec<DU> u) {
  const DU d;
  const auto upper = hn::ShiftRight<16>(u);
  const auto magnitude = hn::And(u, hn::Set(d, 0x7fffffffu));
  const auto odd = hn::And(upper, hn::Set(d, 1u));
  auto nearest = hn::ShiftRight<16>(hn::Add(u, hn::Add(odd, hn::Set(d, 0x7fffu))));
  nearest = hn::IfThenElse(hn::Lt(magnitude, hn::Set(d, 0x00800000u)),  // below the normal numbers
                           hn::And(upper, hn::Set(d, 0x8000u)), nearest);
  nearest = hn::IfThenElse(hn::Gt(magnitude, hn::Set(d, 0x7f800000u)),  // not a number, made quiet
                           hn::Or(upper, hn::Set(d, 0x0040u)), nearest);
  return hn::DemoteTo(DN(), hn::BitCast(DI(), nearest));
}

HWY_INLINE hn::Vec<DU> widened(hn::Vec<DN> x) { return hn::ShiftLeft<16>(hn::PromoteTo(DU(), x)); }

// to = body(from), whole vectors and a part of one.
template <class DFrom, class DTo, class Body>
HWY_INLINE void each(DFrom from_tag, DTo to_tag, int64_t n, const hn::TFromD<DFrom>* from,
                     hn::TFromD<DTo>* to, const Body& body) {
  int64_t i = 0;
  for (; i + kLanes <= n; i += kLanes)
    hn::StoreU(body(hn::LoadU(from_tag, from + i)), to_tag, to + i);
  if (i >= n) return;
  HWY_ALIGN hn::TFromD<DFrom> some[kLanes] = {};
  HWY_ALIGN hn::TFromD<DTo> part[kLanes];
  std::copy(from + i, from + n, some);
  hn::Store(body(hn::Load(from_tag, some)), to_tag, part);
  std::copy_n(part, n - i, to + i);
}

void round_all(int64_t n, const float* x, uint16_t* out) {
  const hn::RebindToFloat<DU> df;
  each(df, DN(), n, x, out,
       [](hn::Vec<decltype(df)> v) HWY_ATTR { return rounded(hn::BitCast(DU(), v)); });
}

void widen_all(int64_t n, const uint16_t* x, float* out) {
  const hn::RebindToFloat<DU> df;
  each(DN(), df, n, x, out, [df](hn::Vec<DN> v) HWY_ATTR { return hn::BitCast(df, widened(v)); });
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(round_all);
HWY_EXPORT(widen_all);

void round_to_bf16(int64_t n, const float* x, uint16_t* out) {
  HWY_DYNAMIC_DISPATCH(round_all)(n, x, out);
}
void widen_bf16(int64_t n, const uint16_t* x, float* out) {
  HWY_DYNAMIC_DISPATCH(widen_all)(n, x, out);
}
}  // namespace nerf
#endif
