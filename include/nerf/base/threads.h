// A fixed pool of worker threads. A pool is an ordinary object that a caller owns and passes on: no
// global state, any number of pools in a process.
//
// parallel_for runs fn(i) for every i in [0, count), each exactly once, on all threads of the pool
// including the caller's. Which thread takes which i is not defined, so results must not depend on
// it: cut work by the problem's size and never by the number of threads, and every result is
// bit-identical for any thread count. Within fn, denormals are flushed to zero on every thread and
// the caller's floating-point state is restored afterwards. An exception thrown by fn is rethrown
// on the caller (the one of the lowest i that threw); the remaining indices may be skipped.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

namespace nerf {

class ThreadPool {
 public:
  // threads <= 0 takes the number of processors this process may run on (affinity and the
  // container's CPU quota respected).
  explicit ThreadPool(int threads = 0);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int size() const { return size_; }

  // Not reentrant: fn must not call parallel_for of the same pool.
  void parallel_for(int64_t count, const std::function<void(int64_t)>& fn);
  // The same, with the index of the executing thread in [0, size()) for per-thread scratch memory.
  void parallel_for_thread(int64_t count, const std::function<void(int64_t i, int thread)>& fn);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  int size_ = 1;
};

// Processors available to this process: the affinity mask cut by the cgroup CPU quota, at least 1.
int available_processors();

// Flushes denormals (FTZ and DAZ) on this thread while it lives; restores the former state.
class FlushDenormals {
 public:
  FlushDenormals();
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned saved_;
};

}  // namespace nerf
