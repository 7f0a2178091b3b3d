// Polynomials of small degree in one variable, lowest coefficient first.
#pragma once

#include <array>
#include <cstddef>

namespace nerf::internal {

template <size_t kCapacity>
struct Polynomial {
  std::array<double, kCapacity> c{};
  size_t size = 0;  // number of coefficients in use

  void trim() {
    while (size > 0 && c[size - 1] == 0) --size;
  }
};

template <size_t kOut, size_t kA, size_t kB>
Polynomial<kOut> multiply(const Polynomial<kA>& a, const Polynomial<kB>& b) {
  static_assert(kOut + 1 >= kA + kB);
  Polynomial<kOut> r;
  if (a.size == 0 || b.size == 0) return r;
  r.size = a.size + b.size - 1;
  for (size_t i = 0; i < a.size; ++i)
    for (size_t j = 0; j < b.size; ++j) r.c[i + j] += a.c[i] * b.c[j];
  return r;
}

// x * derivative, same degree.
template <size_t kA>
Polynomial<kA> times_x_derivative(const Polynomial<kA>& a) {
  Polynomial<kA> r = a;
  for (size_t i = 0; i < a.size; ++i) r.c[i] *= static_cast<double>(i);
  return r;
}

// True where p > 0 on all of [0, end]. A lower bound from the negative coefficients settles nearly
// all calls; the rest by subdivision of the Bernstein form, whose coefficients enclose the values.
// An interval that 40 halvings do not settle holds a root.
template <size_t kCapacity>
bool positive_on(const Polynomial<kCapacity>& p, double end) {
  if (p.size == 0) return false;
  double lowest = p.c[0], power = 1;
  for (size_t i = 1; i < p.size; ++i) {
    power *= end;
    if (!(p.c[i] >= 0)) lowest += p.c[i] * power;  // also when NaN
  }
  if (lowest > 0) return true;

  // Bernstein coefficients on [0, end]: b_k = sum_{i<=k} C(k, i) / C(n, i) * c_i * end^i.
  const size_t n = p.size - 1;
  std::array<double, kCapacity> scaled{}, b{};
  double binomial_n = 1;
  power = 1;
  for (size_t i = 0; i <= n; ++i) {
    scaled[i] = p.c[i] * power / binomial_n;
    power *= end;
    binomial_n = binomial_n * static_cast<double>(n - i) / static_cast<double>(i + 1);
  }
  for (size_t k = 0; k <= n; ++k) {
    double binomial_k = 1;
    for (size_t i = 0; i <= k; ++i) {
      b[k] += binomial_k * scaled[i];
      binomial_k = binomial_k * static_cast<double>(k - i) / static_cast<double>(i + 1);
    }
  }
  struct Subdivide {
    static bool run(const std::array<double, kCapacity>& b, size_t n, int depth) {
      if (!(b[0] > 0) || !(b[n] > 0)) return false;
      bool all = true;
      for (size_t i = 1; i < n; ++i) all = all && b[i] > 0;
      if (all) return true;
      if (depth == 0) return false;
      std::array<double, kCapacity> left{}, right = b;  // de Casteljau at the middle
      for (size_t i = 0; i <= n; ++i) {
        left[i] = right[0];
        for (size_t j = 0; j + i < n; ++j) right[j] = 0.5 * (right[j] + right[j + 1]);
      }
      return run(left, n, depth - 1) && run(right, n, depth - 1);
    }
  };
  return Subdivide::run(b, n, 40);
}

}  // namespace nerf::internal
