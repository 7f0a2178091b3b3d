#include <cmath>
#include <type_traits>

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

void dense(const AdamStep& o, float c1, float c2, int64_t n, const float* gradient, float* m,
           float* v, float* weights) {
  const hn::ScalableTag<float> d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  for (int64_t i = 0; i < n; i += lanes)
    update(d, o, hn::Set(d, c1), hn::Set(d, c2), hn::Load(d, gradient + i), m + i, v + i,
           weights + i);
}

int64_t list(int64_t rows, uint8_t* marks, uint32_t* list) {
  const hn::CappedTag<uint8_t, 64> d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  int64_t count = 0, first = 0;
  for (; first + lanes <= rows; first += lanes) {
    const auto marked = hn::Ne(hn::LoadU(d, marks + first), hn::Zero(d));
    if (hn::AllFalse(d, marked)) continue;
    hn::StoreU(hn::Zero(d), d, marks + first);
    uint64_t bits = 0;
    hn::StoreMaskBits(d, marked, reinterpret_cast<uint8_t*>(&bits));
    for (; bits != 0; bits &= bits - 1)
      list[count++] = static_cast<uint32_t>(first) +
                      static_cast<uint32_t>(hwy::Num0BitsBelowLS1Bit_Nonzero64(bits));
  }
  for (; first < rows; ++first)  // no vector: what follows is another table's
    if (marks[first]) {
      list[count++] = static_cast<uint32_t>(first);
      marks[first] = 0;
    }
  return count;
}

// To nearest, ties to even; beyond the largest half that one.
template <class D>
HWY_INLINE void store_half(hn::Vec<D> x, D d, uint16_t* to) {
  const auto most = hn::Set(d, 65504.0f);
  // What is no number passes: it is the second operand.
  x = hn::Max(hn::Neg(most), hn::Min(most, x));
  const hn::Rebind<hwy::float16_t, D> half;
  const hn::Rebind<uint16_t, D> bits;
  hn::StoreU(hn::BitCast(bits, hn::DemoteTo(half, x)), bits, to);
}

// Weights: where the row's stand, or where they go as half floats from the states.
template <int F, class W>
HWY_INLINE void step_row(const AdamStep& o, const float* correction, float* gradient, float* state,
                         W* weights) {
  const hn::CappedTag<float, F> d;
  float* const steps = state + kRowSteps * F;
  steps[0] = HWY_MIN(steps[0] + 1, kMostRowSteps);
  const int t = HWY_MIN(static_cast<int>(steps[0]), kBiasCorrections - 1);
  const auto c1 = hn::Set(d, o.rate * correction[2 * t]), c2 = hn::Set(d, correction[2 * t + 1]);
  float* const m = state + kRowM * F;
  float* const v = state + kRowV * F;
  if constexpr (std::is_same_v<W, float>) {
    update(d, o, c1, c2, hn::Load(d, gradient), m, v, weights);
  } else {
    float* const w = state + kRowWeights * F;
    update(d, o, c1, c2, hn::Load(d, gradient), m, v, w);
    store_half(hn::Load(d, w), d, weights);
  }
  hn::Store(hn::Zero(d), d, gradient);
}

template <int F, class W>
void listed_rows(const AdamStep& o, const uint32_t* list, int64_t count, float* gradient,
                 float* states, W* weights, const float* correction) {
  constexpr int64_t kAhead = 32;  // rows whose memory is asked for, into the second-level cache
  const auto state = [&](int64_t i) { return states + size_t{list[i]} * kRowParts * F; };
  const auto begin = [&](int64_t i) { return size_t{list[i]} * F; };
  for (int64_t i = -kAhead; i < count; ++i) {
    if (i + kAhead < count) {
      __builtin_prefetch(state(i + kAhead), 1, 2);
      __builtin_prefetch(weights + begin(i + kAhead), 1, 2);
      __builtin_prefetch(gradient + begin(i + kAhead), 1, 2);
    }
    if (i >= 0) step_row<F, W>(o, correction, gradient + begin(i), state(i), weights + begin(i));
  }
}

void listed(const AdamStep& o, int features, const uint32_t* list, int64_t count, float* gradient,
            float* states, float* weights, const float* correction) {
  (features == 4 ? listed_rows<4, float> : listed_rows<2, float>)(o, list, count, gradient, states,
                                                                  weights, correction);
}

void listed_half(const AdamStep& o, int features, const uint32_t* list, int64_t count,
                 float* gradient, float* states, uint16_t* rounded, const float* correction) {
  (features == 4 ? listed_rows<4, uint16_t>
                 : listed_rows<2, uint16_t>)(o, list, count, gradient, states, rounded, correction);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(dense);
HWY_EXPORT(list);
HWY_EXPORT(listed);
HWY_EXPORT(listed_half);

void adam_dense(const AdamStep& options, int64_t step, int64_t n, const float* gradient, float* m,
                float* v, float* weights) {
  const double t = static_cast<double>(step);
  const double c1 = options.rate / (1 - std::pow(static_cast<double>(options.beta1), t));
  const double c2 = 1 / std::sqrt(1 - std::pow(static_cast<double>(options.beta2), t));
  HWY_DYNAMIC_DISPATCH(dense)
  (options, static_cast<float>(c1), static_cast<float>(c2), n, gradient, m, v, weights);
}

int64_t list_rows(int64_t rows, uint8_t* marks, uint32_t* list) {
  return HWY_DYNAMIC_DISPATCH(list)(rows, marks, list);
}

void adam_rows(const AdamStep& options, int features, const uint32_t* list, int64_t count,
               float* gradient, float* states, float* weights, const float* correction) {
  HWY_DYNAMIC_DISPATCH(listed)
  (options, features, list, count, gradient, states, weights, correction);
}
void adam_rows(const AdamStep& options, int features, const uint32_t* list, int64_t count,
               float* gradient, float* states, uint16_t* rounded, const float* correction) {
  HWY_DYNAMIC_DISPATCH(listed_half)
  (options, features, list, count, gradient, states, rounded, correction);
}
}  // namespace nerf
#endif
