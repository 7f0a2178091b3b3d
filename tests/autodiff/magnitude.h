// A scalar that tells how large rounding errors may become (running error analysis, Higham 2002,
// section 3.3, to first order). A reference template run on it gives tolerances for the same
// function computed in float, without a word about the function.
#pragma once

#include <cmath>

namespace nerf {

// Beside a value stands what it would be had nothing cancelled: a computation in which every result
// went through at most k roundings is off by at most k u size. The same for the derivative along
// one input, where reverse mode adds and multiplies the same terms as forward mode, in another
// order.
struct Magnitude {
  double value = 0, size = 0, slope = 0;
  Magnitude() = default;
  Magnitude(double v) : value(v), size(std::fabs(v)) {}  // NOLINT: constants are scalars too
  Magnitude(double v, double s, double d) : value(v), size(s), slope(d) {}
};

inline Magnitude operator-(Magnitude a) { return {-a.value, a.size, a.slope}; }
inline Magnitude operator+(Magnitude a, Magnitude b) {
  return {a.value + b.value, a.size + b.size, a.slope + b.slope};
}
inline Magnitude operator-(Magnitude a, Magnitude b) { return a + -b; }
inline Magnitude operator*(Magnitude a, Magnitude b) {
  return {a.value * b.value, a.size * b.size, a.size * b.slope + a.slope * b.size};
}
inline Magnitude operator/(Magnitude a, Magnitude b) {
  const double square = b.value * b.value;
  return a * Magnitude(1 / b.value, b.size / square,
                       b.slope / square * (1 + 2 * b.size / std::fabs(b.value)));
}
inline Magnitude& operator+=(Magnitude& a, Magnitude b) { return a = a + b; }
inline Magnitude& operator*=(Magnitude& a, Magnitude b) { return a = a * b; }
// An error of x moves exp(x), and its derivative, by exp(x) times it.
inline Magnitude exp(Magnitude x) {
  const double e = std::exp(x.value);
  return {e, e * (1 + x.size), e * x.slope * (1 + x.size)};
}
inline Magnitude expm1(Magnitude x) {
  const double e = std::exp(x.value), value = std::expm1(x.value);
  return {value, std::fabs(value) + e * x.size, e * x.slope * (1 + x.size)};
}
inline Magnitude log1p(Magnitude x) {
  const double value = std::log1p(x.value), d = 1 / (1 + x.value);
  return {value, std::fabs(value) + d * x.size, d * x.slope * (1 + d * x.size)};
}
inline Magnitude sqrt(Magnitude x) {
  const double r = std::sqrt(x.value);
  return {r, r + 0.5 * x.size / r, 0.5 / r * x.slope * (1 + 0.5 * x.size / x.value)};
}
// An error of x moves both, and their derivatives, by at most as much.
inline Magnitude sin(Magnitude x) {
  return {std::sin(x.value), std::fabs(std::sin(x.value)) + x.size, x.slope * (1 + x.size)};
}
inline Magnitude cos(Magnitude x) {
  return {std::cos(x.value), std::fabs(std::cos(x.value)) + x.size, x.slope * (1 + x.size)};
}
inline double real_part(Magnitude x) { return x.value; }
inline Magnitude stop_gradient(Magnitude x) { return {x.value, x.size, 0}; }

}  // namespace nerf
