#include <cmath>

#include "nerf/kernels/encoding.h"
#include "nerf/kernels/linear.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/encoding_simd.cc"
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
using V = hn::Vec<D>;

// Beyond it the number of quarter turns needs more digits than the reduction below has.
constexpr float kLargestArgument = 0x1p20f;

// Reduction to [-pi/4, pi/4] by Cody and Waite: the first product is exact, since r is a multiple
// of its last place and below 1; the others each round once, relative to what is left.
HWY_INLINE void reduced_sine_cosine(V y, V& sine, V& cosine) {
  const D d;
  const hn::RebindToSigned<D> di;
  const auto turns = hn::Round(hn::Mul(y, hn::Set(d, 0.636619772f)));
  const auto quadrant = hn::ConvertTo(di, turns);
  V r = hn::NegMulAdd(turns, hn::Set(d, 0x1.921fb6p+0f), y);
  r = hn::NegMulAdd(turns, hn::Set(d, -0x1.777a5cp-25f), r);
  r = hn::NegMulAdd(turns, hn::Set(d, -0x1.ee59dap-50f), r);
  const V r2 = hn::Mul(r, r);
  // Minimax polynomials of the Cephes library's sinf and cosf.
  V s = hn::MulAdd(hn::Set(d, -1.9515295891e-4f), r2, hn::Set(d, 8.3321608736e-3f));
  s = hn::MulAdd(s, r2, hn::Set(d, -1.6666654611e-1f));
  s = hn::MulAdd(hn::Mul(s, r2), r, r);
  V c = hn::MulAdd(hn::Set(d, 2.443315711809948e-5f), r2, hn::Set(d, -1.388731625493765e-3f));
  c = hn::MulAdd(c, r2, hn::Set(d, 4.166664568298827e-2f));
  c = hn::MulAdd(c, r2, hn::Set(d, -0.5f));
  c = hn::MulAdd(c, r2, hn::Set(d, 1.0f));
  const auto one = hn::Set(di, 1), two = hn::Set(di, 2);
  const auto swap = hn::RebindMask(d, hn::Eq(hn::And(quadrant, one), one));
  // Bit 1 of the quadrant, moved to the sign's place.
  const V sine_sign = hn::BitCast(d, hn::ShiftLeft<30>(hn::And(quadrant, two)));
  const V cosine_sign = hn::BitCast(d, hn::ShiftLeft<30>(hn::And(hn::Add(quadrant, one), two)));
  sine = hn::Xor(hn::IfThenElse(swap, c, s), sine_sign);
  cosine = hn::Xor(hn::IfThenElse(swap, s, c), cosine_sign);
}

// For a vector with at least one argument too large: all of its lanes in double.
HWY_NOINLINE void far_sine_cosine(const float* y, size_t lanes, float* sine, float* cosine) {
  for (size_t i = 0; i < lanes; ++i) {
    sine[i] = static_cast<float>(std::sin(static_cast<double>(y[i])));
    cosine[i] = static_cast<float>(std::cos(static_cast<double>(y[i])));
  }
}

void forward(int64_t n, const float* x, const float* variance, float frequency, float weight,
             float* sine, float* cosine) {
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  const int64_t end = round_up(n, kLane);
  const V f = hn::Set(d, frequency), w = hn::Set(d, weight);
  const V half_square = hn::Set(d, -0.5f * frequency * frequency);
  for (int64_t i = 0; i < end; i += lanes) {
    const V y = hn::Mul(f, hn::Load(d, x + i));
    V s, c;
    if (hn::AllTrue(d, hn::Le(hn::Abs(y), hn::Set(d, kLargestArgument)))) {
      reduced_sine_cosine(y, s, c);
    } else {
      HWY_ALIGN float in[hn::MaxLanes(D())], out[2][hn::MaxLanes(D())];
      hn::Store(y, d, in);
      far_sine_cosine(in, static_cast<size_t>(lanes), out[0], out[1]);
      s = hn::Load(d, out[0]);
      c = hn::Load(d, out[1]);
    }
    V a = w;
    if (variance) {
      // Highway's Exp is defined down to -104; at -88 the result is no normal number any more. What
      // stands in the padding may be below 0 and must stay finite.
      const V exponent = hn::Mul(half_square, hn::Load(d, variance + i));
      a = hn::Mul(w, hn::Exp(d, hn::Clamp(exponent, hn::Set(d, -100.0f), hn::Zero(d))));
    }
    hn::Store(hn::Mul(a, s), d, sine + i);
    hn::Store(hn::Mul(a, c), d, cosine + i);
  }
}

void backward(int64_t n, const float* sine, const float* cosine, const float* d_sine,
              const float* d_cosine, float frequency, float* dx, float* dvariance) {
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  const int64_t end = round_up(n, kLane);
  const V f = hn::Set(d, frequency), half_square = hn::Set(d, -0.5f * frequency * frequency);
  for (int64_t i = 0; i < end; i += lanes) {
    const V s = hn::Load(d, sine + i), c = hn::Load(d, cosine + i);
    const V ds = hn::Load(d, d_sine + i), dc = hn::Load(d, d_cosine + i);
    const V along = hn::NegMulAdd(s, dc, hn::Mul(c, ds));
    hn::Store(hn::MulAdd(f, along, hn::Load(d, dx + i)), d, dx + i);
    if (dvariance) {
      const V damped = hn::MulAdd(s, ds, hn::Mul(c, dc));
      hn::Store(hn::MulAdd(half_square, damped, hn::Load(d, dvariance + i)), d, dvariance + i);
    }
  }
}

// Constants are sqrt((2l+1)(l-|m|)! / (4 pi (l+|m|)!)) times the polynomial's own factor.
void harmonics(int64_t n, const float* direction, int64_t direction_stride, float* code,
               int64_t code_stride) {
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  const int64_t end = round_up(n, kLane);
  const auto set = [](float c) { return hn::Set(D(), c); };
  for (int64_t i = 0; i < end; i += lanes) {
    const V x = hn::Load(d, direction + i);
    const V y = hn::Load(d, direction + direction_stride + i);
    const V z = hn::Load(d, direction + 2 * direction_stride + i);
    const V xx = hn::Mul(x, x), yy = hn::Mul(y, y), zz = hn::Mul(z, z);
    const V xy = hn::Mul(x, y), difference = hn::Sub(xx, yy);
    const V ring = hn::NegMulAdd(set(5.0f), zz, set(1.0f));  // 1 - 5 z^2
    float* out = code + i;
    const auto next = [&](V value) {
      hn::Store(value, d, out);
      out += code_stride;
    };
    next(set(0.28209479177387814f));
    next(hn::Mul(set(-0.48860251190291987f), y));
    next(hn::Mul(set(0.48860251190291987f), z));
    next(hn::Mul(set(-0.48860251190291987f), x));
    next(hn::Mul(set(1.0925484305920792f), xy));
    next(hn::Mul(set(-1.0925484305920792f), hn::Mul(y, z)));
    next(hn::MulAdd(set(0.94617469575755997f), zz, set(-0.31539156525251999f)));
    next(hn::Mul(set(-1.0925484305920792f), hn::Mul(x, z)));
    next(hn::Mul(set(0.54627421529603959f), difference));
    next(hn::Mul(hn::Mul(set(0.59004358992664352f), y), hn::NegMulAdd(set(3.0f), xx, yy)));
    next(hn::Mul(hn::Mul(set(2.8906114426405538f), xy), z));
    next(hn::Mul(hn::Mul(set(0.45704579946446572f), y), ring));
    next(hn::Mul(hn::Mul(set(0.3731763325901154f), z), hn::MulSub(set(5.0f), zz, set(3.0f))));
    next(hn::Mul(hn::Mul(set(0.45704579946446572f), x), ring));
    next(hn::Mul(hn::Mul(set(1.4453057213202769f), z), difference));
    next(hn::Mul(hn::Mul(set(0.59004358992664352f), x), hn::MulSub(set(3.0f), yy, xx)));
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
HWY_EXPORT(harmonics);

void sine_cosine_forward(int64_t n, const float* x, const float* variance, float frequency,
                         float weight, float* sine, float* cosine) {
  HWY_DYNAMIC_DISPATCH(forward)(n, x, variance, frequency, weight, sine, cosine);
}
void sine_cosine_backward(int64_t n, const float* sine, const float* cosine, const float* d_sine,
                          const float* d_cosine, float frequency, float* dx, float* dvariance) {
  HWY_DYNAMIC_DISPATCH(backward)(n, sine, cosine, d_sine, d_cosine, frequency, dx, dvariance);
}
void spherical_harmonics(int64_t n, const float* direction, int64_t direction_stride, float* code,
                         int64_t code_stride) {
  HWY_DYNAMIC_DISPATCH(harmonics)(n, direction, direction_stride, code, code_stride);
}
}  // namespace nerf
#endif
