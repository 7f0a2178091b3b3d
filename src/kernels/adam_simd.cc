#include <algorithm>
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

// As many rows of 4 as a vector holds, at once; rows without gradient keep every bit.
void sparse(const AdamStep& o, int64_t rows, uint8_t* touched, float* gradient, float* m, float* v,
            uint16_t* steps, float* weights, const float* correction) {
  const hn::ScalableTag<float> d;
  constexpr int64_t kRows = hn::MaxLanes(hn::ScalableTag<float>()) / 4;
  alignas(64) float c1[4 * kRows], c2[4 * kRows], open[4 * kRows];
  const auto last_c1 = hn::Set(d, o.rate * correction[2 * (kBiasCorrections - 1)]);
  const auto last_c2 = hn::Set(d, correction[2 * (kBiasCorrections - 1) + 1]);
  for (int64_t block = 0; block < rows; block += 8) {
    uint64_t any;
    std::memcpy(&any, touched + block, sizeof(any));
    if (any == 0) continue;
    for (int64_t first = block; first < block + 8; first += kRows) {
      bool all = true, none = true, young = false;
      for (int64_t i = 0; i < kRows; ++i) {
        const bool on = touched[first + i] != 0;
        uint16_t& step = steps[first + i];
        if (on && step < 65535) ++step;
        all &= on;
        none &= !on;
        young |= step < kBiasCorrections - 1;
      }
      if (none) continue;
      auto rate = last_c1, root = last_c2;
      if (young) {
        for (int64_t i = 0; i < kRows; ++i) {
          const int t = std::min<int>(steps[first + i], kBiasCorrections - 1);
          for (int64_t f = 0; f < 4; ++f) {
            c1[4 * i + f] = o.rate * correction[2 * t];
            c2[4 * i + f] = correction[2 * t + 1];
          }
        }
        rate = hn::Load(d, c1);
        root = hn::Load(d, c2);
      }
      const int64_t at = 4 * first;
      const auto g = hn::Load(d, gradient + at);
      if (all) {
        update(d, o, rate, root, g, m + at, v + at, weights + at);
        hn::Store(hn::Zero(d), d, gradient + at);
      } else {
        for (int64_t i = 0; i < 4 * kRows; ++i) open[i] = touched[first + i / 4] ? 1.0f : 0.0f;
        const auto where = hn::Gt(hn::Load(d, open), hn::Zero(d));
        update_where(d, where, o, rate, root, g, m + at, v + at, weights + at);
        hn::Store(hn::IfThenZeroElse(where, g), d, gradient + at);
      }
    }
    std::memset(touched + block, 0, 8);
  }
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

void adam_rows(const AdamStep& options, int64_t rows, uint8_t* touched, float* gradient, float* m,
               float* v, uint16_t* steps, float* weights, const float* correction) {
  HWY_DYNAMIC_DISPATCH(sparse)
  (options, rows, touched, gradient, m, v, steps, weights, correction);
}

void bias_corrections(const AdamStep& options, float* correction) {
  correction[0] = correction[1] = 1;
  for (int t = 1; t < kBiasCorrections; ++t) {
    correction[2 * t] =
        static_cast<float>(1 / (1 - std::pow(static_cast<double>(options.beta1), t)));
    correction[2 * t + 1] =
        static_cast<float>(1 / std::sqrt(1 - std::pow(static_cast<double>(options.beta2), t)));
  }
}
}  // namespace nerf
#endif
