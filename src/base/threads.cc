#include "nerf/base/threads.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "cgroup.h"
#include "nerf/base/error.h"

#if defined(__x86_64__)
#include <xmmintrin.h>
#endif
#if defined(__linux__)
#include <sched.h>
#endif

namespace nerf {

int available_processors() {
  int count = static_cast<int>(std::thread::hardware_concurrency());
#if defined(__linux__)
  cpu_set_t set;
  if (sched_getaffinity(0, sizeof(set), &set) == 0) count = CPU_COUNT(&set);
#endif
  const auto limit = internal::cgroup_cpu_limit("/proc/self/cgroup", "/sys/fs/cgroup");
  return std::max(1, limit ? std::min(count, *limit) : count);
}

FlushDenormals::FlushDenormals() {
#if defined(__x86_64__)
  saved_ = _mm_getcsr();
  _mm_setcsr(saved_ | 0x8040u);  // FTZ | DAZ
#elif defined(__aarch64__)
  uint64_t fpcr;
  asm volatile("mrs %0, fpcr" : "=r"(fpcr));
  saved_ = static_cast<unsigned>(fpcr);
  asm volatile("msr fpcr, %0" : : "r"(fpcr | uint64_t{1} << 24));  // FZ
#else
  saved_ = 0;
#endif
}

FlushDenormals::~FlushDenormals() {
#if defined(__x86_64__)
  _mm_setcsr(saved_);
#elif defined(__aarch64__)
  asm volatile("msr fpcr, %0" : : "r"(uint64_t{saved_}));
#endif
}

namespace {

// So many indices for each thread are enough for each to begin with a range of its own.
constexpr int64_t kRangeFrom = 10;

}  // namespace

struct ThreadPool::Impl {
  // Indices [begin, end) that one thread takes from the front and others from the back.
  class alignas(64) Range {
   public:
    void set(int64_t begin, int64_t end) { bounds_ = pack(begin, end); }
    // -1: none left.
    int64_t take_first() {
      uint64_t b = bounds_.load(std::memory_order_relaxed);
      while (begin(b) < end(b))
        if (bounds_.compare_exchange_weak(b, pack(begin(b) + 1, end(b)), std::memory_order_relaxed))
          return begin(b);
      return -1;
    }
    int64_t take_last() {
      uint64_t b = bounds_.load(std::memory_order_relaxed);
      while (begin(b) < end(b))
        if (bounds_.compare_exchange_weak(b, pack(begin(b), end(b) - 1), std::memory_order_relaxed))
          return end(b) - 1;
      return -1;
    }
    static constexpr int64_t kMost = INT32_MAX;

   private:
    static uint64_t pack(int64_t begin, int64_t end) {
      return static_cast<uint64_t>(begin) << 32 | static_cast<uint64_t>(end);
    }
    static int64_t begin(uint64_t b) { return static_cast<int64_t>(b >> 32); }
    static int64_t end(uint64_t b) { return static_cast<int64_t>(b & 0xffffffffu); }
    std::atomic<uint64_t> bounds_{0};
  };

  std::vector<std::thread> workers;
  std::mutex mutex;
  std::condition_variable start, done;
  uint64_t generation = 0;  // of the job; guarded by mutex
  int running = 0;          // workers inside the job; guarded by mutex
  bool stopping = false;

  const std::function<void(int64_t, int)>* job = nullptr;
  int64_t count = 0;
  // Many indices: each thread goes through a range of its own, the same one for the same count, so
  // that what it wrote in one job is in its own cache in the next; then it takes from the others'.
  // Few: one after the other, so that the first of them may be the longest.
  std::vector<Range> ranges;
  bool ranged = false;
  std::atomic<int64_t> next{0};

  std::mutex error_mutex;
  std::exception_ptr error;
  std::atomic<int64_t> failed{0};  // the lowest index that threw; `count`: none did

  void stop() {
    {
      std::lock_guard lock(mutex);
      stopping = true;
    }
    start.notify_all();
    for (auto& t : workers) t.join();
  }

  void share_out(int64_t n) {
    count = failed = n;
    next = 0;
    error = nullptr;
    const int64_t threads = static_cast<int64_t>(ranges.size());
    ranged = n >= kRangeFrom * threads && n <= Range::kMost;
    for (int64_t t = 0; ranged && t < threads; ++t)
      ranges[static_cast<size_t>(t)].set(n * t / threads, n * (t + 1) / threads);
  }

  // -1: none left.
  int64_t take(int thread) {
    if (!ranged) {
      const int64_t i = next.fetch_add(1, std::memory_order_relaxed);
      return i < count ? i : -1;
    }
    const size_t own = static_cast<size_t>(thread), threads = ranges.size();
    int64_t i = ranges[own].take_first();
    for (size_t k = 1; i < 0 && k < threads; ++k) i = ranges[(own + k) % threads].take_last();
    return i;
  }

  void work(int thread) {
    FlushDenormals guard;
    for (int64_t i = take(thread); i >= 0; i = take(thread)) {
      // Those below are run still: which failure is the first does not depend on threads.
      if (i >= failed.load(std::memory_order_relaxed)) continue;
      try {
        (*job)(i, thread);
      } catch (...) {
        std::lock_guard lock(error_mutex);
        if (i < failed) {
          error = std::current_exception();
          failed = i;
        }
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
  impl_->ranges = std::vector<Impl::Range>(static_cast<size_t>(size_));
  try {
    for (int i = 1; i < size_; ++i)
      impl_->workers.emplace_back([impl = impl_.get(), i] { impl->worker_main(i); });
  } catch (const std::system_error&) {
    const size_t started = impl_->workers.size() + 1;
    impl_->stop();
    throw Error("the system lets this process start only " + std::to_string(started) + " of " +
                    std::to_string(size_) + " threads",
                "", "give fewer with --threads");
  }
}

ThreadPool::~ThreadPool() { impl_->stop(); }

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
    p.share_out(count);
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
