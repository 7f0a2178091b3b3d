#include <algorithm>

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

// NERF_CASE of the numbers of rows that blocks of both kinds (below) may have on this target.
#undef NERF_EACH_ROW_COUNT
#if HWY_TARGET == HWY_AVX2
#define NERF_EACH_ROW_COUNT NERF_CASE(1) NERF_CASE(2) NERF_CASE(3)
#else
#define NERF_EACH_ROW_COUNT \
  NERF_CASE(1) NERF_CASE(2) NERF_CASE(3) NERF_CASE(4) NERF_CASE(5) NERF_CASE(6)
#endif

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
    NERF_EACH_ROW_COUNT
#if HWY_TARGET != HWY_AVX2
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

// Sums over the lanes of four vectors, as one vector of four.
HWY_INLINE hn::Vec<hn::CappedTag<float, 4>> sums_of_four(V a, V b, V c, V e) {
  const D d;
  const hn::Repartition<double, D> dd;
  // Within each 128-bit block: pairwise sums of a and b, of c and e, then of all four.
  const auto ab = hn::Add(hn::InterleaveLower(d, a, b), hn::InterleaveUpper(d, a, b));
  const auto ce = hn::Add(hn::InterleaveLower(d, c, e), hn::InterleaveUpper(d, c, e));
  const auto ab2 = hn::BitCast(dd, ab), ce2 = hn::BitCast(dd, ce);
  const V all = hn::Add(hn::BitCast(d, hn::InterleaveLower(dd, ab2, ce2)),
                        hn::BitCast(d, hn::InterleaveUpper(dd, ab2, ce2)));
  // Then over the blocks.
#if HWY_TARGET == HWY_AVX3
  const hn::Half<D> d8;
  const auto half = hn::Add(hn::LowerHalf(d8, all), hn::UpperHalf(d8, all));
  const hn::Half<decltype(d8)> d4;
  return hn::Add(hn::LowerHalf(d4, half), hn::UpperHalf(d4, half));
#elif HWY_TARGET == HWY_AVX2
  const hn::Half<D> d4;
  return hn::Add(hn::LowerHalf(d4, all), hn::UpperHalf(d4, all));
#else
  return all;
#endif
}

// Weight gradients: the samples stand in the lanes of both factors, so that nothing is transposed;
// a block of kOuterRows x kOuterColumns sums stays in registers over a chunk's samples.
constexpr int kOuterColumns = 4;
#if HWY_TARGET == HWY_AVX2
constexpr int kOuterRows = 3;
#else
constexpr int kOuterRows = 6;
#endif

// dw[r][0 .. 4) += sum_s dy[r][s] * x[c][s] for R rows; only the first `columns` are stored.
template <int R>
HWY_INLINE void outer_block(const float* HWY_RESTRICT dy, int64_t ld, const float* const* x,
                            int columns, int64_t end, float* HWY_RESTRICT dw, int64_t ldw) {
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  V acc[R][kOuterColumns];
  for (int r = 0; r < R; ++r)
    for (int c = 0; c < kOuterColumns; ++c) acc[r][c] = hn::Zero(d);
  const float* HWY_RESTRICT x0 = x[0];
  const float* HWY_RESTRICT x1 = x[1];
  const float* HWY_RESTRICT x2 = x[2];
  const float* HWY_RESTRICT x3 = x[3];
  for (int64_t s = 0; s < end; s += lanes) {
    const V v0 = hn::Load(d, x0 + s), v1 = hn::Load(d, x1 + s);
    const V v2 = hn::Load(d, x2 + s), v3 = hn::Load(d, x3 + s);
    for (int r = 0; r < R; ++r) {
      const V g = hn::Load(d, dy + r * ld + s);
      acc[r][0] = hn::MulAdd(g, v0, acc[r][0]);
      acc[r][1] = hn::MulAdd(g, v1, acc[r][1]);
      acc[r][2] = hn::MulAdd(g, v2, acc[r][2]);
      acc[r][3] = hn::MulAdd(g, v3, acc[r][3]);
    }
  }
  const hn::CappedTag<float, 4> d4;
  for (int r = 0; r < R; ++r) {
    const auto sum = sums_of_four(acc[r][0], acc[r][1], acc[r][2], acc[r][3]);
    float* to = dw + r * ldw;
    if (columns == kOuterColumns) {
      hn::Store(hn::Add(hn::Load(d4, to), sum), d4, to);
    } else {
      alignas(16) float part[kOuterColumns];
      hn::Store(sum, d4, part);
      for (int c = 0; c < columns; ++c) to[c] += part[c];
    }
  }
}

void outer_rows(int rows, const float* dy, int64_t ld, const float* const* x, int columns,
                int64_t end, float* dw, int64_t ldw) {
  switch (rows) {
#define NERF_CASE(R)                                  \
  case R:                                             \
    outer_block<R>(dy, ld, x, columns, end, dw, ldw); \
    break;
    NERF_EACH_ROW_COUNT
#undef NERF_CASE
    default:
      break;
  }
}

void backward_weights(int in, int out, const float* dy, const float* x, int64_t ld, int64_t n,
                      float* dw, float* dbias) {
  const int64_t ldw = weight_stride(in);
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  const int64_t end = round_up(n, kLane);
  // Rows outside: their block of dy stays in L1 while x passes by.
  int r = 0;
  while (r < out) {
    const int rows = std::min(kOuterRows, out - r);
    const float* g = dy + r * ld;
    for (int k = 0; k < in; k += kOuterColumns) {
      const int columns = std::min(kOuterColumns, in - k);
      const float* from[kOuterColumns];  // past the last column: the last again, not stored
      for (int c = 0; c < kOuterColumns; ++c) from[c] = x + std::min(k + c, in - 1) * ld;
      outer_rows(rows, g, ld, from, columns, end, dw + r * ldw + k, ldw);
    }
    r += rows;
  }
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
void linear_backward_weights(int in, int out, const float* dy, const float* x, int64_t ld,
                             int64_t n, float* dw, float* dbias) {
  HWY_DYNAMIC_DISPATCH(backward_weights)(in, out, dy, x, ld, n, dw, dbias);
}
void relu_backward(int rows, const float* y, float* dy, int64_t ld, int64_t n) {
  HWY_DYNAMIC_DISPATCH(relu_mask)(rows, y, dy, ld, n);
}
}  // namespace nerf
#endif
