// Weight gradients of linear layers; linear_simd.cc has the other two products.
#include <algorithm>

#include "nerf/kernels/linear.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/linear_weights_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include "kernels/linear_blocks-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

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

// dw[r][0 .. 4) += sum_s dy[r][s] * x[c][s] for R rows; only the first `columns` are stored. With
// kAsk the columns behind these, which the next block reads, are asked for.
template <int R, bool kAsk>
HWY_INLINE void outer_block(const float* HWY_RESTRICT dy, int64_t ld, const float* const* x,
                            int columns, int64_t end, float* HWY_RESTRICT dw, int64_t ldw) {
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  V acc[R][kOuterColumns];
  unrolled<R>([&](auto r) NERF_INLINE {
    unrolled<kOuterColumns>([&](auto c) NERF_INLINE { acc[r][c] = hn::Zero(d); });
  });
  const float* HWY_RESTRICT x0 = x[0];
  const float* HWY_RESTRICT x1 = x[1];
  const float* HWY_RESTRICT x2 = x[2];
  const float* HWY_RESTRICT x3 = x[3];
  for (int64_t s = 0; s < end; s += lanes) {
    if constexpr (kAsk) {
      for (int c = 0; c < kOuterColumns; ++c)
        __builtin_prefetch(x0 + (kOuterColumns + c) * ld + s, 0, 3);
    }
    const V v0 = hn::Load(d, x0 + s), v1 = hn::Load(d, x1 + s);
    const V v2 = hn::Load(d, x2 + s), v3 = hn::Load(d, x3 + s);
    unrolled<R>([&](auto r) NERF_INLINE {
      const V g = hn::Load(d, dy + r * ld + s);
      acc[r][0] = hn::MulAdd(g, v0, acc[r][0]);
      acc[r][1] = hn::MulAdd(g, v1, acc[r][1]);
      acc[r][2] = hn::MulAdd(g, v2, acc[r][2]);
      acc[r][3] = hn::MulAdd(g, v3, acc[r][3]);
    });
  }
  const hn::CappedTag<float, 4> d4;
  unrolled<R>([&](auto r) NERF_INLINE {
    const auto sum = sums_of_four(acc[r][0], acc[r][1], acc[r][2], acc[r][3]);
    float* to = dw + r * ldw;
    if (columns == kOuterColumns) {
      hn::Store(hn::Add(hn::Load(d4, to), sum), d4, to);
    } else {
      alignas(16) float part[kOuterColumns];
      hn::Store(sum, d4, part);
      for (int c = 0; c < columns; ++c) to[c] += part[c];
    }
  });
}

template <bool kAsk>
void outer_rows(int rows, const float* dy, int64_t ld, const float* const* x, int columns,
                int64_t end, float* dw, int64_t ldw) {
  switch (rows) {
#define NERF_CASE(R)                                        \
  case R:                                                   \
    outer_block<R, kAsk>(dy, ld, x, columns, end, dw, ldw); \
    break;
    NERF_EACH_ROW_COUNT
#undef NERF_CASE
    default:
      break;
  }
}

// Wide layers: x is transposed panel by panel, so that the sums stand in the lanes and nothing is
// left to add up at the end; what the transposition costs is spread over many rows.
constexpr int kPanelSamples = 512;  // the panel stays in the first-level cache

// panel[s][c] = x[c][s] for `columns` rows of x (0 beyond) and `samples` samples, multiples of 4
// and kLane; `width` floats from one sample to the next.
HWY_INLINE void transpose_panel(const float* HWY_RESTRICT x, int64_t ld, int columns, int width,
                                int64_t samples, float* HWY_RESTRICT panel) {
  const D d;
  const hn::Repartition<double, D> dd;
  const hn::CappedTag<float, 4> d4;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  HWY_ALIGN float parts[4][hn::MaxLanes(D())];
  for (int c = 0; c < width; c += 4) {
    for (int64_t s = 0; s < samples; s += lanes) {
      V row[4];
      for (int i = 0; i < 4; ++i)
        row[i] = c + i < columns ? hn::Load(d, x + (c + i) * ld + s) : hn::Zero(d);
      // 4 x 4 blocks, each within 128 bits.
      const auto ab = hn::BitCast(dd, hn::InterleaveLower(d, row[0], row[1]));
      const auto ab2 = hn::BitCast(dd, hn::InterleaveUpper(d, row[0], row[1]));
      const auto ce = hn::BitCast(dd, hn::InterleaveLower(d, row[2], row[3]));
      const auto ce2 = hn::BitCast(dd, hn::InterleaveUpper(d, row[2], row[3]));
      hn::Store(hn::BitCast(d, hn::InterleaveLower(dd, ab, ce)), d, parts[0]);
      hn::Store(hn::BitCast(d, hn::InterleaveUpper(dd, ab, ce)), d, parts[1]);
      hn::Store(hn::BitCast(d, hn::InterleaveLower(dd, ab2, ce2)), d, parts[2]);
      hn::Store(hn::BitCast(d, hn::InterleaveUpper(dd, ab2, ce2)), d, parts[3]);
      for (int64_t block = 0; block < lanes; block += 4)
        for (int64_t i = 0; i < 4; ++i)
          hn::Store(hn::Load(d4, parts[i] + block), d4, panel + (s + block + i) * width + c);
    }
  }
}

// dw[r][0 .. NV vectors) += sum_s dy[r][s] * panel[s][.] for R rows.
template <int R, int NV>
HWY_INLINE void panel_block(const float* HWY_RESTRICT dy, int64_t ld,
                            const float* HWY_RESTRICT panel, int64_t samples,
                            float* HWY_RESTRICT dw, int64_t ldw) {
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  V acc[R][NV];
  for (int r = 0; r < R; ++r)
    for (int v = 0; v < NV; ++v) acc[r][v] = hn::Load(d, dw + r * ldw + v * lanes);
  for (int64_t s = 0; s < samples; ++s) {
    V x[NV];
    for (int v = 0; v < NV; ++v) x[v] = hn::Load(d, panel + s * NV * lanes + v * lanes);
    for (int r = 0; r < R; ++r) {
      const V g = hn::Set(d, dy[r * ld + s]);
      for (int v = 0; v < NV; ++v) acc[r][v] = hn::MulAdd(g, x[v], acc[r][v]);
    }
  }
  for (int r = 0; r < R; ++r)
    for (int v = 0; v < NV; ++v) hn::Store(acc[r][v], d, dw + r * ldw + v * lanes);
}

template <int NV>
void panel_rows(int out, const float* dy, int64_t ld, const float* panel, int64_t samples,
                float* dw, int64_t ldw) {
  int r = 0;
  for (; r + kRows <= out; r += kRows)
    panel_block<kRows, NV>(dy + r * ld, ld, panel, samples, dw + r * ldw, ldw);
  for (; r < out; ++r) panel_block<1, NV>(dy + r * ld, ld, panel, samples, dw + r * ldw, ldw);
}

void backward_wide_weights(int in, int out, const float* dy, const float* x, int64_t ld,
                           int64_t end, float* dw, int64_t ldw) {
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(D()));
  HWY_ALIGN float panel[kPanelSamples * kVectors * hn::MaxLanes(D())];
  for (int64_t s = 0; s < end; s += kPanelSamples) {
    const int64_t samples = std::min<int64_t>(kPanelSamples, end - s);
    // ldw is a multiple of kLane, and so of the lanes.
    for (int64_t k = 0; k < ldw;) {
      const int vectors = static_cast<int>(std::min<int64_t>(kVectors, (ldw - k) / lanes));
      const int width = vectors * static_cast<int>(lanes);
      transpose_panel(x + k * ld + s, ld, in - static_cast<int>(k), width, samples, panel);
      switch (vectors) {
        case 3:
          panel_rows<3>(out, dy + s, ld, panel, samples, dw + k, ldw);
          break;
        case 2:
          panel_rows<2>(out, dy + s, ld, panel, samples, dw + k, ldw);
          break;
        default:
          panel_rows<1>(out, dy + s, ld, panel, samples, dw + k, ldw);
      }
      k += width;
    }
  }
}

void backward_narrow_weights(int in, int out, const float* dy, const float* x, int64_t ld,
                             int64_t end, float* dw, int64_t ldw) {
  // Rows outside: their block of dy stays in L1 while x passes by.
  int r = 0;
  while (r < out) {
    const int rows = std::min(kOuterRows, out - r);
    const float* g = dy + r * ld;
    for (int k = 0; k < in; k += kOuterColumns) {
      const int columns = std::min(kOuterColumns, in - k);
      const float* from[kOuterColumns];  // past the last column: the last again, not stored
      for (int c = 0; c < kOuterColumns; ++c) from[c] = x + std::min(k + c, in - 1) * ld;
      (r == 0 && k + kOuterColumns < in
           ? outer_rows<true>
           : outer_rows<false>)(rows, g, ld, from, columns, end, dw + r * ldw + k, ldw);
    }
    r += rows;
  }
}

void backward_bias(int out, const float* dy, int64_t ld, int64_t n, float* dbias) {
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  const int64_t end = round_up(n, kLane);
  for (int j = 0; j < out; ++j) {
    V sum = hn::Zero(d);
    for (int64_t s = 0; s < end; s += lanes) sum = hn::Add(sum, hn::Load(d, dy + j * ld + s));
    dbias[j] += hn::GetLane(hn::SumOfLanes(d, sum));
  }
}

void backward_weights(int in, int out, const float* dy, const float* x, int64_t ld, int64_t n,
                      float* dw, float* dbias) {
  const int64_t ldw = weight_stride(in);
  const int64_t end = round_up(n, kLane);
  if (is_wide(in, out))
    backward_wide_weights(in, out, dy, x, ld, end, dw, ldw);
  else
    backward_narrow_weights(in, out, dy, x, ld, end, dw, ldw);
  if (dbias) backward_bias(out, dy, ld, n, dbias);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace nerf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace nerf {
HWY_EXPORT(backward_bias);
HWY_EXPORT(backward_weights);

void linear_backward_bias(int out, const float* dy, int64_t ld, int64_t n, float* dbias) {
  HWY_DYNAMIC_DISPATCH(backward_bias)(out, dy, ld, n, dbias);
}
void linear_backward_weights(int in, int out, const float* dy, const float* x, int64_t ld,
                             int64_t n, float* dw, float* dbias) {
  HWY_DYNAMIC_DISPATCH(backward_weights)(in, out, dy, x, ld, n, dw, dbias);
}
}  // namespace nerf
#endif
