#include "nerf/base/threads.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <fstream>
#include <limits>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "nerf/base/error.h"

#if defined(__x86_64__)
#include <xmmintrin.h>
#endif
#if defined(__linux__)
#include <sched.h>
#endif

namespace nerf {

namespace {

// cgroup v2 "max 100000" or "200000 100000"; v1 has quota and period in two files.
int cgroup_cpu_limit() {
  {
    std::ifstream f("/sys/fs/cgroup/cpu.max");
    std::string quota;
    double period = 0;
    if (f >> quota >> period && quota != "max" && period > 0)
      return std::max(1, static_cast<int>(std::stod(quota) / period + 0.5));
  }
  std::ifstream q("/sys/fs/cgroup/cpu/cpu.cfs_quota_us");
  std::ifstream p("/sys/fs/cgroup/cpu/cpu.cfs_period_us");
  double quota = 0, period = 0;
  if (q >> quota && p >> period && quota > 0 && period > 0)
    return std::max(1, static_cast<int>(quota / period + 0.5));
  return std::numeric_limits<int>::max();
}

}  // namespace

int available_processors() {
  int count = static_cast<int>(std::thread::hardware_concurrency());
#if defined(__linux__)
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof(set), &set) == 0) count = CPU_COUNT(&set);
#endif
  return std::max(1, std::min(count, cgroup_cpu_limit()));
}

FlushDenormals::FlushDenormals() {
#if defined(__x86_64__)
  saved_ = _mm_getcsr();
  _mm_setcsr(saved_ | 0x8040u);  // FTZ | DAZ
#else
  saved_ = 0;
#endif
}

FlushDenormals::~FlushDenormals() {
#if defined(__x86_64__)
  _mm_setcsr(saved_);
#endif
}

struct ThreadPool::Impl {
  std::vector<std::thread> workers;
  std::mutex mutex;
  std::condition_variable start, done;
  uint64_t generation = 0;  // of the job; guarded by mutex
  int running = 0;          // workers inside the job; guarded by mutex
  bool stopping = false;

  const std::function<void(int64_t, int)>* job = nullptr;
  int64_t count = 0;
  std::atomic<int64_t> next{0};

  std::mutex error_mutex;
  std::exception_ptr error;
  int64_t error_index = 0;
  std::atomic<bool> failed{false};

  void work(int thread) {
    FlushDenormals guard;
    while (!failed.load(std::memory_order_relaxed)) {
      const int64_t i = next.fetch_add(1, std::memory_order_relaxed);
      if (i >= count) return;
      try {
        (*job)(i, thread);
      } catch (...) {
        std::lock_guard lock(error_mutex);
        if (!error || i < error_index) {
          error = std::current_exception();
          error_index = i;
        }
        failed = true;
      }
    }
  }

  void worker_main(int thread) {
    uint64_t seen = 0;
    std::unique_lock lock(mutex);
    for (;;) {
      start.wait(lock, [&] { return stopping || generation != seen; });
      if (stopping) return;
      seen = generation;
      lock.unlock();
      work(thread);
      lock.lock();
      if (--running == 0) done.notify_one();
    }
  }
};

ThreadPool::ThreadPool(int threads) : impl_(std::make_unique<Impl>()) {
  size_ = threads > 0 ? threads : available_processors();
  for (int i = 1; i < size_; ++i) impl_->workers.emplace_back([this, i] { impl_->worker_main(i); });
}

ThreadPool::~ThreadPool() {
  {
    std::lock_guard lock(impl_->mutex);
    impl_->stopping = true;
  }
  impl_->start.notify_all();
  for (auto& t : impl_->workers) t.join();
}

void ThreadPool::parallel_for(int64_t count, const std::function<void(int64_t)>& fn) {
  parallel_for_thread(count, [&fn](int64_t i, int) { fn(i); });
}

void ThreadPool::parallel_for_thread(int64_t count, const std::function<void(int64_t, int)>& fn) {
  if (count <= 0) return;
  Impl& p = *impl_;
  {
    std::lock_guard lock(p.mutex);
    NERF_CHECK(p.job == nullptr);  // not reentrant
    p.job = &fn;
    p.count = count;
    p.next = 0;
    p.error = nullptr;
    p.failed = false;
    // With one item there is nothing to share: the workers stay asleep.
    if (count > 1 && !p.workers.empty()) {
      p.running = static_cast<int>(p.workers.size());
      ++p.generation;
    }
  }
  if (count > 1) p.start.notify_all();
  p.work(0);
  std::unique_lock lock(p.mutex);
  p.done.wait(lock, [&] { return p.running == 0; });
  p.job = nullptr;
  if (p.error) {
    const std::exception_ptr error = p.error;
    p.error = nullptr;
    lock.unlock();
    std::rethrow_exception(error);
  }
}

}  // namespace nerf
