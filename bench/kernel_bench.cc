#include "kernel_bench.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <ctime>

#include "bench_commands.h"
#include "nerf/kernels/peak.h"
#include "nerf/math/random.h"

namespace nerf::apps {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

// Of all threads of this process, seconds.
double processor_time() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// Where a thread leaves what it computed, in a cache line of its own.
struct alignas(64) Sink {
  Real value = 0;
};

// Rounds of all threads per second. Each thread calls work(thread, rounds), with so many rounds
// that they can be timed.
double rate_per_round(ThreadPool& pool, double seconds,
                      const std::function<void(int64_t thread, int64_t rounds)>& work) {
  int64_t rounds = 1;
  const auto run = [&] { pool.parallel_for(pool.size(), [&](int64_t i) { work(i, rounds); }); };
  for (;; rounds *= 2) {
    const Clock::time_point begin = Clock::now();
    run();
    if (seconds_since(begin) > seconds / 10) break;
  }
  return static_cast<double>(rounds * pool.size()) / time_calls([] {}, run, seconds).least;
}

}  // namespace

AlignedArray<Real> noise(size_t n, uint64_t stream) {
  AlignedArray<Real> a(n);
  Random random(7, stream, 0);
  for (Real& v : a) v = random.uniform() - 0.5_r;
  return a;
}

Timing time_calls(const std::function<void()>& prepare, const std::function<void()>& run,
                  double seconds) {
  constexpr size_t kFewest = 3;
  constexpr double kShortest = 1e-4;  // of one repetition, so that the clock does not count
  prepare();
  run();
  std::vector<double> times;
  double sum = 0, processor_seconds = 0;
  while (times.size() < kFewest || sum < seconds) {
    double time = 0;
    int64_t calls = 0;
    while (time < kShortest) {
      prepare();
      const double processor_begin = processor_time();
      const Clock::time_point begin = Clock::now();
      run();
      time += seconds_since(begin);
      processor_seconds += processor_time() - processor_begin;
      ++calls;
    }
    times.push_back(time / static_cast<double>(calls));
    sum += time;
  }
  return {median(times), *std::min_element(times.begin(), times.end()), processor_seconds / sum};
}

namespace {

double rate_of_loop(ThreadPool& pool, double seconds, int64_t (*loop)(int64_t, Real*)) {
  constexpr int64_t kRounds = 1000;
  std::vector<Sink> sinks(static_cast<size_t>(pool.size()));
  const double flops_per_round = static_cast<double>(loop(kRounds, &sinks[0].value));
  return flops_per_round * rate_per_round(pool, seconds, [&](int64_t thread, int64_t rounds) {
           loop(kRounds * rounds, &sinks[static_cast<size_t>(thread)].value);
         });
}

}  // namespace

double Ceilings::flops() {
  if (flops_ == 0) flops_ = rate_of_loop(pool_, seconds_, fma_loop);
  return flops_;
}

double Ceilings::bf16_flops() {
  if (bf16_flops_ == 0) bf16_flops_ = rate_of_loop(pool_, seconds_, bf16_loop);
  return bf16_flops_;
}

double Ceilings::cached() {
  if (cached_ > 0) return cached_;
  constexpr int64_t kFloats = (16 << 10) / sizeof(Real);
  const AlignedArray<Real> arrays = noise(static_cast<size_t>(pool_.size() * kFloats), 1);
  std::vector<Sink> sinks(static_cast<size_t>(pool_.size()));
  cached_ =
      kFloats * sizeof(Real) * rate_per_round(pool_, seconds_, [&](int64_t thread, int64_t rounds) {
        Real& sink = sinks[static_cast<size_t>(thread)].value;
        for (int64_t r = 0; r < rounds; ++r)
          sink += read_loop(kFloats, arrays.data() + thread * kFloats);
      });
  return cached_;
}

double Ceilings::read(uint64_t bytes) {
  double& rate = read_[bytes];
  if (rate > 0) return rate;
  constexpr int64_t kPiece = 1 << 16, kPage = 1024;  // floats
  const int64_t pieces = std::max<int64_t>(1, static_cast<int64_t>(bytes / sizeof(Real)) / kPiece);
  AlignedArray<Real> array(static_cast<size_t>(pieces * kPiece));
  // Pages that nothing was written to are all the same one.
  pool_.parallel_for(pieces * kPiece / kPage,
                     [&](int64_t i) { array[static_cast<size_t>(i * kPage)] = 1; });
  std::vector<Real> sums(static_cast<size_t>(pieces));
  const auto run = [&] {
    pool_.parallel_for(pieces, [&](int64_t i) {
      sums[static_cast<size_t>(i)] = read_loop(kPiece, array.data() + i * kPiece);
    });
  };
  rate = static_cast<double>(array.size() * sizeof(Real)) / time_calls([] {}, run, seconds_).least;
  return rate;
}

double Ceilings::random_rows(uint64_t table_bytes) {
  const uint64_t bytes = std::bit_ceil(std::max<uint64_t>(table_bytes, 4096));
  double& rate = random_rows_[bytes];
  if (rate > 0) return rate;
  const AlignedArray<Real> table = noise(bytes / sizeof(Real), 1);
  constexpr int64_t kReads = 1 << 12;
  std::vector<Sink> sinks(static_cast<size_t>(pool_.size()));
  rate = kReads * rate_per_round(pool_, seconds_, [&](int64_t thread, int64_t rounds) {
           const uint32_t salt = static_cast<uint32_t>(mix64(static_cast<uint64_t>(thread)));
           sinks[static_cast<size_t>(thread)].value += random_row_loop(
               static_cast<int64_t>(bytes) / kRowBytes, table.data(), kReads * rounds, salt);
         });
  return rate;
}

}  // namespace nerf::apps
