#include <algorithm>
#include <cstring>

#include "nerf/base/aligned.h"
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
// a[r * a_row + k * a_col]: rows of W forward, columns of W backward. With `resume` the sums begin
// with what stands in out: a deep sum in parts, of the same bits as in one.
template <int R, int NV, Epilogue kEpilogue>
HWY_INLINE void block(const float* HWY_RESTRICT a, int64_t a_row, int64_t a_col,
                      const float* HWY_RESTRICT b, int depth, int64_t ld,
                      const float* HWY_RESTRICT bias, bool resume, const float* HWY_RESTRICT mask,
                      float* HWY_RESTRICT out) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  V acc[R][NV];
  if (resume) {
    for (int r = 0; r < R; ++r)
      for (int v = 0; v < NV; ++v) acc[r][v] = hn::Load(d, out + r * ld + v * lanes);
  } else {
    for (int r = 0; r < R; ++r)
      for (int v = 0; v < NV; ++v) acc[r][v] = bias ? hn::Set(d, bias[r]) : hn::Zero(d);
  }
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
                               bool resume, const float* mask, float* out) {
  switch (rows) {
#define NERF_CASE(R)                                                                 \
  case R:                                                                            \
    block<R, NV, kEpilogue>(a, a_row, a_col, b, depth, ld, bias, resume, mask, out); \
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

// The matrix that multiply() takes its rows from. Blocks of kRows rows: block i begins at
// a + i * block, its row r and column k at r * row + k * column.
struct Rows {
  const float* a;
  int64_t block, row, column;
  Rows from_column(int k) const { return {a + k * column, block, row, column}; }
};

// One strip of NV vectors of samples through all rows: the strip of b stays in L1 meanwhile.
template <int NV, Epilogue kEpilogue>
void strip(int rows, const Rows& w, const float* b, int depth, int64_t ld, const float* bias,
           bool resume, const float* mask, float* out) {
  int r = 0;
  const float* a = w.a;
  for (; r + kRows <= rows; r += kRows, a += w.block)
    block<kRows, NV, kEpilogue>(a, w.row, w.column, b, depth, ld, bias ? bias + r : nullptr, resume,
                                mask ? mask + r * ld : nullptr, out + r * ld);
  rows_remainder<NV, kEpilogue>(rows - r, a, w.row, w.column, b, depth, ld,
                                bias ? bias + r : nullptr, resume, mask ? mask + r * ld : nullptr,
                                out + r * ld);
}

// A strip of more depth than this leaves no room for anything else in a first-level cache of 32 KB.
constexpr int kMostDepth =
    26 * 1024 / static_cast<int>(kVectors * hn::MaxLanes(D()) * sizeof(float));

template <int NV, Epilogue kEpilogue>
void deep_strip(int rows, const Rows& w, const float* b, int depth, int64_t ld, const float* bias,
                const float* mask, float* out) {
  const int parts = (depth + kMostDepth - 1) / kMostDepth;
  for (int p = 0; p + 1 < parts; ++p) {
    const int k = depth * p / parts, end = depth * (p + 1) / parts;
    strip<NV, Epilogue::kNone>(rows, w.from_column(k), b + k * ld, end - k, ld, bias, p > 0,
                               nullptr, out);
  }
  const int k = parts > 1 ? depth * (parts - 1) / parts : 0;
  strip<NV, kEpilogue>(rows, w.from_column(k), b + k * ld, depth - k, ld, bias, parts > 1, mask,
                       out);
}

template <Epilogue kEpilogue>
void multiply(int rows, const Rows& w, const float* b, int depth, int64_t ld, int64_t n,
              const float* bias, const float* mask, float* out) {
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(D()));
  const int64_t end = round_up(n, kLane);
  int64_t s = 0;
  const auto m = [&](int64_t at) { return mask ? mask + at : nullptr; };
  for (; s + kVectors * lanes <= end; s += kVectors * lanes)
    deep_strip<kVectors, kEpilogue>(rows, w, b + s, depth, ld, bias, m(s), out + s);
  if (end - s >= 2 * lanes) {
    deep_strip<2, kEpilogue>(rows, w, b + s, depth, ld, bias, m(s), out + s);
    s += 2 * lanes;
  }
  for (; s < end; s += lanes)
    deep_strip<1, kEpilogue>(rows, w, b + s, depth, ld, bias, m(s), out + s);
}

void forward(int in, int out, const float* w, const float* bias, const float* x, float* y,
             int64_t ld, int64_t n, LinearActivation activation) {
  const int64_t ldw = weight_stride(in);
  const Rows rows{w, kRows * ldw, ldw, 1};
  if (activation == LinearActivation::kRelu)
    multiply<Epilogue::kRelu>(out, rows, x, in, ld, n, bias, nullptr, y);
  else
    multiply<Epilogue::kNone>(out, rows, x, in, ld, n, bias, nullptr, y);
}

// Both widths from here on: layers that take other ways (measured: nerf_bench kernels).
constexpr int kWide = 96;

// Columns of w in blocks of kRows, each block column by column: what a step of block() reads stands
// together. In w itself every step is a cache line further, in a wide layer all in a few sets.
Rows packed_columns(int in, int out, const float* w) {
  thread_local AlignedArray<float> packed;
  const int64_t ldw = weight_stride(in), blocks = (in + kRows - 1) / kRows;
  const size_t size = static_cast<size_t>(blocks * kRows) * static_cast<size_t>(out);
  if (packed.size() < size) packed = AlignedArray<float>(size);
  // A cache line of w at a time; the last blocks reach into its padding, which is 0.
  constexpr int64_t kAtOnce = kLane / kRows;
  for (int64_t i = 0; i < blocks; i += kAtOnce)
    for (int j = 0; j < out; ++j)
      for (int64_t b = i; b < std::min(blocks, i + kAtOnce); ++b)
        std::memcpy(packed.data() + (b * out + j) * kRows, w + j * ldw + b * kRows,
                    kRows * sizeof(float));
  return {packed.data(), int64_t{out} * kRows, 1, kRows};
}

void backward_input(int in, int out, const float* w, const float* dy, float* dx, int64_t ld,
                    int64_t n, const float* relu_output) {
  if (n <= 0) return;
  const Rows rows = in >= kWide && out >= kWide ? packed_columns(in, out, w)
                                                : Rows{w, kRows, 1, weight_stride(in)};
  if (relu_output)
    multiply<Epilogue::kMask>(in, rows, dy, out, ld, n, nullptr, relu_output, dx);
  else
    multiply<Epilogue::kNone>(in, rows, dy, out, ld, n, nullptr, nullptr, dx);
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

// Wide layers: x is transposed panel by panel, so that the sums stand in the lanes and nothing is
// left to add up at the end; what the transposition costs is spread over many rows.
constexpr int kPanelSamples = 192;  // the panel stays in the first-level cache

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
      outer_rows(rows, g, ld, from, columns, end, dw + r * ldw + k, ldw);
    }
    r += rows;
  }
}

void backward_weights(int in, int out, const float* dy, const float* x, int64_t ld, int64_t n,
                      float* dw, float* dbias) {
  const int64_t ldw = weight_stride(in);
  const D d;
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(d));
  const int64_t end = round_up(n, kLane);
  if (in >= kWide && out >= kWide)
    backward_wide_weights(in, out, dy, x, ld, end, dw, ldw);
  else
    backward_narrow_weights(in, out, dy, x, ld, end, dw, ldw);
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
