// Numbers of every magnitude that a float has, and kernels run over them in every mode.
#pragma once

#include <bit>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "kernels/kernel_test.h"
#include "nerf/base/threads.h"

namespace nerf::stress {

inline constexpr Real kInf = std::numeric_limits<Real>::infinity();
inline constexpr Real kMax = std::numeric_limits<Real>::max();
inline constexpr Real kDenormal = std::numeric_limits<Real>::denorm_min();
// What is below the smallest normal number may be 0.
inline constexpr double kTiny = std::numeric_limits<Real>::min();

// Numbers at even distances of their bit patterns: each power of two gets as many. Then those whose
// names the header mentions.
inline std::vector<Real> all_magnitudes(uint32_t step, bool negative) {
  std::vector<Real> out = {0.0_r,  kDenormal, 1e-40_r, std::numeric_limits<Real>::min(),
                           kMax,   kInf,      15.0_r,  30.0_r,
                           80.0_r, 88.0_r,    1e4_r,   1e10_r};
  const uint32_t end = std::bit_cast<uint32_t>(std::numeric_limits<float>::infinity());
  for (uint32_t bits = 1; bits < end; bits += step) out.push_back(std::bit_cast<float>(bits));
  if (negative)
    for (size_t i = 0, n = out.size(); i < n; ++i) out.push_back(-out[i]);
  return out;
}

// On every target, with denormals as they are and flushed. Comparisons are made outside.
template <class Kernels, class Compare>
void for_each_mode(const Kernels& kernels, const Compare& compare) {
  for_each_target([&](const std::string&) {
    for (bool flush : {false, true}) {
      SCOPED_TRACE(flush ? "denormals flushed" : "denormals kept");
      {
        const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
        kernels();
      }
      compare();
    }
  });
}

}  // namespace nerf::stress
