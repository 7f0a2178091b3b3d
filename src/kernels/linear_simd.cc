#include "nerf/kernels/linear.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/linear_simd.cc"
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

// Register blocks: kRows x 3 vectors of accumulators, so that the loads of a step (3 vectors and
// kRows broadcasts) stay below its multiply-adds. 16 vector registers on AVX2, 32 on AVX-512 and
// NEON.
#if HWY_TARGET == HWY_AVX2
constexpr int kRows = 4;
#else
constexpr int kRows = 8;
#endif
constexpr int kVectors = 3;

enum class Epilogue { kNone, kRelu, kMask };

// out[r][s] = sum_k a(r, k) * b[k][s] for R rows and NV vectors of samples. a(r, k) stands at
// a[r * a_row + k * a_col]: rows of W forward, columns of W backward.
template <int R, int NV, Epilogue kEpilogue>
HWY_INLINE void block(const float* HWY_RESTRICT a, int64_t a_row, int64_t a_col,
                      const float* HWY_RESTRICT b, int depth, int64_t ld,
                      const float* HWY_RESTRICT bias, const float* HWY_RESTRICT mask,
                      float* HWY_RESTRICT out) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  V acc[R][NV];
  for (int r = 0; r < R; ++r)
    for (int v = 0; v < NV; ++v) acc[r][v] = bias ? hn::Set(d, bias[r]) : hn::Zero(d);
  for (int k = 0; k < depth; ++k) {
    V x[NV];
    for (int v = 0; v < NV; ++v) x[v] = hn::Load(d, b + k * ld + v * lanes);
    for (int r = 0; r < R; ++r) {
      const V w = hn::Set(d, a[r * a_row + k * a_col]);
      for (int v = 0; v < NV; ++v) acc[r][v] = hn::MulAdd(w, x[v], acc[r][v]);
    }
  }
  for (int r = 0; r < R; ++r)
    for (int v = 0; v < NV; ++v) {
      V y = acc[r][v];
      if constexpr (kEpilogue == Epilogue::kRelu) y = hn::Max(y, hn::Zero(d));
      if constexpr (kEpilogue == Epilogue::kMask) {
        const V m = hn::Load(d, mask + r * ld + v * lanes);
        y = hn::IfThenElseZero(hn::Gt(m, hn::Zero(d)), y);
      }
      hn::Store(y, d, out + r * ld + v * lanes);
    }
}

template <int NV, Epilogue kEpilogue>
HWY_INLINE void rows_remainder(int rows, const float* a, int64_t a_row, int64_t a_col,
                               const float* b, int depth, int64_t ld, const float* bias,
                               const float* mask, float* out) {
  switch (rows) {
#define NERF_CASE(R)                                                         \
  case R:                                                                    \
    block<R, NV, kEpilogue>(a, a_row, a_col, b, depth, ld, bias, mask, out); \
    break;
    NERF_CASE(1)
    NERF_CASE(2)
    NERF_CASE(3)
#if HWY_TARGET != HWY_AVX2
    NERF_CASE(4)
    NERF_CASE(5)
    NERF_CASE(6)
    NERF_CASE(7)
#endif
#undef NERF_CASE
    default:
      break;
  }
}

// One strip of NV vectors of samples through all rows: the strip of b stays in L1 meanwhile.
template <int NV, Epilogue kEpilogue>
void strip(int rows, const float* a, int64_t a_row, int64_t a_col, const float* b, int depth,
           int64_t ld, const float* bias, const float* mask, float* out) {
  int r = 0;
  for (; r + kRows <= rows; r += kRows)
    block<kRows, NV, kEpilogue>(a + r * a_row, a_row, a_col, b, depth, ld,
                                bias ? bias + r : nullptr, mask ? mask + r * ld : nullptr,
                                out + r * ld);
  rows_remainder<NV, kEpilogue>(rows - r, a + r * a_row, a_row, a_col, b, depth, ld,
                                bias ? bias + r : nullptr, mask ? mask + r * ld : nullptr,
                                out + r * ld);
}

template <Epilogue kEpilogue>
void multiply(int rows, const float* a, int64_t a_row, int64_t a_col, const float* b, int depth,
              int64_t ld, int64_t n, const float* bias, const float* mask, float* out) {
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(D()));
  const int64_t end = round_up(n, kLane);
  int64_t s = 0;
  const auto m = [&](int64_t at) { return mask ? mask + at : nullptr; };
  for (; s + kVectors * lanes <= end; s += kVectors * lanes)
    strip<kVectors, kEpilogue>(rows, a, a_row, a_col, b + s, depth, ld, bias, m(s), out + s);
  if (end - s >= 2 * lanes) {
    strip<2, kEpilogue>(rows, a, a_row, a_col, b + s, depth, ld, bias, m(s), out + s);
    s += 2 * lanes;
  }
  for (; s < end; s += lanes)
    strip<1, kEpilogue>(rows, a, a_row, a_col, b + s, depth, ld, bias, m(s), out + s);
}

void forward(int in, int out, const float* w, const float* bias, const float* x, float* y,
             int64_t ld, int64_t n, LinearActivation activation) {
  const int64_t ldw = weight_stride(in);
  if (activation == LinearActivation::kRelu)
    multiply<Epilogue::kRelu>(out, w, ldw, 1, x, in, ld, n, bias, nullptr, y);
  else
    multiply<Epilogue::kNone>(out, w, ldw, 1, x, in, ld, n, bias, nullptr, y);
}

void backward_input(int in, int out, const float* w, const float* dy, float* dx, int64_t ld,
                    int64_t n, const float* relu_output) {
  const int64_t ldw = weight_stride(in);
  if (relu_output)
    multiply<Epilogue::kMask>(in, w, 1, ldw, dy, out, ld, n, nullptr, relu_output, dx);
  else
    multiply<Epilogue::kNone>(in, w, 1, ldw, dy, out, ld, n, nullptr, nullptr, dx);
}

// 8x8 transposes in 256-bit vectors on every target (two 128-bit halves where those are the
// widest).
void transpose(int in, const float* x, int64_t ld, int64_t n, float* xt) {
  const int64_t ldt = weight_stride(in);
  const int64_t end = round_up(n, kLane);
  const hn::CappedTag<float, 4> d4;
  for (int64_t k = 0; k < ldt; k += 4) {
    if (k + 4 <= in) {
      const float* r0 = x + k * ld;
      for (int64_t s = 0; s < end; s += 4) {
        // 4x4: rows k..k+3, samples s..s+3.
        const auto a = hn::Load(d4, r0 + s);
        const auto b = hn::Load(d4, r0 + ld + s);
        const auto c = hn::Load(d4, r0 + 2 * ld + s);
        const auto e = hn::Load(d4, r0 + 3 * ld + s);
        const hn::Repartition<double, decltype(d4)> dd;
        const auto ab_lo = hn::BitCast(dd, hn::InterleaveLower(d4, a, b));
        const auto ab_hi = hn::BitCast(dd, hn::InterleaveUpper(d4, a, b));
        const auto ce_lo = hn::BitCast(dd, hn::InterleaveLower(d4, c, e));
        const auto ce_hi = hn::BitCast(dd, hn::InterleaveUpper(d4, c, e));
        float* to = xt + s * ldt + k;
        hn::Store(hn::BitCast(d4, hn::InterleaveLower(dd, ab_lo, ce_lo)), d4, to);
        hn::Store(hn::BitCast(d4, hn::InterleaveUpper(dd, ab_lo, ce_lo)), d4, to + ldt);
        hn::Store(hn::BitCast(d4, hn::InterleaveLower(dd, ab_hi, ce_hi)), d4, to + 2 * ldt);
        hn::Store(hn::BitCast(d4, hn::InterleaveUpper(dd, ab_hi, ce_hi)), d4, to + 3 * ldt);
      }
    } else {
      for (int64_t s = 0; s < end; ++s)
        for (int64_t c = k; c < k + 4; ++c) xt[s * ldt + c] = c < in ? x[c * ld + s] : 0.0f;
    }
  }
}

// dw[r][0 .. NV vectors) += sum_s dy[r][s] * xt[s][...] for R rows.
template <int R, int NV>
HWY_INLINE void outer_block(const float* HWY_RESTRICT dy, int64_t ld, const float* HWY_RESTRICT xt,
                            int64_t ldt, int64_t end, float* HWY_RESTRICT dw) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  V acc[R][NV];
  for (int r = 0; r < R; ++r)
    for (int v = 0; v < NV; ++v) acc[r][v] = hn::Load(d, dw + r * ldt + v * lanes);
  for (int64_t s = 0; s < end; ++s) {
    V x[NV];
    for (int v = 0; v < NV; ++v) x[v] = hn::Load(d, xt + s * ldt + v * lanes);
    for (int r = 0; r < R; ++r) {
      const V g = hn::Set(d, dy[r * ld + s]);
      for (int v = 0; v < NV; ++v) acc[r][v] = hn::MulAdd(g, x[v], acc[r][v]);
    }
  }
  for (int r = 0; r < R; ++r)
    for (int v = 0; v < NV; ++v) hn::Store(acc[r][v], d, dw + r * ldt + v * lanes);
}

#if HWY_TARGET == HWY_AVX2
constexpr int kOuterRows = 3;
#else
constexpr int kOuterRows = 6;
#endif

template <int NV>
void outer_columns(int rows, const float* dy, int64_t ld, const float* xt, int64_t ldt, int64_t end,
                   float* dw) {
  int r = 0;
  for (; r + kOuterRows <= rows; r += kOuterRows)
    outer_block<kOuterRows, NV>(dy + r * ld, ld, xt, ldt, end, dw + r * ldt);
  for (; r + 2 <= rows; r += 2) outer_block<2, NV>(dy + r * ld, ld, xt, ldt, end, dw + r * ldt);
  for (; r < rows; ++r) outer_block<1, NV>(dy + r * ld, ld, xt, ldt, end, dw + r * ldt);
}

void backward_weights(int in, int out, const float* dy, const float* xt, int64_t ld, int64_t n,
                      float* dw, float* dbias) {
  const int64_t ldt = weight_stride(in);
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  const int64_t end = round_up(n, kLane);
  int64_t k = 0;
  for (; k + 4 * lanes <= ldt; k += 4 * lanes)
    outer_columns<4>(out, dy, ld, xt + k, ldt, end, dw + k);
  if (k + 2 * lanes <= ldt) {
    outer_columns<2>(out, dy, ld, xt + k, ldt, end, dw + k);
    k += 2 * lanes;
  }
  for (; k < ldt; k += lanes) outer_columns<1>(out, dy, ld, xt + k, ldt, end, dw + k);
  if (dbias) {
    for (int j = 0; j < out; ++j) {
      V sum = hn::Zero(d);
      for (int64_t s = 0; s < end; s += lanes) sum = hn::Add(sum, hn::Load(d, dy + j * ld + s));
      dbias[j] += hn::GetLane(hn::SumOfLanes(d, sum));
    }
  }
}

void relu_mask(int rows, const float* y, float* dy, int64_t ld, int64_t n) {
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  const int64_t end = round_up(n, kLane);
  for (int r = 0; r < rows; ++r)
    for (int64_t s = 0; s < end; s += lanes) {
      const V m = hn::Load(d, y + r * ld + s);
      hn::Store(hn::IfThenElseZero(hn::Gt(m, hn::Zero(d)), hn::Load(d, dy + r * ld + s)), d,
                dy + r * ld + s);
    }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(forward);
HWY_EXPORT(backward_input);
HWY_EXPORT(transpose);
HWY_EXPORT(backward_weights);
HWY_EXPORT(relu_mask);

void linear_forward(int in, int out, const float* w, const float* bias, const float* x, float* y,
                    int64_t ld, int64_t n, LinearActivation activation) {
  HWY_DYNAMIC_DISPATCH(forward)(in, out, w, bias, x, y, ld, n, activation);
}
void linear_backward_input(int in, int out, const float* w, const float* dy, float* dx, int64_t ld,
                           int64_t n, const float* relu_output) {
  HWY_DYNAMIC_DISPATCH(backward_input)(in, out, w, dy, dx, ld, n, relu_output);
}
void transpose_to_samples(int in, const float* x, int64_t ld, int64_t n, float* xt) {
  HWY_DYNAMIC_DISPATCH(transpose)(in, x, ld, n, xt);
}
void linear_backward_weights(int in, int out, const float* dy, const float* xt, int64_t ld,
                             int64_t n, float* dw, float* dbias) {
  HWY_DYNAMIC_DISPATCH(backward_weights)(in, out, dy, xt, ld, n, dw, dbias);
}
void relu_backward(int rows, const float* y, float* dy, int64_t ld, int64_t n) {
  HWY_DYNAMIC_DISPATCH(relu_mask)(rows, y, dy, ld, n);
}
}  // namespace nerf
#endif
