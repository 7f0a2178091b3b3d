#include <bit>
#include <cmath>

#include "nerf/kernels/bf16.h"
#include "nerf/math/reference/bf16.h"

namespace nerf {

void round_to_bf16(int64_t n, const float* x, uint16_t* out) {
  for (int64_t i = 0; i < n; ++i) {
    const uint32_t bits = std::bit_cast<uint32_t>(reference::nearest_bf16(x[i])) >> 16;
    out[i] = static_cast<uint16_t>(std::isnan(x[i]) ? bits | 0x0040u : bits);  // made quiet
  }
}

void widen_bf16(int64_t n, const uint16_t* x, float* out) {
  for (int64_t i = 0; i < n; ++i) out[i] = std::bit_cast<float>(uint32_t{x[i]} << 16);
}

}  // namespace nerf
