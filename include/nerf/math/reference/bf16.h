// Specification of bf16 products: the numbers, and the order in which each unit sums them.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace nerf::reference {

// The bf16 number nearest to x, ties to an even last bit; 0 (with x's sign) for what is below the
// normal numbers. The exact quotient by a power of two is rounded to 8 significant bits.
inline float nearest_bf16(float x) {
  if (!std::isfinite(x) || x == 0) return x;
  const double a = std::fabs(static_cast<double>(x));
  if (a < 0x1p-126) return std::copysign(0.0f, x);
  int exponent;
  std::frexp(a, &exponent);
  const double unit = std::ldexp(1.0, exponent - 8), multiple = a / unit;
  double whole = std::floor(multiple);
  const double rest = multiple - whole;
  if (rest > 0.5 || (rest == 0.5 && std::fmod(whole, 2) == 1)) ++whole;
  return std::copysign(static_cast<float>(whole * unit), x);  // infinite above the largest
}

// sum + a . b on vdpbf16ps, where a and b hold bf16 numbers and an even count of them: of each pair
// the second product first, all in one sum.
inline float dot_avx512_bf16(std::span<const float> a, std::span<const float> b, float sum) {
  for (size_t k = 0; k + 1 < a.size(); k += 2) {
    sum = std::fma(a[k + 1], b[k + 1], sum);
    sum = std::fma(a[k], b[k], sum);
  }
  return sum;
}

// The same on tdpbf16ps: over 16 pairs the first products and the second ones have a sum each; then
// both are added to the whole.
inline float dot_amx_bf16(std::span<const float> a, std::span<const float> b, float sum) {
  for (size_t begin = 0; begin < a.size(); begin += 32) {
    float first = 0, second = 0;
    for (size_t k = begin; k < begin + 32 && k + 1 < a.size(); k += 2) {
      first = std::fma(a[k], b[k], first);
      second = std::fma(a[k + 1], b[k + 1], second);
    }
    sum += first + second;
  }
  return sum;
}

// What a whole product adds up in one go before it goes to memory: the depth of a weight gradient,
// the samples, is cut into parts of so many, whose sums are added to the gradient in turn.
inline constexpr size_t kAvx512Bf16Samples = 256, kAmxBf16Samples = 512;

}  // namespace nerf::reference
