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
  NERF_CHECK(!p.out_pairs || p.epilogue == Bf16Epilogue::kNone ||
             p.epilogue == Bf16Epilogue::kRelu);
  switch (chosen_bf16_unit()) {
    case Bf16Unit::kAvx512:
      return bf16_product_avx512(p);
    case Bf16Unit::kAmx:
      return bf16_product_amx(p);
    case Bf16Unit::kNone:
      NERF_CHECK(false);
  }
}

// The output of p = a x, whose rows' factor is packed; p.out and p.mask are the first columns'.
void multiply_columns(Bf16Product p, int depth, LayerInput x, int64_t n) {
  const int64_t columns = blocks(n, kBf16Columns);
  p.depth_blocks = blocks(depth, kBf16Depth);
  p.depth_pairs = blocks(depth, 2);
  p.pairs_stride = blocks(p.rows, kBf16Depth) * kBf16Block;
  if (x.pairs) {
    p.b = x.pairs;
    p.column_blocks = columns;
    return multiply(p);
  }
  constexpr int64_t kStripBlocks = kStrip / kBf16Columns;
  uint16_t* packed = scratch(right_factor, kStripBlocks * p.depth_blocks * kBf16Block);
  for (int64_t c = 0; c < columns; c += kStripBlocks) {
    Bf16Product strip = p;
    strip.b = packed;
    strip.column_blocks = std::min(kStripBlocks, columns - c);
    bf16_pack_pairs(depth, strip.column_blocks, x.rows + c * kBf16Columns, p.ld, packed);
    if (p.out) strip.out += c * kBf16Columns;
    if (p.mask) strip.mask += c * kBf16Columns;
    if (p.out_pairs) strip.out_pairs += c * p.pairs_stride;
    if (p.mask_pairs) strip.mask_pairs += c * p.pairs_stride;
    multiply(strip);
  }
}

// Pairs behind the last row, which the next product's depth may reach.
void clear_pairs_beyond(int rows, int64_t n, uint16_t* pairs) {
  const int64_t stride = blocks(rows, kBf16Depth) * kBf16Block, used = blocks(rows, 2) * 32;
  if (used == stride) return;
  for (int64_t c = 0; c < n; c += kBf16Columns, pairs += stride)
    std::fill(pairs + used, pairs + stride, uint16_t{0});
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

bool layer_writes_pairs(int in, int out) { return out >= 16 && in <= kBf16MostBlocks * kBf16Depth; }

void linear_forward_bf16(int in, int out, const uint16_t* packed, const float* bias, LayerInput x,
                         LayerOutput y, int64_t ld, int64_t n, LinearActivation activation) {
  NERF_CHECK(!y.pairs || layer_writes_pairs(in, out));
  Bf16Product p;
  p.a = packed;
  p.rows = out;
  p.out = y.rows;
  p.out_pairs = y.pairs;
  p.ld = ld;
  p.bias = bias;
  p.epilogue = activation == LinearActivation::kRelu ? Bf16Epilogue::kRelu : Bf16Epilogue::kNone;
  multiply_columns(p, in, x, n);
  if (y.pairs) clear_pairs_beyond(out, n, y.pairs);
}

void linear_backward_input_bf16(int in, int out, const uint16_t* packed, const float* dy, float* dx,
                                int64_t ld, int64_t n, LayerInput relu_output) {
  Bf16Product p;
  p.a = packed + round_up(out, kBf16Rows) * round_up(in, kBf16Depth);
  p.rows = in;
  p.out = dx;
  p.ld = ld;
  p.mask = relu_output.rows;
  p.mask_pairs = relu_output.pairs;
  p.epilogue = p.mask || p.mask_pairs ? Bf16Epilogue::kMask : Bf16Epilogue::kNone;
  multiply_columns(p, out, dy, n);
}

void linear_backward_weights_bf16(int in, int out, const float* dy, LayerInput x, int64_t ld,
                                  int64_t n, float* dw, float* dbias) {
  if (dbias) linear_backward_bias(out, dy, ld, n, dbias);
  const int64_t end = round_up(n, kLane), columns = blocks(in, kBf16Columns);
  constexpr int64_t kStripBlocks = kStrip / kBf16Columns;
  const int64_t pairs_stride = blocks(in, kBf16Depth) * kBf16Block;
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
      const int64_t rows = std::min(in - first, p.column_blocks * kBf16Columns);
      if (x.pairs)
        bf16_transpose_pairs(rows, samples, x.pairs + s / kBf16Columns * pairs_stride + first * 16,
                             pairs_stride, right);
      else
        bf16_pack_pairs_transposed(rows, samples, x.rows + first * ld + s, ld, right);
      p.out = dw + first;
      multiply(p);
    }
  }
}

#else

void pack_layer(int, int, const Real*, uint16_t*) { NERF_CHECK(false); }
bool layer_writes_pairs(int, int) { return false; }
void linear_forward_bf16(int, int, const uint16_t*, const Real*, LayerInput, LayerOutput, int64_t,
                         int64_t, LinearActivation) {
  NERF_CHECK(false);
}
void linear_backward_input_bf16(int, int, const uint16_t*, const Real*, Real*, int64_t, int64_t,
                                LayerInput) {
  NERF_CHECK(false);
}
void linear_backward_weights_bf16(int, int, const Real*, LayerInput, int64_t, int64_t, Real*,
                                  Real*) {
  NERF_CHECK(false);
}

#endif

}  // namespace nerf
