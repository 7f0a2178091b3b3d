#include <algorithm>
#include <cstring>

#include "nerf/base/aligned.h"
#include "nerf/kernels/linear.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/linear_simd.cc"
// clang-format off: foreach_target.h must come first
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include "kernels/linear_blocks-inl.h"
// clang-format on

HWY_BEFORE_NAMESPACE();
namespace nerf {
namespace HWY_NAMESPACE {
namespace {

// Fewer steps than that are over before memory has answered.
constexpr int kDeepEnough = 32;

enum class Epilogue { kNone, kRelu, kMask };

// out[r][s] = sum_k a(r, k) * b[k][s] for R rows and NV vectors of samples. a(r, k) stands at
// a[r * a_row + k * a_col]: rows of W forward, columns of W backward. With `resume` the sums begin
// with what stands in out: a deep sum in parts, of the same bits as in one. The first block of a
// strip (kFirst) asks for the next strip of b.
template <int R, int NV, Epilogue kEpilogue, bool kFirst = false>
HWY_INLINE void block(const float* HWY_RESTRICT a, int64_t a_row, int64_t a_col,
                      const float* HWY_RESTRICT b, int depth, int64_t ld,
                      const float* HWY_RESTRICT bias, bool resume, const float* HWY_RESTRICT mask,
                      float* HWY_RESTRICT out) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  // What the end reads and writes comes from further caches while the sums are made.
  if (depth >= kDeepEnough) {
    const float *y = out, *m = mask;
    for (int r = 0; r < R; ++r, y += ld, m += kEpilogue == Epilogue::kMask ? ld : 0)
      for (size_t v = 0; v < NV * lanes; v += kLane) {
        __builtin_prefetch(y + v, 1, 3);
        if constexpr (kEpilogue == Epilogue::kMask) __builtin_prefetch(m + v, 0, 3);
      }
  }
  V acc[R][NV];
  const auto each = [](const auto& body) NERF_INLINE {
    unrolled<R>([&](auto r) NERF_INLINE { unrolled<NV>([&](auto v) NERF_INLINE { body(r, v); }); });
  };
  if (resume)
    each([&](auto r, auto v) NERF_INLINE { acc[r][v] = hn::Load(d, out + r * ld + v * lanes); });
  else if (bias)
    each([&](auto r, auto v) NERF_INLINE { acc[r][v] = hn::Set(d, bias[r]); });
  else
    each([&](auto r, auto v) NERF_INLINE { acc[r][v] = hn::Zero(d); });
  for (int k = 0; k < depth; ++k) {
    V x[NV];
    unrolled<NV>([&](auto v) NERF_INLINE { x[v] = hn::Load(d, b + k * ld + v * lanes); });
    if constexpr (kFirst)
      for (size_t v = 0; v < NV * lanes; v += kLane)
        __builtin_prefetch(b + k * ld + NV * lanes + v, 0, 3);
    unrolled<R>([&](auto r) NERF_INLINE {
      const V w = hn::Set(d, a[r * a_row + k * a_col]);
      unrolled<NV>([&](auto v) NERF_INLINE { acc[r][v] = hn::MulAdd(w, x[v], acc[r][v]); });
    });
  }
  unrolled<R>([&](auto r) NERF_INLINE {
    unrolled<NV>([&](auto v) NERF_INLINE {
      V y = acc[r][v];
      if constexpr (kEpilogue == Epilogue::kRelu) y = hn::Max(y, hn::Zero(d));
      if constexpr (kEpilogue == Epilogue::kMask)
        y = hn::IfThenElseZero(hn::Gt(hn::Load(d, mask + v * lanes), hn::Zero(d)), y);
      hn::Store(y, d, out + v * lanes);
    });
    out += ld;
    if constexpr (kEpilogue == Epilogue::kMask) mask += ld;
  });
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

// One strip of NV vectors of samples through all rows: the strip of b stays in L1 meanwhile. On its
// own: within its caller, compilers run out of registers for addresses.
template <int NV, Epilogue kEpilogue>
HWY_NOINLINE void strip(int rows, const Rows& w, const float* b, int depth, int64_t ld,
                        const float* bias, bool resume, const float* mask, float* out) {
  int r = 0;
  const float* a = w.a;
  if (rows >= kRows) {
    block<kRows, NV, kEpilogue, true>(a, w.row, w.column, b, depth, ld, bias, resume, mask, out);
    r += kRows;
    a += w.block;
  }
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

// All strips through some rows.
template <Epilogue kEpilogue>
void multiply_rows(int rows, const Rows& w, const float* b, int depth, int64_t ld, int64_t n,
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

// A pack: w in blocks of kRows columns, each block row by row, then w in blocks of kRows rows, each
// block column by column, so that what a step of block() reads stands together. In w itself every
// step is a cache line further, in a wide layer all in a few sets. 0 beyond the last row and
// column.
constexpr int kMostRows = 8;  // kRows of the target with the largest blocks
static_assert(kMostRows % kRows == 0);
int64_t packed_columns_size(int in, int out) { return round_up(in, kMostRows) * round_up(out, 2); }
int64_t packed_rows_size(int in, int out) { return packed_columns_size(out, in); }
int64_t pack_size(int in, int out) {
  return is_wide(in, out) ? packed_columns_size(in, out) + packed_rows_size(in, out) : 0;
}

void pack_rows(int in, int out, const float* w, float* packed) {
  const int64_t ldw = weight_stride(in);
  for (int j = 0; j < out; j += kRows, packed += int64_t{kRows} * in)
    for (int r = 0; r < kRows; ++r)
      for (int k = 0; k < in; ++k) packed[k * kRows + r] = j + r < out ? w[(j + r) * ldw + k] : 0;
}

void pack_columns(int in, int out, const float* w, float* packed) {
  const int64_t ldw = weight_stride(in), blocks = (in + kRows - 1) / kRows;
  // A cache line of w at a time; the last blocks reach into its padding, which is 0.
  constexpr int64_t kAtOnce = kLane / kRows;
  for (int64_t i = 0; i < blocks; i += kAtOnce)
    for (int j = 0; j < out; ++j)
      for (int64_t b = i; b < std::min(blocks, i + kAtOnce); ++b)
        std::memcpy(packed + (b * out + j) * kRows, w + j * ldw + b * kRows, kRows * sizeof(float));
}

void pack(int in, int out, const float* w, float* packed) {
  if (!is_wide(in, out)) return;
  pack_columns(in, out, w, packed);
  pack_rows(in, out, w, packed + packed_columns_size(in, out));
}

Rows columns_of(int in, int out, const float* w, const float* packed) {
  if (!is_wide(in, out)) return {w, kRows, 1, weight_stride(in)};
  thread_local AlignedArray<float> own;
  if (!packed) {
    const size_t size = static_cast<size_t>(packed_columns_size(in, out));
    if (own.size() < size) own = AlignedArray<float>(size);
    pack_columns(in, out, w, own.data());
    packed = own.data();
  }
  return {packed, int64_t{out} * kRows, 1, kRows};
}

Rows rows_of(int in, int out, const float* w, const float* packed) {
  const int64_t ldw = weight_stride(in);
  if (!packed || !is_wide(in, out)) return {w, kRows * ldw, ldw, 1};
  return {packed + packed_columns_size(in, out), int64_t{in} * kRows, 1, kRows};
}

// So many rows at a time that their part of the matrix stays in a second-level cache of 1 MB
// from strip to strip.
constexpr int64_t kMostWeights = 96 * 1024;

template <Epilogue kEpilogue>
void multiply(int rows, const Rows& w, const float* b, int depth, int64_t ld, int64_t n,
              const float* bias, const float* mask, float* out) {
  const int64_t parts =
      std::max<int64_t>((int64_t{rows} * depth + kMostWeights - 1) / kMostWeights, 1);
  const int at_once = static_cast<int>(round_up((rows + parts - 1) / parts, kRows));
  for (int r = 0; r < rows; r += at_once)
    multiply_rows<kEpilogue>(
        std::min(at_once, rows - r), {w.a + r / kRows * w.block, w.block, w.row, w.column}, b,
        depth, ld, n, bias ? bias + r : nullptr, mask ? mask + r * ld : nullptr, out + r * ld);
}

void forward(int in, int out, const float* w, const float* bias, const float* x, float* y,
             int64_t ld, int64_t n, LinearActivation activation, const float* packed) {
  const Rows rows = rows_of(in, out, w, packed);
  if (activation == LinearActivation::kRelu)
    multiply<Epilogue::kRelu>(out, rows, x, in, ld, n, bias, nullptr, y);
  else
    multiply<Epilogue::kNone>(out, rows, x, in, ld, n, bias, nullptr, y);
}

void backward_input(int in, int out, const float* w, const float* dy, float* dx, int64_t ld,
                    int64_t n, const float* relu_output, const float* packed) {
  if (n <= 0) return;
  const Rows rows = columns_of(in, out, w, packed);
  if (relu_output)
    multiply<Epilogue::kMask>(in, rows, dy, out, ld, n, nullptr, relu_output, dx);
  else
    multiply<Epilogue::kNone>(in, rows, dy, out, ld, n, nullptr, nullptr, dx);
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
HWY_EXPORT(pack);
HWY_EXPORT(forward);
HWY_EXPORT(backward_input);
HWY_EXPORT(relu_mask);

int64_t linear_pack_size(int in, int out) { return HWY_STATIC_DISPATCH(pack_size)(in, out); }
void linear_pack(int in, int out, const float* w, float* packed) {
  HWY_DYNAMIC_DISPATCH(pack)(in, out, w, packed);
}
void linear_forward(int in, int out, const float* w, const float* bias, const float* x, float* y,
                    int64_t ld, int64_t n, LinearActivation activation, const float* packed) {
  HWY_DYNAMIC_DISPATCH(forward)(in, out, w, bias, x, y, ld, n, activation, packed);
}
void linear_backward_input(int in, int out, const float* w, const float* dy, float* dx, int64_t ld,
                           int64_t n, const float* relu_output, const float* packed) {
  HWY_DYNAMIC_DISPATCH(backward_input)(in, out, w, dy, dx, ld, n, relu_output, packed);
}
void relu_backward(int rows, const float* y, float* dy, int64_t ld, int64_t n) {
  HWY_DYNAMIC_DISPATCH(relu_mask)(rows, y, dy, ld, n);
}
}  // namespace nerf
#endif
