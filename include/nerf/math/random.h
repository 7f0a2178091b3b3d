// Counter-based random numbers: a value depends on its key alone, never on what was drawn before,
// so that draws are order-free, replayable and the same on any number of threads.
#pragma once

#include <cmath>
#include <cstdint>

#include "nerf/base/real.h"

namespace nerf {

// Finaliser of SplitMix64 (Steele et al. 2014): a bijection that passes avalanche tests.
inline uint64_t mix64(uint64_t z) {
  z += 0x9e3779b97f4a7c15ull;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

// What numbers are drawn for that belong to no ray of a step. Each stands in the place of a step or
// of an index, which never are so large.
enum class RandomStream : uint64_t {
  // In the place of a step.
  kFirstTable = uint64_t{1} << 63,  // first features; the index is a row
  kFirstNetworks,                   // first weights; the index is a layer
  // In the place of an index.
  kStillPoints = uint64_t{1} << 60,  // points that do not move; the number of one is added
  kRoulette = uint64_t{1} << 61,     // of a chunk, whose number is added
  kPhotoOfStep = uint64_t{1} << 62,  // that all rays of a step come from
  // Added to a step.
  kOccupancy = uint64_t{1} << 62,  // places where cells are refreshed; the index is a group of them
  kMoment = uint64_t{3} << 61,     // their moments; the index is a block of places
};
constexpr uint64_t random_key(RandomStream stream, int64_t number = 0) {
  return static_cast<uint64_t>(stream) + static_cast<uint64_t>(number);
}

// A stream keyed by (seed, step, index); successive dimensions are drawn from it.
class Random {
 public:
  Random(uint64_t seed, uint64_t step, uint64_t index)
      : key_(mix64(mix64(mix64(seed) ^ step) ^ index)) {}

  uint64_t bits() { return mix64(key_ + 0xd1342543de82ef95ull * dimension_++); }
  // Uniform in [0, 1), 24 bits.
  Real uniform() { return static_cast<Real>(bits() >> 40) * 0x1p-24_r; }
  // Of mean 0 and variance 1 (Box and Muller 1958; of the two that two draws give, one).
  Real normal() {
    const Real u = 1 - uniform(), v = uniform();  // u in (0, 1]
    return std::sqrt(-2 * std::log(u)) * std::cos(6.28318531_r * v);
  }
  // Uniform in [0, n), n >= 1.
  uint64_t below(uint64_t n) {
    __extension__ typedef unsigned __int128 Wide;
    return static_cast<uint64_t>((static_cast<Wide>(bits()) * n) >> 64);
  }

 private:
  uint64_t key_;
  uint64_t dimension_ = 0;
};

}  // namespace nerf
