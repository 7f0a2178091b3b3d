// IEEE 754 half floats as bits.
#pragma once

#include <bit>
#include <cstdint>

namespace nerf::internal {

inline float half_to_float(uint16_t h) {
  const uint32_t sign = uint32_t{h & 0x8000u} << 16;
  const uint32_t magnitude = h & 0x7fffu;
  if (magnitude >= 0x7c00u) {  // infinite, not a number
    return std::bit_cast<float>(sign | 0x7f800000u | (magnitude & 0x3ffu) << 13);
  }
  // The exponent is rebiased by a multiplication, which also makes subnormal halves normal: 2^-24
  // times the fraction is exact, and no float below 2^-24 ever appears (denormals may be flushed).
  if (magnitude < 0x400u) {
    const float value = static_cast<float>(magnitude) * 0x1p-24f;
    return std::bit_cast<float>(sign | std::bit_cast<uint32_t>(value));
  }
  return std::bit_cast<float>(sign | ((magnitude << 13) + (uint32_t{127 - 15} << 23)));
}

// Rounds to nearest, ties to even; beyond the largest half (65504) that one, with the sign. Not a
// number stays so.
inline uint16_t float_to_half(float f) {
  const uint32_t bits = std::bit_cast<uint32_t>(f);
  const auto sign = static_cast<uint16_t>(bits >> 16 & 0x8000u);
  const uint32_t magnitude = bits & 0x7fffffffu;
  if (magnitude > 0x7f800000u) return static_cast<uint16_t>(sign | 0x7e00u);
  if (magnitude >= 0x477fe000u) return static_cast<uint16_t>(sign | 0x7bffu);  // 65504 and more
  if (magnitude < 0x38800000u) {  // below 2^-14: a multiple of 2^-24
    // Adding 1/2 puts the wanted bits last in the sum, rounded by the addition itself.
    const float sum = std::bit_cast<float>(magnitude) + 0.5f;
    return static_cast<uint16_t>(sign | (std::bit_cast<uint32_t>(sum) - 0x3f000000u));
  }
  const uint32_t odd = magnitude >> 13 & 1u;
  return static_cast<uint16_t>(sign |
                               ((magnitude - (uint32_t{127 - 15} << 23) + 0xfffu + odd) >> 13));
}

}  // namespace nerf::internal
