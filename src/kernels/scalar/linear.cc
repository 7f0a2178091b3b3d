// math/reference/linear.h with its sums in the same order, over kLane samples at a time.
#include "nerf/kernels/linear.h"

#include "nerf/math/reference/linear.h"

namespace nerf {
namespace {

// sums[s] = first + sum_k a[k * step] b[k][s] of kLane samples.
void products(int depth, const Real* a, int64_t step, const Real* b, int64_t ld, Real first,
              Real sums[kLane]) {
  for (int s = 0; s < kLane; ++s) sums[s] = first;
  for (int k = 0; k < depth; ++k)
    for (int s = 0; s < kLane; ++s) sums[s] += a[k * step] * b[k * ld + s];
}

// Of n numbers, with one sum for each of the kLane places, which are added at the end.
template <class Term>
Real sum_of(int64_t n, const Term& term) {
  Real sums[kLane] = {}, all = 0;
  for (int64_t s = 0; s < n; s += kLane)
    for (int i = 0; i < kLane; ++i) sums[i] += term(s + i);
  for (const Real sum : sums) all += sum;
  return all;
}

}  // namespace

int64_t linear_pack_size(int, int) { return 0; }
void linear_pack(int, int, const Real*, Real*) {}

void linear_forward(int in, int out, const Real* w, const Real* bias, const Real* x, Real* y,
                    int64_t ld, int64_t n, LinearActivation activation, const Real*) {
  const bool with_relu = activation == LinearActivation::kRelu;
  for (int64_t s = 0; s < n; s += kLane)
    for (int j = 0; j < out; ++j) {
      Real sums[kLane];
      products(in, w + int64_t{j} * weight_stride(in), 1, x + s, ld, bias ? bias[j] : 0, sums);
      for (int i = 0; i < kLane; ++i)
        y[j * ld + s + i] = with_relu ? reference::relu(sums[i]) : sums[i];
    }
}

void linear_backward_input(int in, int out, const Real* w, const Real* dy, Real* dx, int64_t ld,
                           int64_t n, const Real* relu_output, const Real*) {
  for (int64_t s = 0; s < n; s += kLane)
    for (int k = 0; k < in; ++k) {
      Real sums[kLane];
      products(out, w + k, weight_stride(in), dy + s, ld, 0, sums);
      for (int64_t at = k * ld + s, i = 0; i < kLane; ++i)
        dx[at + i] = !relu_output || relu_output[at + i] > 0 ? sums[i] : 0;
    }
}

void linear_backward_weights(int in, int out, const Real* dy, const Real* x, int64_t ld, int64_t n,
                             Real* dw, Real* dbias) {
  for (int j = 0; j < out; ++j)
    for (int k = 0; k < in; ++k)
      dw[int64_t{j} * weight_stride(in) + k] +=
          sum_of(n, [g = dy + j * ld, v = x + k * ld](int64_t s) { return g[s] * v[s]; });
  if (dbias) linear_backward_bias(out, dy, ld, n, dbias);
}

void linear_backward_bias(int out, const Real* dy, int64_t ld, int64_t n, Real* dbias) {
  for (int j = 0; j < out; ++j)
    dbias[j] += sum_of(n, [g = dy + j * ld](int64_t s) { return g[s]; });
}

void relu_backward(int rows, const Real* y, Real* dy, int64_t ld, int64_t n) {
  const int64_t end = round_up(n, kLane);
  for (int r = 0; r < rows; ++r)
    for (int64_t s = r * ld; s < r * ld + end; ++s)
      if (!(y[s] > 0)) dy[s] = 0;
}

}  // namespace nerf
