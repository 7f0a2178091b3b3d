// Fully connected layers with operands rounded to bf16, sums in f32: the products of linear.h, with
// the same matrices and the same padding, on the unit that bf16_unit() names. None may be called
// where that is kNone.
//
// Weights stay f32 with their owner, who packs them once per step. A layer's pack holds w and its
// transpose in blocks of 16 rows x 32 columns, 0 beyond the edges.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"
#include "nerf/kernels/linear.h"

namespace nerf {

// In elements; a multiple of 512, so that packs can stand one behind the other.
int64_t packed_layer_size(int in, int out);
// `packed` aligned to 64 bytes.
void pack_layer(int in, int out, const Real* w, uint16_t* packed);

// Bias and activation in f32.
void linear_forward_bf16(int in, int out, const uint16_t* packed, const Real* bias, const Real* x,
                         Real* y, int64_t ld, int64_t n, LinearActivation activation);
void linear_backward_input_bf16(int in, int out, const uint16_t* packed, const Real* dy, Real* dx,
                                int64_t ld, int64_t n, const Real* relu_output);
// Bias gradients are sums of f32.
void linear_backward_weights_bf16(int in, int out, const Real* dy, const Real* x, int64_t ld,
                                  int64_t n, Real* dw, Real* dbias);

}  // namespace nerf
