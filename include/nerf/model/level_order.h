// The order in which threads look up the features of a batch of chunks.
#pragma once

#include <algorithm>
#include <cstdint>

#include "nerf/base/threads.h"

namespace nerf {

// Calls body(level, first, last) once for every level and every stretch [first, last) of chunks. A
// thread begins with a part of the chunks, as it does with their networks, and goes through it
// level by level, so that a level's table stays in a cache.
template <class Body>
void each_level_of_chunks(ThreadPool& pool, int64_t levels, int64_t chunks, const Body& body) {
  constexpr int64_t kStretch = 16;
  const int64_t stretches = (chunks + kStretch - 1) / kStretch;
  const int64_t parts = pool.size(), of_part = (stretches + parts - 1) / parts;
  pool.parallel_for(parts * levels * of_part, [&](int64_t i) {
    const int64_t part = i / (levels * of_part), level = i / of_part % levels;
    const int64_t first = std::min(chunks, (part * of_part + i % of_part) * kStretch);
    if (first < chunks) body(level, first, std::min(chunks, first + kStretch));
  });
}

}  // namespace nerf
