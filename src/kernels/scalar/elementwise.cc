#include "nerf/kernels/elementwise.h"

#include <algorithm>
#include <cmath>

#include "nerf/kernels/linear.h"
#include "nerf/math/reference/activations.h"
#include "nerf/math/reference/linear.h"
#include "nerf/math/reference/volume_rendering.h"

namespace nerf {
namespace {

template <class Function>
void each(int64_t n, Real* out, const Function& function) {
  const int64_t end = round_up(n, kLane);
  for (int64_t i = 0; i < end; ++i) out[i] = function(i);
}

}  // namespace

// The template's value and slope apart: together they are infinity less infinity at the ends.
void truncated_exp_forward(int64_t n, const Real* x, Real* y) {
  each(n, y, [=](int64_t i) { return std::exp(std::min(x[i], kMaxLogDensity)); });
}
void truncated_exp_backward(int64_t n, const Real* x, const Real* dy, Real* dx) {
  each(n, dx,
       [=](int64_t i) { return static_cast<Real>(reference::truncated_exp_slope(x[i])) * dy[i]; });
}

void sigmoid_forward(int64_t n, const Real* x, Real* y) {
  each(n, y, [=](int64_t i) { return reference::sigmoid(x[i]); });
}
void sigmoid_backward(int64_t n, const Real* y, const Real* dy, Real* dx) {
  each(n, dx, [=](int64_t i) { return dy[i] * reference::sigmoid_slope(y[i]); });
}

void softplus_forward(int64_t n, Real shift, const Real* x, Real* y) {
  each(n, y, [=](int64_t i) { return reference::softplus(x[i] + shift); });
}
void softplus_backward(int64_t n, Real shift, const Real* x, const Real* dy, Real* dx) {
  each(n, dx, [=](int64_t i) { return reference::sigmoid(x[i] + shift) * dy[i]; });
}

void relu_forward(int64_t n, const Real* x, Real* y) {
  each(n, y, [=](int64_t i) { return reference::relu(x[i]); });
}

void opacity(int64_t n, const Real* density, const Real* delta, Real* alpha) {
  each(n, alpha, [=](int64_t i) {
    return reference::opacity(density[i], std::min(delta[i], kLongestInterval));
  });
}

void transpose(int64_t n, int64_t rows, const Real* x, int64_t ldx, Real* y, int64_t ldy) {
  for (int64_t k = 0; k < rows; ++k)
    for (int64_t s = 0; s < n; ++s) y[s * ldy + k] = x[k * ldx + s];
}

void add_to(int64_t n, const Real* x, Real* y) {
  each(n, y, [=](int64_t i) { return x[i] + y[i]; });
}

}  // namespace nerf
