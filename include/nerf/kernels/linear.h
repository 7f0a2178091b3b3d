// Fully connected layers over a chunk of samples, forward and backward.
//
// A value is a matrix [rows x samples], row-major with `ld` floats between rows; ld is a multiple
// of kLane and rows start 64-byte aligned. Kernels run over n samples rounded up to kLane: what
// stands in the padding must be finite, and gradients there must be 0. A weight matrix is [out x
// in], row-major with stride weight_stride(in); the padding columns are 0 and stay 0 through the
// optimiser, since their gradient is 0.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

inline constexpr int kLane = 16;
constexpr int64_t round_up(int64_t n, int64_t unit) { return (n + unit - 1) / unit * unit; }
inline int weight_stride(int in) { return static_cast<int>(round_up(in, kLane)); }

enum class LinearActivation { kNone, kRelu };

// Wide layers read their weights in blocks of rows (forward) and of columns (backward), each block
// one column or row behind the other. A pack holds both; who multiplies by the same weights many
// times makes it once. Only the SIMD target that made it can read it.
void linear_pack(int in, int out, const Real* w, Real* pack);
// Length of a pack in numbers, a multiple of kLane; 0 for a layer that is not wide.
int64_t linear_pack_size(int in, int out);

// y[j][s] = act(bias[j] + sum_k w[j][k] x[k][s]); bias may be null. The same bits with the pack of
// w as without it (null).
void linear_forward(int in, int out, const Real* w, const Real* bias, const Real* x, Real* y,
                    int64_t ld, int64_t n, LinearActivation activation, const Real* pack = nullptr);

// dx[k][s] = sum_j w[j][k] dy[j][s], where dy is the gradient before the activation. With
// `relu_output` (the layer's input, itself the output of a ReLU) the result is set to 0 where that
// is 0, which makes it the gradient before that activation. With the pack of w (null: packed here)
// the same bits.
void linear_backward_input(int in, int out, const Real* w, const Real* dy, Real* dx, int64_t ld,
                           int64_t n, const Real* relu_output, const Real* pack = nullptr);

// dw[j][k] += sum_s dy[j][s] x[k][s] for k < in. dbias[j] += sum_s dy[j][s] unless null.
void linear_backward_weights(int in, int out, const Real* dy, const Real* x, int64_t ld, int64_t n,
                             Real* dw, Real* dbias);

// dbias[j] += sum_s dy[j][s].
void linear_backward_bias(int out, const Real* dy, int64_t ld, int64_t n, Real* dbias);

// dy[r][s] = 0 where y[r][s] == 0 (y the output of a ReLU), in place.
void relu_backward(int rows, const Real* y, Real* dy, int64_t ld, int64_t n);

}  // namespace nerf
