// Specification of kernels/encoding.h and of autodiff's encodings.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "nerf/math/reference/scalar.h"

namespace nerf::reference {

// Sine and cosine of frequency x, damped by what a Gaussian of this variance averages out
// (Barron et al. 2021, equation 12).
template <class T>
std::array<T, 2> sine_cosine(T x, T variance, double frequency, double weight) {
  using std::cos;
  using std::exp;
  using std::sin;
  const T a = T(weight) * exp(T(-0.5 * frequency * frequency) * variance);
  return {a * sin(T(frequency) * x), a * cos(T(frequency) * x)};
}

// Weight of frequency 2^k while `alpha` frequencies are switched on (Park et al. 2021, equation 8).
inline double window_weight(double alpha, int k) {
  const double open = alpha - k < 0 ? 0 : alpha - k > 1 ? 1 : alpha - k;
  return 0.5 * (1 - std::cos(3.14159265358979323846 * open));
}

// [identity], then for each frequency 2^k, k in [0, weights.size()): the sines of all coordinates,
// then their cosines (Mildenhall et al. 2020, equation 4, in the order of the authors' code and
// without its factor pi). weights: of each frequency.
template <class T>
std::vector<T> frequency_encoding(const std::vector<T>& x, const std::vector<double>& weights,
                                  bool identity) {
  std::vector<T> out;
  if (identity) out = x;
  for (size_t k = 0; k < weights.size(); ++k)
    for (size_t part = 0; part < 2; ++part)
      for (const T& coordinate : x)
        out.push_back(
            sine_cosine(coordinate, T(0), std::ldexp(1.0, static_cast<int>(k)), weights[k])[part]);
  return out;
}

// All sines of 2^k x, frequency by frequency, then all cosines, damped by the variance of each
// coordinate (Barron et al. 2021, equation 14).
template <class T>
std::vector<T> integrated_encoding(const std::vector<T>& mean, const std::vector<T>& variance,
                                   int degrees) {
  std::vector<T> out;
  for (size_t part = 0; part < 2; ++part)
    for (int k = 0; k < degrees; ++k)
      for (size_t i = 0; i < mean.size(); ++i)
        out.push_back(sine_cosine(mean[i], variance[i], std::ldexp(1.0, k), 1.0)[part]);
  return out;
}

}  // namespace nerf::reference
