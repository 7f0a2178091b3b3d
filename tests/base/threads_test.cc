#include "nerf/base/threads.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <limits>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace nerf {
namespace {

TEST(ThreadPool, RunsEveryIndexExactlyOnce) {
  for (int threads : {1, 2, 5}) {
    ThreadPool pool(threads);
    EXPECT_EQ(pool.size(), threads);
    for (int64_t count : {0, 1, 2, 3, 1000}) {
      std::vector<std::atomic<int>> hits(static_cast<size_t>(count));
      pool.parallel_for(count, [&](int64_t i) { ++hits[static_cast<size_t>(i)]; });
      for (auto& h : hits) EXPECT_EQ(h.load(), 1);
    }
  }
}

TEST(ThreadPool, RethrowsAndStaysUsable) {
  ThreadPool pool(3);
  EXPECT_THROW(pool.parallel_for(100,
                                 [](int64_t i) {
                                   if (i == 17) throw std::runtime_error("17");
                                 }),
               std::runtime_error);
  std::atomic<int> n{0};
  pool.parallel_for(10, [&](int64_t) { ++n; });
  EXPECT_EQ(n.load(), 10);
}

TEST(ThreadPool, TheFirstFailureIsToldWhateverThreadsDo) {
  for (const int threads : {1, 2, 3}) {
    ThreadPool pool(threads);
    for (const int64_t count : {7, 1000})
      for (int repeat = 0; repeat < 20; ++repeat) {
        std::string told;
        try {
          // Later ones fail at once, the first one last.
          pool.parallel_for(count, [&](int64_t i) {
            if (i == 2) std::this_thread::sleep_for(std::chrono::microseconds(100));
            if (i >= 2) throw std::runtime_error(std::to_string(i));
          });
        } catch (const std::runtime_error& e) {
          told = e.what();
        }
        EXPECT_EQ(told, "2") << threads << ' ' << count;
      }
  }
}

TEST(ThreadPool, AThreadWithNothingLeftTakesFromTheOthers) {
  for (const int waiting : {0, 63}) {
    ThreadPool pool(2);
    std::atomic<int> others{0};
    pool.parallel_for(64, [&](int64_t i) {
      if (i != waiting) {
        ++others;
        return;
      }
      // Its thread is held until all else is done, which the other one must do.
      const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
      while (others < 63 && std::chrono::steady_clock::now() < end) std::this_thread::yield();
      EXPECT_EQ(others.load(), 63);
    });
  }
}

TEST(ThreadPool, EachThreadBeginsWithARangeOfItsOwn) {
  ThreadPool pool(2);
  std::vector<int> by(64, -1);
  std::atomic<int> begun{0};
  pool.parallel_for_thread(64, [&](int64_t i, int thread) {
    by[static_cast<size_t>(i)] = thread;
    if (i != 0 && i != 32) return;
    ++begun;  // both are there before either goes on
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (begun < 2 && std::chrono::steady_clock::now() < end) std::this_thread::yield();
  });
  EXPECT_EQ(by[0], 0);
  EXPECT_EQ(by[32], 1);
}

TEST(ThreadPool, ThreadIndexIsWithinThePool) {
  ThreadPool pool(4);
  std::vector<std::atomic<int>> inside(4);
  pool.parallel_for_thread(1000, [&](int64_t, int thread) {
    ASSERT_GE(thread, 0);
    ASSERT_LT(thread, 4);
    // Scratch memory per thread index must never be shared by two running calls.
    EXPECT_EQ(inside[static_cast<size_t>(thread)].fetch_add(1), 0);
    inside[static_cast<size_t>(thread)].fetch_sub(1);
  });
}

TEST(ThreadPool, TwoPoolsInOneProcess) {
  ThreadPool a(2), b(2);
  std::atomic<int> n{0};
  a.parallel_for(8, [&](int64_t) {
    b.size();
    ++n;
  });
  b.parallel_for(8, [&](int64_t) { ++n; });
  EXPECT_EQ(n.load(), 16);
}

#if defined(__x86_64__)
TEST(FlushDenormals, FlushesInsideAndRestoresOutside) {
  volatile float small = std::numeric_limits<float>::min();
  volatile float half = 0.5f;
  const float before = small * half;
  EXPECT_GT(before, 0.0f);
  {
    FlushDenormals guard;
    const float inside = small * half;
    EXPECT_EQ(inside, 0.0f);
  }
  const float after = small * half;
  EXPECT_GT(after, 0.0f);
}

TEST(FlushDenormals, HoldsInEveryPoolThread) {
  ThreadPool pool(3);
  volatile float small = std::numeric_limits<float>::min();
  volatile float half = 0.5f;
  std::atomic<int> not_flushed{0};
  pool.parallel_for(64, [&](int64_t) {
    const float v = small * half;
    if (v != 0.0f) ++not_flushed;
  });
  EXPECT_EQ(not_flushed.load(), 0);
  const float outside = small * half;
  EXPECT_GT(outside, 0.0f);
}
#endif

}  // namespace
}  // namespace nerf
