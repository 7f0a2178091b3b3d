#include <cmath>
#include <cstring>

#include "nerf/kernels/adam.h"
#include "nerf/kernels/linear.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/adam_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// One vector of parameters: c1 = rate / (1 - beta1^t), c2 = 1 / sqrt(1 - beta2^t).
template <class D>
struct Updated {
  hn::Vec<D> m, v, w;
};

template <class D, class V = hn::Vec<D>>
HWY_INLINE Updated<D> updated(D d, const AdamStep& o, V c1, V c2, V g, V m, V v, V w) {
  g = hn::MulAdd(hn::Set(d, o.l2), w, g);
  const V most = hn::Set(d, kMostGradient);
  g = hn::IfThenElse(hn::Gt(hn::Abs(g), most), hn::CopySign(most, g), g);
  m = hn::MulAdd(hn::Set(d, 1.0f - o.beta1), g, hn::Mul(hn::Set(d, o.beta1), m));
  v = hn::MulAdd(hn::Set(d, 1.0f - o.beta2), hn::Mul(g, g), hn::Mul(hn::Set(d, o.beta2), v));
  const V denominator = hn::MulAdd(hn::Sqrt(v), c2, hn::Set(d, o.epsilon));
  return {m, v, hn::NegMulAdd(c1, hn::Div(m, denominator), w)};
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE void update(D d, const AdamStep& o, V c1, V c2, V g, float* m, float* v, float* w) {
  const Updated<D> to = updated(d, o, c1, c2, g, hn::Load(d, m), hn::Load(d, v), hn::Load(d, w));
  hn::Store(to.m, d, m);
  hn::Store(to.v, d, v);
  hn::Store(to.w, d, w);
}

// The same where the mask is set.
template <class D, class V = hn::Vec<D>>
HWY_INLINE void update_where(D d, hn::Mask<D> where, const AdamStep& o, V c1, V c2, V g, float* m,
                             float* v, float* w) {
  const V m0 = hn::Load(d, m), v0 = hn::Load(d, v), w0 = hn::Load(d, w);
  const Updated<D> to = updated(d, o, c1, c2, g, m0, v0, w0);
  hn::Store(hn::IfThenElse(where, to.m, m0), d, m);
  hn::Store(hn::IfThenElse(where, to.v, v0), d, v);
  hn::Store(hn::IfThenElse(where, to.w, w0), d, w);
}

void dense(const AdamStep& o, float c1, float c2, int64_t n, const float* gradient, float* m,
           float* v, float* weights) {
  const hn::ScalableTag<float> d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  for (int64_t i = 0; i < n; i += lanes)
    update(d, o, hn::Set(d, c1), hn::Set(d, c2), hn::Load(d, gradient + i), m + i, v + i,
           weights + i);
}

using D4 = hn::CappedTag<float, 4>;

// The same four values in the lowest lanes of a vector.
template <class D>
HWY_INLINE hn::Vec<D> widened(D d, hn::Vec<D4> v) {
  if constexpr (hn::MaxLanes(D()) == 4) {
    return v;
  } else {
    return hn::ZeroExtendVector(d, widened(hn::Half<D>(), v));
  }
}

// Four rows of F at once; rows without gradient keep every bit. Flags and counters stay in vectors:
// a vector read from what scalars have just written would stall.
template <int F>
void sparse_rows(const AdamStep& o, int64_t rows, uint8_t* touched, float* gradient, float* m,
                 float* v, uint16_t* steps, float* weights, const float* correction) {
  constexpr int64_t kRows = 4;
  const hn::CappedTag<float, kRows * F> d;
  constexpr int64_t kAhead = 32;  // rows; the processor does not foresee which ones have gradients
  constexpr int64_t kLanes = hn::MaxLanes(hn::CappedTag<float, kRows * F>());
  const hn::CappedTag<uint8_t, kRows> d8;
  const hn::CappedTag<uint16_t, kRows> d16;
  const hn::CappedTag<int32_t, kRows> di;
  const D4 d4;
  // Row of each parameter of the four rows.
  alignas(64) static constexpr int32_t kRow4[] = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3};
  alignas(64) static constexpr int32_t kRow2[] = {0, 0, 1, 1, 2, 2, 3, 3};
  const int32_t* row_of = F == 4 ? kRow4 : kRow2;
  const auto rate = hn::Set(d4, o.rate);
  const auto last = hn::Set(di, kBiasCorrections - 1);
  for (int64_t block = 0; block < rows; block += 8) {
    uint64_t any, later = 0;
    if (block + kAhead < rows) std::memcpy(&later, touched + block + kAhead, sizeof(later));
    if (later != 0)
      for (float* array : {gradient, m, v, weights}) {
        __builtin_prefetch(array + F * (block + kAhead), 1, 3);
        if (F == 4) __builtin_prefetch(array + F * (block + kAhead) + 16, 1, 3);
      }
    std::memcpy(&any, touched + block, sizeof(any));
    if (any == 0) continue;
    for (int64_t first = block; first < block + 8; first += kRows, any >>= 8 * kRows) {
      if (static_cast<uint32_t>(any) == 0) continue;
      const auto on = hn::PromoteTo(d16, hn::Load(d8, touched + first));
      const auto count = hn::SaturatedAdd(hn::Load(d16, steps + first), on);
      hn::Store(count, d16, steps + first);
      const auto t = hn::Min(hn::PromoteTo(di, count), last);
      const auto c1 = hn::Mul(rate, hn::GatherIndex(d4, correction, hn::Add(t, t)));
      const auto c2 = hn::GatherIndex(d4, correction + 1, hn::Add(t, t));
      const auto open = hn::ConvertTo(d4, hn::PromoteTo(di, on));
      for (int64_t lane = 0; lane < F * kRows; lane += kLanes) {
        const auto row = hn::SetTableIndices(d, row_of + lane);
        const auto spread = [&](hn::Vec<D4> x)
                                HWY_ATTR { return hn::TableLookupLanes(widened(d, x), row); };
        const auto where = hn::Gt(spread(open), hn::Zero(d));
        const int64_t at = F * first + lane;
        const auto g = hn::Load(d, gradient + at);
        update_where(d, where, o, spread(c1), spread(c2), g, m + at, v + at, weights + at);
        hn::Store(hn::IfThenZeroElse(where, g), d, gradient + at);
      }
    }
    std::memset(touched + block, 0, 8);
  }
}

void sparse(const AdamStep& o, int features, int64_t rows, uint8_t* touched, float* gradient,
            float* m, float* v, uint16_t* steps, float* weights, const float* correction) {
  (features == 4 ? sparse_rows<4> : sparse_rows<2>)(o, rows, touched, gradient, m, v, steps,
                                                    weights, correction);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(dense);
HWY_EXPORT(sparse);

void adam_dense(const AdamStep& options, int64_t step, int64_t n, const float* gradient, float* m,
                float* v, float* weights) {
  const double t = static_cast<double>(step);
  const double c1 = options.rate / (1 - std::pow(static_cast<double>(options.beta1), t));
  const double c2 = 1 / std::sqrt(1 - std::pow(static_cast<double>(options.beta2), t));
  HWY_DYNAMIC_DISPATCH(dense)
  (options, static_cast<float>(c1), static_cast<float>(c2), n, gradient, m, v, weights);
}

void adam_rows(const AdamStep& options, int features, int64_t rows, uint8_t* touched,
               float* gradient, float* m, float* v, uint16_t* steps, float* weights,
               const float* correction) {
  HWY_DYNAMIC_DISPATCH(sparse)
  (options, features, rows, touched, gradient, m, v, steps, weights, correction);
}
}  // namespace nerf
#endif
