#include "nerf/kernels/linear_bf16.h"

#include <algorithm>
#include <cstring>

#include "kernels/bf16_product.h"
#include "nerf/base/aligned.h"
#include "nerf/base/error.h"
#include "nerf/kernels/bf16.h"

namespace nerf {

using namespace internal;

int64_t packed_layer_size(int in, int out) {
  return round_up(out, kBf16Rows) * round_up(in, kBf16Depth) +
         round_up(in, kBf16Rows) * round_up(out, kBf16Depth);
}

#if defined(__x86_64__) && !defined(NERF_DOUBLE)

namespace {

// Columns whose operand is packed at a time: it stays in the caches until it is multiplied.
constexpr int64_t kStrip = 96;
// Samples that a weight gradient sums at a time, for the same reason.
constexpr int64_t kMostSamples = 512;

int64_t blocks(int64_t n, int64_t unit) { return (n + unit - 1) / unit; }

// A thread's memory for a packed factor.
uint16_t* scratch(AlignedArray<uint16_t>& memory, int64_t size) {
  if (memory.size() < static_cast<size_t>(size))
    memory = AlignedArray<uint16_t>(static_cast<size_t>(size));
  return memory.data();
}
thread_local AlignedArray<uint16_t> left_factor, right_factor;

void multiply(const Bf16Product& p) {
  switch (chosen_bf16_unit()) {
    case Bf16Unit::kAvx512:
      return bf16_product_avx512(p);
    case Bf16Unit::kAmx:
      return bf16_product_amx(p);
    case Bf16Unit::kNone:
      NERF_CHECK(false);
  }
}

// p.out = a x: the rows' factor is packed, the columns of x are not.
void multiply_columns(Bf16Product p, int depth, const float* x, int64_t n) {
  const int64_t columns = blocks(n, kBf16Columns);
  float* const out = p.out;
  const float* const mask = p.mask;
  p.depth_blocks = blocks(depth, kBf16Depth);
  p.depth_pairs = blocks(depth, 2);
  constexpr int64_t kStripBlocks = kStrip / kBf16Columns;
  uint16_t* packed = scratch(right_factor, kStripBlocks * p.depth_blocks * kBf16Block);
  p.b = packed;
  for (int64_t c = 0; c < columns; c += kStripBlocks) {
    p.column_blocks = std::min(kStripBlocks, columns - c);
    bf16_pack_pairs(depth, p.column_blocks, x + c * kBf16Columns, p.ld, packed);
    p.out = out + c * kBf16Columns;
    if (mask) p.mask = mask + c * kBf16Columns;
    multiply(p);
  }
}

}  // namespace

void pack_layer(int in, int out, const float* w, uint16_t* packed) {
  const int64_t stride = weight_stride(in);
  bf16_pack_rows(out, stride, w, stride, packed);
  // The transpose, a block of rows at a time: 16 columns of w, each as far as the depth goes.
  uint16_t* to = packed + round_up(out, kBf16Rows) * round_up(in, kBf16Depth);
  const int64_t depth = round_up(out, kBf16Depth);
  const size_t size = static_cast<size_t>(kBf16Rows * depth);
  thread_local AlignedArray<float> rows;
  if (rows.size() < size) rows = AlignedArray<float>(size);
  std::fill_n(rows.data(), size, 0.0f);
  for (int64_t k = 0; k < stride; k += kBf16Rows, to += kBf16Rows * depth) {
    for (int64_t j = 0; j < out; ++j)
      for (int64_t r = 0; r < kBf16Rows; ++r)
        rows[static_cast<size_t>(r * depth + j)] = w[j * stride + k + r];
    bf16_pack_rows(kBf16Rows, depth, rows.data(), depth, to);
  }
}

void linear_forward_bf16(int in, int out, const uint16_t* packed, const float* bias, const float* x,
                         float* y, int64_t ld, int64_t n, LinearActivation activation) {
  Bf16Product p;
  p.a = packed;
  p.rows = out;
  p.out = y;
  p.ld = ld;
  p.bias = bias;
  p.epilogue = activation == LinearActivation::kRelu ? Bf16Epilogue::kRelu : Bf16Epilogue::kNone;
  multiply_columns(p, in, x, n);
}

void linear_backward_input_bf16(int in, int out, const uint16_t* packed, const float* dy, float* dx,
                                int64_t ld, int64_t n, const float* relu_output) {
  Bf16Product p;
  p.a = packed + round_up(out, kBf16Rows) * round_up(in, kBf16Depth);
  p.rows = in;
  p.out = dx;
  p.ld = ld;
  p.mask = relu_output;
  p.epilogue = relu_output ? Bf16Epilogue::kMask : Bf16Epilogue::kNone;
  multiply_columns(p, out, dy, n);
}

void linear_backward_weights_bf16(int in, int out, const float* dy, const float* x, int64_t ld,
                                  int64_t n, float* dw, float* dbias) {
  if (dbias) linear_backward_bias(out, dy, ld, n, dbias);
  const int64_t end = round_up(n, kLane), columns = blocks(in, kBf16Columns);
  constexpr int64_t kStripBlocks = kStrip / kBf16Columns;
  for (int64_t s = 0; s < end; s += kMostSamples) {
    const int64_t samples = std::min(kMostSamples, end - s);
    Bf16Product p;
    p.depth_blocks = blocks(samples, kBf16Depth);
    p.depth_pairs = blocks(samples, 2);
    uint16_t* left = scratch(left_factor, blocks(out, kBf16Rows) * p.depth_blocks * kBf16Block);
    uint16_t* right = scratch(right_factor, kStripBlocks * p.depth_blocks * kBf16Block);
    bf16_pack_rows(out, samples, dy + s, ld, left);
    p.a = left;
    p.b = right;
    p.rows = out;
    p.ld = weight_stride(in);
    p.epilogue = Bf16Epilogue::kAdd;
    for (int64_t c = 0; c < columns; c += kStripBlocks) {
      p.column_blocks = std::min(kStripBlocks, columns - c);
      const int64_t first = c * kBf16Columns;
      bf16_pack_pairs_transposed(std::min(in - first, p.column_blocks * kBf16Columns), samples,
                                 x + first * ld + s, ld, right);
      p.out = dw + first;
      multiply(p);
    }
  }
}

#else

void pack_layer(int, int, const Real*, uint16_t*) { NERF_CHECK(false); }
void linear_forward_bf16(int, int, const uint16_t*, const Real*, const Real*, Real*, int64_t,
                         int64_t, LinearActivation) {
  NERF_CHECK(false);
}
void linear_backward_input_bf16(int, int, const uint16_t*, const Real*, Real*, int64_t, int64_t,
                                const Real*) {
  NERF_CHECK(false);
}
void linear_backward_weights_bf16(int, int, const Real*, const Real*, int64_t, int64_t, Real*,
                                  Real*) {
  NERF_CHECK(false);
}

#endif

}  // namespace nerf
