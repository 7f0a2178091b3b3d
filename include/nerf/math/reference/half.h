// Specification of half floats (IEEE 754, 16 bits; base/half.h): the numbers, and which is nearest.
#pragma once

#include <cmath>
#include <cstdint>

namespace nerf::reference {

// The number that the bits stand for: a sign, 5 bits of exponent, 10 of fraction.
inline double half_value(uint16_t bits) {
  const int exponent = bits >> 10 & 31, fraction = bits & 1023;
  double value =
      exponent == 0 ? std::ldexp(fraction, -24) : std::ldexp(1024 + fraction, exponent - 25);
  if (exponent == 31) value = fraction == 0 ? INFINITY : NAN;
  return std::copysign(value, bits & 0x8000 ? -1.0 : 1.0);
}

// The half float nearest to x, ties to an even last bit; beyond the largest, 65504, that one.
inline double nearest_half(double x) {
  if (std::isnan(x)) return x;
  const double a = std::fabs(x);
  if (a >= 65504) return std::copysign(65504.0, x);
  int exponent = -13;  // of the smallest normal numbers: those below have their unit
  if (a >= 0x1p-14) std::frexp(a, &exponent);
  const double unit = std::ldexp(1.0, exponent - 11), multiple = a / unit;
  double whole = std::floor(multiple);
  const double rest = multiple - whole;
  if (rest > 0.5 || (rest == 0.5 && std::fmod(whole, 2) == 1)) ++whole;
  return std::copysign(whole * unit, x);
}

}  // namespace nerf::reference
