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
HWY_INLINE void update(D d, const AdamStep& o, float c1, float c2, hn::Vec<D> g, float* m, float* v,
                       float* w) {
  const auto weight = hn::Load(d, w);
  g = hn::MulAdd(hn::Set(d, o.l2), weight, g);
  const auto m1 =
      hn::MulAdd(hn::Set(d, 1.0f - o.beta1), g, hn::Mul(hn::Set(d, o.beta1), hn::Load(d, m)));
  const auto v1 = hn::MulAdd(hn::Set(d, 1.0f - o.beta2), hn::Mul(g, g),
                             hn::Mul(hn::Set(d, o.beta2), hn::Load(d, v)));
  hn::Store(m1, d, m);
  hn::Store(v1, d, v);
  const auto denominator = hn::MulAdd(hn::Sqrt(v1), hn::Set(d, c2), hn::Set(d, o.epsilon));
  hn::Store(hn::NegMulAdd(hn::Set(d, c1), hn::Div(m1, denominator), weight), d, w);
}

void dense(const AdamStep& o, float c1, float c2, int64_t n, const float* gradient, float* m,
           float* v, float* weights) {
  const hn::ScalableTag<float> d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  for (int64_t i = 0; i < n; i += lanes)
    update(d, o, c1, c2, hn::Load(d, gradient + i), m + i, v + i, weights + i);
}

void sparse(const AdamStep& o, int64_t rows, uint8_t* touched, float* gradient, float* m, float* v,
            uint16_t* steps, float* weights, const float* correction) {
  const hn::CappedTag<float, 4> d;
  for (int64_t block = 0; block < rows; block += 8) {
    uint64_t any;
    std::memcpy(&any, touched + block, sizeof(any));
    if (any == 0) continue;
    for (int64_t r = block; r < block + 8; ++r) {
      if (!touched[r]) continue;
      if (steps[r] < 65535) ++steps[r];
      const int t = steps[r] < kBiasCorrections ? steps[r] : kBiasCorrections - 1;
      float* g = gradient + 4 * r;
      update(d, o, o.rate * correction[2 * t], correction[2 * t + 1], hn::Load(d, g), m + 4 * r,
             v + 4 * r, weights + 4 * r);
      hn::Store(hn::Zero(d), d, g);
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
