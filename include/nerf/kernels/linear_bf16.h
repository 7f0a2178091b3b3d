// Fully connected layers with operands rounded to bf16, sums in f32: the products of linear.h, with
// the same matrices and the same padding, on the unit that bf16_unit() names. No product, and no
// packing, where that is kNone.
//
// Weights stay f32 with their owner, who packs them once per step. A layer's pack holds w and its
// transpose in blocks of 16 rows x 32 columns, 0 beyond the edges.
#pragma once

#include <cstddef>
#include <cstdint>

#include "nerf/base/real.h"
#include "nerf/kernels/linear.h"

namespace nerf {

// Length of a pack in elements, a multiple of 512, so that packs can stand one behind the other.
int64_t packed_layer_size(int in, int out);
// `packed` aligned to 64 bytes.
void pack_layer(int in, int out, const Real* w, uint16_t* packed);

// Between two layers, values may stand as pairs: rounded to bf16 as the next product reads them,
// [blocks of 16 columns][pairs of rows][16 columns][2 rows], aligned to 64 bytes, the rows rounded
// up to a multiple of 32 and 0 beyond the last. No product packs such an operand. The results are
// the bits that rows give, but for masks of denormals, which are 0 as pairs.
//
// Place of the number in a row and a column, in elements from the first.
inline int64_t pair_index(int rows, int row, int64_t column) {
  return (column / 16 * (round_up(rows, 32) / 2) + row / 2) * 32 + column % 16 * 2 + row % 2;
}
inline int64_t pairs_size(int rows, int64_t n) { return round_up(n, 16) * round_up(rows, 32); }
// Whether the forward pass of a layer can leave its output as pairs, in no more memory than rows
// take: not where it is narrow, nor where its input is so wide that sums are stored on the way.
bool layer_writes_pairs(int in, int out);

// Rows of a layer's width, `ld` apart (linear.h), or pairs. One of the two is null; both where
// there are none.
struct LayerInput {
  LayerInput(std::nullptr_t) {}
  LayerInput(const Real* r) : rows(r) {}
  LayerInput(const uint16_t* p) : pairs(p) {}
  const Real* rows = nullptr;
  const uint16_t* pairs = nullptr;
};
struct LayerOutput {
  LayerOutput(Real* r) : rows(r) {}
  LayerOutput(uint16_t* p) : pairs(p) {}  // layer_writes_pairs()
  Real* rows = nullptr;
  uint16_t* pairs = nullptr;
};

// Bias and activation in f32.
void linear_forward_bf16(int in, int out, const uint16_t* packed, const Real* bias, LayerInput x,
                         LayerOutput y, int64_t ld, int64_t n, LinearActivation activation);
// Without a mask where relu_output is null.
void linear_backward_input_bf16(int in, int out, const uint16_t* packed, const Real* dy, Real* dx,
                                int64_t ld, int64_t n, LayerInput relu_output);
// Bias gradients are sums of f32.
void linear_backward_weights_bf16(int in, int out, const Real* dy, LayerInput x, int64_t ld,
                                  int64_t n, Real* dw, Real* dbias);

}  // namespace nerf
