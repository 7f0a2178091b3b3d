// Elementwise functions over n floats (n rounded up to kLane, pointers 64-byte aligned unless
// said). They may turn a not-a-number into any number, as a ReLU does: gradients tell whether a
// step went wrong (Trainer), not what a network gives.
#pragma once

#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

// Truncated exponential: exp(x) with x clamped to at most kMaxLogDensity, so that it cannot
// overflow. Its derivative is y = exp(min(x, max)) with the slope clamped to exp(+-15) as in
// instant-ngp.
inline constexpr Real kMaxLogDensity = 30.0_r;
void truncated_exp_forward(int64_t n, const Real* x, Real* y);
void truncated_exp_backward(int64_t n, const Real* x, const Real* dy, Real* dx);

// 1 / (1 + exp(-x)); the derivative from the output: y (1 - y).
void sigmoid_forward(int64_t n, const Real* x, Real* y);
void sigmoid_backward(int64_t n, const Real* y, const Real* dy, Real* dx);

// log(1 + exp(x + shift)); the derivative is sigmoid(x + shift).
void softplus_forward(int64_t n, Real shift, const Real* x, Real* y);
void softplus_backward(int64_t n, Real shift, const Real* x, const Real* dy, Real* dx);

// max(x, 0); the derivative is 0 at 0.
void relu_forward(int64_t n, const Real* x, Real* y);

// alpha = 1 - exp(-density * delta), without cancellation for small arguments. A length beyond
// kLongestInterval, even an infinite one, counts as that: without density it stops no light.
inline constexpr Real kLongestInterval = 1e10_r;
void opacity(int64_t n, const Real* density, const Real* delta, Real* alpha);

// y[s * ldy + k] = x[k * ldx + s] for s < n and k < rows.
void transpose(int64_t n, int64_t rows, const Real* x, int64_t ldx, Real* y, int64_t ldy);

// y += x
void add_to(int64_t n, const Real* x, Real* y);

}  // namespace nerf
