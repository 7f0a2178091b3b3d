#include "nerf/model/level_order.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

namespace nerf {
namespace {

TEST(LevelOrder, EachLevelOfEachChunkOnce) {
  constexpr int64_t kLevels = 3;
  for (const int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    for (const int64_t chunks : {0, 1, 16, 17, 273}) {
      std::vector<std::atomic<int>> hits(static_cast<size_t>(kLevels * chunks));
      each_level_of_chunks(pool, kLevels, chunks, [&](int64_t level, int64_t first, int64_t last) {
        ASSERT_LT(first, last);
        ASSERT_LE(last, chunks);
        for (int64_t c = first; c < last; ++c) ++hits[static_cast<size_t>(level * chunks + c)];
      });
      for (const auto& h : hits) EXPECT_EQ(h.load(), 1) << threads << ' ' << chunks;
    }
  }
}

// With one thread: the first level of all chunks before the second.
TEST(LevelOrder, LevelByLevel) {
  ThreadPool pool(1);
  int64_t at = 0;
  each_level_of_chunks(pool, 4, 40, [&](int64_t level, int64_t, int64_t) {
    EXPECT_GE(level, at);
    at = level;
  });
  EXPECT_EQ(at, 3);
}

}  // namespace
}  // namespace nerf
