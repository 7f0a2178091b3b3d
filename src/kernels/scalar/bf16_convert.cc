#include <bit>

#include "nerf/kernels/bf16.h"

namespace nerf {

// Integers alone: flushed denormals change nothing.
void round_to_bf16(int64_t n, const float* x, uint16_t* out) {
  for (int64_t i = 0; i < n; ++i) {
    const uint32_t u = std::bit_cast<uint32_t>(x[i]);
    const uint32_t magnitude = u & 0x7fffffffu;
    uint32_t nearest = (u + 0x7fffu + (u >> 16 & 1)) >> 16;
    if (magnitude < 0x00800000u) nearest = u >> 16 & 0x8000u;    // below the normal numbers
    if (magnitude > 0x7f800000u) nearest = (u >> 16) | 0x0040u;  // not a number, made quiet
    out[i] = static_cast<uint16_t>(nearest);
  }
}

void widen_bf16(int64_t n, const uint16_t* x, float* out) {
  for (int64_t i = 0; i < n; ++i) out[i] = std::bit_cast<float>(uint32_t{x[i]} << 16);
}

}  // namespace nerf
