// A scalar that tells how large rounding errors may become (running error analysis, Higham 2002,
// section 3.3, to first order). A reference template run on it gives tolerances for the same
// function computed in float, without a word about the function.
#pragma once

#include <cmath>

namespace nerf {

// Beside a value stands what it would be had nothing cancelled: a computation in which every result
// went through at most k roundings is off by at most k u size, and size is at least |value|. Beside
// the derivative along one input stands the same of it, where reverse mode adds and multiplies the
// same terms as forward mode, in another order. Products of two errors are left out: with them the
// size of a ray's transmittance would grow by a factor with every sample.
struct Magnitude {
  double value = 0, size = 0, derivative = 0, derivative_size = 0;
  Magnitude() = default;
  Magnitude(double v) : value(v), size(std::fabs(v)) {}  // NOLINT: constants are scalars too
  Magnitude(double v, double s, double d, double ds)
      : value(v), size(s), derivative(d), derivative_size(ds) {}
};

// Size of a product, from values and sizes of the factors.
inline double product_size(double a, double a_size, double b, double b_size) {
  return std::fabs(a) * b_size + std::fabs(b) * a_size - std::fabs(a * b);
}
// f(x) from f, f' and f'' there.
inline Magnitude through(Magnitude x, double f, double f1, double f2) {
  const double f1_size = std::fabs(f1) + std::fabs(f2) * x.size;
  return {f, std::fabs(f) + std::fabs(f1) * x.size, f1 * x.derivative,
          product_size(f1, f1_size, x.derivative, x.derivative_size)};
}

inline Magnitude operator-(Magnitude a) {
  return {-a.value, a.size, -a.derivative, a.derivative_size};
}
inline Magnitude operator+(Magnitude a, Magnitude b) {
  return {a.value + b.value, a.size + b.size, a.derivative + b.derivative,
          a.derivative_size + b.derivative_size};
}
inline Magnitude operator-(Magnitude a, Magnitude b) { return a + -b; }
inline Magnitude operator*(Magnitude a, Magnitude b) {
  return {a.value * b.value, product_size(a.value, a.size, b.value, b.size),
          a.value * b.derivative + b.value * a.derivative,
          product_size(a.value, a.size, b.derivative, b.derivative_size) +
              product_size(b.value, b.size, a.derivative, a.derivative_size)};
}
inline Magnitude operator/(Magnitude a, Magnitude b) {
  const double r = 1 / b.value;
  return a * through(b, r, -r * r, 2 * r * r * r);
}
inline Magnitude& operator+=(Magnitude& a, Magnitude b) { return a = a + b; }
inline Magnitude& operator*=(Magnitude& a, Magnitude b) { return a = a * b; }
inline Magnitude exp(Magnitude x) {
  const double e = std::exp(x.value);
  return through(x, e, e, e);
}
inline Magnitude expm1(Magnitude x) {
  const double e = std::exp(x.value);
  return through(x, std::expm1(x.value), e, e);
}
inline Magnitude log1p(Magnitude x) {
  const double d = 1 / (1 + x.value);
  return through(x, std::log1p(x.value), d, -d * d);
}
inline Magnitude log(Magnitude x) {
  return through(x, std::log(x.value), 1 / x.value, -1 / (x.value * x.value));
}
inline Magnitude sqrt(Magnitude x) {
  const double r = std::sqrt(x.value);
  return through(x, r, 0.5 / r, -0.25 / (r * x.value));
}
inline Magnitude sin(Magnitude x) {
  return through(x, std::sin(x.value), std::cos(x.value), -std::sin(x.value));
}
inline Magnitude cos(Magnitude x) {
  return through(x, std::cos(x.value), -std::sin(x.value), -std::cos(x.value));
}
inline double real_part(Magnitude x) { return x.value; }
inline Magnitude stop_gradient(Magnitude x) { return {x.value, x.size, 0, 0}; }

}  // namespace nerf
