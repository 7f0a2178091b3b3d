#include "nerf/kernels/elementwise.h"
#include "nerf/kernels/linear.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/elementwise_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <hwy/contrib/math/math-inl.h>
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<float>;

template <class Body>
HWY_INLINE void each(int64_t n, const Body& body) {
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(D()));
  const int64_t end = round_up(n, kLane);
  for (int64_t i = 0; i < end; i += lanes) body(D(), i);
}

void exp_forward(int64_t n, const float* x, float* y) {
  each(n, [=](D d, int64_t i) {
    hn::Store(hn::Exp(d, hn::Min(hn::Load(d, x + i), hn::Set(d, kMaxLogDensity))), d, y + i);
  });
}

void exp_backward(int64_t n, const float* x, const float* dy, float* dx) {
  each(n, [=](D d, int64_t i) {
    const auto at = hn::Min(hn::Max(hn::Load(d, x + i), hn::Set(d, -15.0f)), hn::Set(d, 15.0f));
    hn::Store(hn::Mul(hn::Exp(d, at), hn::Load(d, dy + i)), d, dx + i);
  });
}

void sigmoid(int64_t n, const float* x, float* y) {
  each(n, [=](D d, int64_t i) {
    const auto one = hn::Set(d, 1.0f);
    // Highway's Exp is defined up to 104 and gives NaN from 178 on. At 88 the result is below the
    // smallest normal number already.
    const auto at = hn::Max(hn::Load(d, x + i), hn::Set(d, -88.0f));
    hn::Store(hn::Div(one, hn::Add(one, hn::Exp(d, hn::Neg(at)))), d, y + i);
  });
}

void sigmoid_gradient(int64_t n, const float* y, const float* dy, float* dx) {
  each(n, [=](D d, int64_t i) {
    const auto v = hn::Load(d, y + i);
    hn::Store(hn::Mul(hn::Load(d, dy + i), hn::NegMulAdd(v, v, v)), d, dx + i);
  });
}

// From the side where exp does not overflow: max(x, 0) + log(1 + exp(-|x|)).
void softplus(int64_t n, float shift, const float* x, float* y) {
  each(n, [=](D d, int64_t i) {
    const auto at = hn::Add(hn::Load(d, x + i), hn::Set(d, shift));
    const auto e = hn::Exp(d, hn::Max(hn::Neg(hn::Abs(at)), hn::Set(d, -100.0f)));
    hn::Store(hn::Add(hn::Max(at, hn::Zero(d)), hn::Log1p(d, e)), d, y + i);
  });
}

void softplus_gradient(int64_t n, float shift, const float* x, const float* dy, float* dx) {
  each(n, [=](D d, int64_t i) {
    const auto one = hn::Set(d, 1.0f);
    const auto at = hn::Max(hn::Add(hn::Load(d, x + i), hn::Set(d, shift)), hn::Set(d, -88.0f));
    const auto slope = hn::Div(one, hn::Add(one, hn::Exp(d, hn::Neg(at))));
    hn::Store(hn::Mul(slope, hn::Load(d, dy + i)), d, dx + i);
  });
}

void relu(int64_t n, const float* x, float* y) {
  each(n, [=](D d, int64_t i) { hn::Store(hn::Max(hn::Load(d, x + i), hn::Zero(d)), d, y + i); });
}

void alpha(int64_t n, const float* density, const float* delta, float* out) {
  each(n, [=](D d, int64_t i) {
    const auto length = hn::Min(hn::Load(d, delta + i), hn::Set(d, kLongestInterval));
    const auto tau = hn::Mul(hn::Load(d, density + i), length);
    hn::Store(hn::Neg(hn::Expm1(d, hn::Max(hn::Neg(tau), hn::Set(d, -80.0f)))), d, out + i);
  });
}

void add(int64_t n, const float* x, float* y) {
  each(n, [=](D d, int64_t i) {
    hn::Store(hn::Add(hn::Load(d, x + i), hn::Load(d, y + i)), d, y + i);
  });
}

// Squares of four by four; what is left over one by one.
void transposed(int64_t n, int64_t rows, const float* HWY_RESTRICT x, int64_t ldx,
                float* HWY_RESTRICT y, int64_t ldy) {
  const hn::CappedTag<float, 4> d;
  const hn::Repartition<double, decltype(d)> d2;
  const int64_t whole_n = hn::Lanes(d) == 4 ? n / 4 * 4 : 0, whole_rows = rows / 4 * 4;
  for (int64_t k = 0; k < whole_rows; k += 4)
    for (int64_t s = 0; s < whole_n; s += 4) {
      const float* from = x + k * ldx + s;
      float* to = y + s * ldy + k;
      const auto a = hn::LoadU(d, from), b = hn::LoadU(d, from + ldx);
      const auto c = hn::LoadU(d, from + 2 * ldx), e = hn::LoadU(d, from + 3 * ldx);
      const auto ab_low = hn::BitCast(d2, hn::InterleaveLower(d, a, b));
      const auto ab_high = hn::BitCast(d2, hn::InterleaveUpper(d, a, b));
      const auto ce_low = hn::BitCast(d2, hn::InterleaveLower(d, c, e));
      const auto ce_high = hn::BitCast(d2, hn::InterleaveUpper(d, c, e));
      hn::StoreU(hn::BitCast(d, hn::InterleaveLower(d2, ab_low, ce_low)), d, to);
      hn::StoreU(hn::BitCast(d, hn::InterleaveUpper(d2, ab_low, ce_low)), d, to + ldy);
      hn::StoreU(hn::BitCast(d, hn::InterleaveLower(d2, ab_high, ce_high)), d, to + 2 * ldy);
      hn::StoreU(hn::BitCast(d, hn::InterleaveUpper(d2, ab_high, ce_high)), d, to + 3 * ldy);
    }
  for (int64_t k = 0; k < rows; ++k)
    for (int64_t s = k < whole_rows ? whole_n : 0; s < n; ++s) y[s * ldy + k] = x[k * ldx + s];
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(transposed);
HWY_EXPORT(exp_forward);
HWY_EXPORT(exp_backward);
HWY_EXPORT(sigmoid);
HWY_EXPORT(sigmoid_gradient);
HWY_EXPORT(softplus);
HWY_EXPORT(softplus_gradient);
HWY_EXPORT(relu);
HWY_EXPORT(alpha);
HWY_EXPORT(add);

void truncated_exp_forward(int64_t n, const float* x, float* y) {
  HWY_DYNAMIC_DISPATCH(exp_forward)(n, x, y);
}
void truncated_exp_backward(int64_t n, const float* x, const float* dy, float* dx) {
  HWY_DYNAMIC_DISPATCH(exp_backward)(n, x, dy, dx);
}
void sigmoid_forward(int64_t n, const float* x, float* y) {
  HWY_DYNAMIC_DISPATCH(sigmoid)(n, x, y);
}
void sigmoid_backward(int64_t n, const float* y, const float* dy, float* dx) {
  HWY_DYNAMIC_DISPATCH(sigmoid_gradient)(n, y, dy, dx);
}
void softplus_forward(int64_t n, float shift, const float* x, float* y) {
  HWY_DYNAMIC_DISPATCH(softplus)(n, shift, x, y);
}
void softplus_backward(int64_t n, float shift, const float* x, const float* dy, float* dx) {
  HWY_DYNAMIC_DISPATCH(softplus_gradient)(n, shift, x, dy, dx);
}
void relu_forward(int64_t n, const float* x, float* y) { HWY_DYNAMIC_DISPATCH(relu)(n, x, y); }
void opacity(int64_t n, const float* density, const float* delta, float* out) {
  HWY_DYNAMIC_DISPATCH(alpha)(n, density, delta, out);
}
void transpose(int64_t n, int64_t rows, const float* x, int64_t ldx, float* y, int64_t ldy) {
  HWY_DYNAMIC_DISPATCH(transposed)(n, rows, x, ldx, y, ldy);
}
void add_to(int64_t n, const float* x, float* y) { HWY_DYNAMIC_DISPATCH(add)(n, x, y); }
}  // namespace nerf
#endif
