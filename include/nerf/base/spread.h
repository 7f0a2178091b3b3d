// A few of many.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace nerf {

// Indices of `most` of n things, or of all, spread evenly and rising: the middles of equal parts.
inline std::vector<size_t> spread_evenly(size_t n, size_t most) {
  const size_t take = std::min(n, most);
  std::vector<size_t> out(take);
  for (size_t i = 0; i < take; ++i) out[i] = (2 * i + 1) * n / (2 * take);
  return out;
}

}  // namespace nerf
