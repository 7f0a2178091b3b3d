// Specification of a fully connected layer (kernels/linear.h, autodiff's linear and mlp).
#pragma once

#include <cstddef>
#include <vector>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

template <class T>
T relu(T x) {
  return real_part(x) > 0 ? x : T(0);  // derivative 0 at 0
}

// y = act(bias + W x); w is [out x in], row by row without padding, bias empty or [out].
template <class T>
std::vector<T> linear(const std::vector<T>& w, const std::vector<T>& bias, const std::vector<T>& x,
                      size_t out, bool with_relu) {
  std::vector<T> y(out);
  for (size_t j = 0; j < out; ++j) {
    T sum = bias.empty() ? T(0) : bias[j];
    for (size_t k = 0; k < x.size(); ++k) sum += w[j * x.size() + k] * x[k];
    y[j] = with_relu ? relu(sum) : sum;
  }
  return y;
}

// Gradients of a loss from dy = d loss / d y: dx is overwritten, dw and dbias (unless empty) are
// added to. y: the layer's output, which tells where a ReLU was closed.
template <class T>
void linear_backward(const std::vector<T>& w, const std::vector<T>& x, const std::vector<T>& y,
                     const std::vector<T>& dy, bool with_relu, std::vector<T>& dx,
                     std::vector<T>& dw, std::vector<T>& dbias) {
  dx.assign(x.size(), T(0));
  for (size_t j = 0; j < y.size(); ++j) {
    if (with_relu && !(real_part(y[j]) > 0)) continue;
    for (size_t k = 0; k < x.size(); ++k) {
      dx[k] += w[j * x.size() + k] * dy[j];
      dw[j * x.size() + k] += x[k] * dy[j];
    }
    if (!dbias.empty()) dbias[j] += dy[j];
  }
}

}  // namespace nerf::reference
