// Derivatives of reference templates by complex step (Squire and Trapp 1998): f(x + i h) = f(x) +
// i h f'(x) + O(h^2), with h so small that the remainder is below any rounding.
#pragma once

#include <complex>
#include <cstddef>
#include <vector>

namespace nerf {

using Complex = std::complex<double>;
inline constexpr double kComplexStep = 1e-50;

inline std::vector<Complex> to_complex(const std::vector<double>& x) {
  return {x.begin(), x.end()};
}

// d f / d x_i, f a scalar function of std::vector<Complex>.
template <class F>
double complex_step(const F& f, const std::vector<double>& x, size_t i) {
  std::vector<Complex> at = to_complex(x);
  at[i] += Complex(0, kComplexStep);
  return f(at).imag() / kComplexStep;
}

// All of them.
template <class F>
std::vector<double> complex_step_gradient(const F& f, const std::vector<double>& x) {
  std::vector<double> g(x.size());
  for (size_t i = 0; i < x.size(); ++i) g[i] = complex_step(f, x, i);
  return g;
}

}  // namespace nerf
