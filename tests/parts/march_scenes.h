// Grids of every kind of emptiness, and rays at random.
#pragma once

#include <cmath>
#include <vector>

#include "nerf/math/random.h"
#include "parts/march_check.h"

namespace nerf::march_check {

inline SamplerOptions endless() {
  SamplerOptions options;
  options.min_transmittance = 0;
  return options;
}

inline Vec3d random_direction(Random& random) {
  Vec3d d;
  do {
    for (int i = 0; i < 3; ++i) d[i] = 2 * static_cast<double>(random.uniform()) - 1;
  } while (length(d) < 0.1 || length(d) > 1);
  return normalized(d);
}

inline Vec3d random_point(Random& random, double half) {
  return {half * (2 * random.uniform() - 1.0), half * (2 * random.uniform() - 1.0),
          half * (2 * random.uniform() - 1.0)};
}

inline uint64_t hash_of(const CellPlace& p) {
  return mix64(mix64(static_cast<uint64_t>(p.x + 128 * (p.y + 128 * p.z))) ^
               static_cast<uint64_t>(p.cascade));
}

inline const std::vector<Scene>& scenes() {
  static const std::vector<Scene> all = [] {
    std::vector<Scene> out;
    out.emplace_back("full", 1, [](const CellPlace&) -> uint8_t { return 30; });
    out.emplace_back("noise", 1,
                     [](const CellPlace& p) -> uint8_t { return hash_of(p) & 1 ? 100 : 0; });
    out.emplace_back("checkerboard", 1,
                     [](const CellPlace& p) -> uint8_t { return (p.x + p.y + p.z) & 1 ? 9 : 0; });
    // Few bricks hold matter, a sixteenth.
    out.emplace_back("sparse", 3, [](const CellPlace& p) -> uint8_t {
      const CellPlace brick{p.cascade, p.x / 4, p.y / 4, p.z / 4};
      return hash_of(brick) % 16 == 0 && hash_of(p) % 3 ? 200 : 0;
    });
    out.emplace_back(
        "coarse", 3, [](const CellPlace& p) -> uint8_t { return hash_of(p) & 1 ? 100 : 0; }, 16);
    out.emplace_back(
        "fine", 1, [](const CellPlace& p) -> uint8_t { return hash_of(p) % 3 ? 0 : 40; }, 256);
    // Hardly any does: most of the way is made in jumps.
    out.emplace_back("lonely", 3, [](const CellPlace& p) -> uint8_t {
      return hash_of({p.cascade, p.x / 4, p.y / 4, p.z / 4}) % 1500 == 0 && hash_of(p) % 3 ? 200
                                                                                           : 0;
    });
    out.emplace_back("full_cascades", 3, [](const CellPlace&) -> uint8_t { return 5; });
    return out;
  }();
  return all;
}

}  // namespace nerf::march_check
