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
#include <type_traits>

namespace nerf::reference {

// Value and derivative along one direction: forward-mode differentiation. On another scalar than
// double it nests: TDual<std::complex<double>> with a step in the imaginary part is the derivative
// of a derivative.
template <class S>
struct TDual {
  S value{}, derivative{};
  TDual() = default;
  TDual(S v, S d = S(0)) : value(v), derivative(d) {}  // NOLINT: constants are scalars too
  template <class Number>
    requires(std::is_arithmetic_v<Number> && !std::is_same_v<Number, S>)
  TDual(Number v) : value(static_cast<double>(v)), derivative(0.0) {}  // NOLINT: the same

  friend TDual operator-(TDual a) { return {-a.value, -a.derivative}; }
  friend TDual operator+(TDual a, TDual b) {
    return {a.value + b.value, a.derivative + b.derivative};
  }
  friend TDual operator-(TDual a, TDual b) {
    return {a.value - b.value, a.derivative - b.derivative};
  }
  friend TDual operator*(TDual a, TDual b) {
    return {a.value * b.value, a.derivative * b.value + a.value * b.derivative};
  }
  friend TDual operator/(TDual a, TDual b) {
    const S q = a.value / b.value;
    return {q, (a.derivative - q * b.derivative) / b.value};
  }
  friend TDual& operator+=(TDual& a, TDual b) { return a = a + b; }
  friend TDual& operator*=(TDual& a, TDual b) { return a = a * b; }
};
using Dual = TDual<double>;

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

template <class S>
TDual<S> exp(TDual<S> x) {
  using std::exp;
  const S e = exp(x.value);
  return {e, e * x.derivative};
}
template <class S>
TDual<S> expm1(TDual<S> x) {
  using std::exp;
  return {expm1(x.value), exp(x.value) * x.derivative};
}
template <class S>
TDual<S> sqrt(TDual<S> x) {
  using std::sqrt;
  const S r = sqrt(x.value);
  return {r, x.derivative / (S(2) * r)};
}
template <class S>
TDual<S> log(TDual<S> x) {
  using std::log;
  return {log(x.value), x.derivative / x.value};
}
template <class S>
TDual<S> pow(TDual<S> x, TDual<S> y) {
  return exp(y * log(x));
}
template <class S>
TDual<S> log1p(TDual<S> x) {
  return {log1p(x.value), x.derivative / (S(1) + x.value)};
}
template <class S>
TDual<S> sin(TDual<S> x) {
  using std::cos, std::sin;
  return {sin(x.value), cos(x.value) * x.derivative};
}
template <class S>
TDual<S> cos(TDual<S> x) {
  using std::cos, std::sin;
  return {cos(x.value), -sin(x.value) * x.derivative};
}

inline float real_part(float x) { return x; }
inline double real_part(double x) { return x; }
inline double real_part(std::complex<double> x) { return x.real(); }
template <class S>
double real_part(TDual<S> x) {
  return real_part(x.value);
}

// The same value as a constant: its derivative is 0.
inline float stop_gradient(float x) { return x; }
inline double stop_gradient(double x) { return x; }
inline std::complex<double> stop_gradient(std::complex<double> x) { return {x.real(), 0}; }
template <class S>
TDual<S> stop_gradient(TDual<S> x) {
  return {stop_gradient(x.value)};
}

}  // namespace nerf::reference
