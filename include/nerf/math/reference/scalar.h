// Scalars that the reference templates of this folder run on: float, double, std::complex<double>
// and Dual.
//
// A template is the specification of an operation, and of its gradient: run on std::complex<double>
// with x + i h, h = 1e-50, the imaginary part of the result divided by h is the derivative without
// any cancellation. For that to hold, comparisons look at the real part only, a norm is the square
// root of a sum of squares, and what is meant to pass no gradient goes through stop_gradient().
#pragma once

#include <cmath>
#include <complex>

namespace nerf::reference {

// Value and derivative along one direction: forward-mode differentiation.
struct Dual {
  double value = 0, derivative = 0;
  Dual() = default;
  Dual(double v, double d = 0) : value(v), derivative(d) {}  // NOLINT: constants are scalars too
};

inline Dual operator-(Dual a) { return {-a.value, -a.derivative}; }
inline Dual operator+(Dual a, Dual b) { return {a.value + b.value, a.derivative + b.derivative}; }
inline Dual operator-(Dual a, Dual b) { return {a.value - b.value, a.derivative - b.derivative}; }
inline Dual operator*(Dual a, Dual b) {
  return {a.value * b.value, a.derivative * b.value + a.value * b.derivative};
}
inline Dual operator/(Dual a, Dual b) {
  const double q = a.value / b.value;
  return {q, (a.derivative - q * b.derivative) / b.value};
}
inline Dual& operator+=(Dual& a, Dual b) { return a = a + b; }
inline Dual& operator*=(Dual& a, Dual b) { return a = a * b; }
inline Dual exp(Dual x) {
  const double e = std::exp(x.value);
  return {e, e * x.derivative};
}
inline Dual expm1(Dual x) { return {std::expm1(x.value), std::exp(x.value) * x.derivative}; }
inline Dual sqrt(Dual x) {
  const double r = std::sqrt(x.value);
  return {r, x.derivative / (2 * r)};
}

inline Dual log(Dual x) { return {std::log(x.value), x.derivative / x.value}; }
inline Dual log1p(Dual x) { return {std::log1p(x.value), x.derivative / (1 + x.value)}; }
inline Dual sin(Dual x) { return {std::sin(x.value), std::cos(x.value) * x.derivative}; }
inline Dual cos(Dual x) { return {std::cos(x.value), -std::sin(x.value) * x.derivative}; }

// exp(x) - 1 without cancellation; the standard library has none for complex numbers.
inline float expm1(float x) { return std::expm1(x); }
inline double expm1(double x) { return std::expm1(x); }
inline std::complex<double> expm1(std::complex<double> z) {
  const double s = std::sin(0.5 * z.imag());
  return {std::expm1(z.real()) * std::cos(z.imag()) - 2 * s * s,
          std::exp(z.real()) * std::sin(z.imag())};
}

// log(1 + x) without loss of digits for small x; real parts above -1.
inline float log1p(float x) { return std::log1p(x); }
inline double log1p(double x) { return std::log1p(x); }
inline std::complex<double> log1p(std::complex<double> z) {
  const double a = 1 + z.real();
  return {std::log1p(z.real()) + 0.5 * std::log1p(z.imag() * z.imag() / (a * a)),
          std::atan2(z.imag(), a)};
}

inline float real_part(float x) { return x; }
inline double real_part(double x) { return x; }
inline double real_part(std::complex<double> x) { return x.real(); }
inline double real_part(Dual x) { return x.value; }

// The same value as a constant: its derivative is 0.
inline float stop_gradient(float x) { return x; }
inline double stop_gradient(double x) { return x; }
inline std::complex<double> stop_gradient(std::complex<double> x) { return {x.real(), 0}; }
inline Dual stop_gradient(Dual x) { return {x.value}; }

}  // namespace nerf::reference
