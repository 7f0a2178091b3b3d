// The numbers that the scripts of this folder train on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "nerf/base/real.h"

namespace nerf {

// n numbers of 24 bits in [0, 1): the finaliser of MurmurHash3 over a counter.
inline std::vector<Real> golden_draw(uint32_t stream, size_t n) {
  std::vector<Real> out;
  for (uint32_t i = 0; i < n; ++i) {
    uint32_t h = i * 2654435761u + stream * 2654435769u;
    h = (h ^ (h >> 16)) * 0x85EBCA6Bu;
    h = (h ^ (h >> 13)) * 0xC2B2AE35u;
    h ^= h >> 16;
    out.push_back(static_cast<Real>(h >> 8) * 0x1p-24_r);
  }
  return out;
}

}  // namespace nerf
