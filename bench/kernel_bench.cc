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

AlignedArray<float> noise(size_t n, uint64_t stream) {
  AlignedArray<float> a(n);
  Random random(7, stream, 0);
  for (float& v : a) v = random.uniform() - 0.5f;
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

Ceilings::Ceilings(ThreadPool& pool, const AlignedArray<float>& stream, double seconds)
    : pool_(pool), seconds_(seconds) {
  std::vector<float> sink(static_cast<size_t>(pool.size()) * kReadUnit);
  const auto sink_of = [&](int64_t thread) { return &sink[static_cast<size_t>(thread) * 128]; };

  constexpr int64_t kRounds = 1000;
  const double flops_per_round = static_cast<double>(fma_loop(kRounds, sink_of(0)));
  flops_ = flops_per_round * rate_per_round(pool, seconds, [&](int64_t thread, int64_t rounds) {
             fma_loop(kRounds * rounds, sink_of(thread));
           });

  constexpr int64_t kCached = (16 << 10) / sizeof(float);
  cached_ =
      kCached * sizeof(float) * rate_per_round(pool, seconds, [&](int64_t thread, int64_t rounds) {
        const int64_t at =
            std::min(thread * kCached, static_cast<int64_t>(stream.size()) - kCached);
        for (int64_t r = 0; r < rounds; ++r)
          *sink_of(thread) += read_loop(kCached, stream.data() + at / kReadUnit * kReadUnit);
      });

  // Every thread takes pieces of the array in turn, so that all of it passes once.
  constexpr int64_t kPiece = 1 << 18;
  const int64_t pieces = static_cast<int64_t>(stream.size()) / kPiece;
  std::vector<float> sums(static_cast<size_t>(pieces));
  stream_ = static_cast<double>(pieces * kPiece) * sizeof(float) /
            time_calls([] {},
                       [&] {
                         pool.parallel_for(pieces, [&](int64_t i) {
                           sums[static_cast<size_t>(i)] =
                               read_loop(kPiece, stream.data() + i * kPiece);
                         });
                       },
                       seconds)
                .least;
}

double Ceilings::random_rows(uint64_t table_bytes) {
  const uint64_t bytes = std::bit_ceil(std::max<uint64_t>(table_bytes, 4096));
  double& rate = random_rows_[bytes];
  if (rate > 0) return rate;
  const AlignedArray<float> table = noise(bytes / sizeof(float), 1);
  constexpr int64_t kReads = 1 << 12;
  std::vector<float> sink(static_cast<size_t>(pool_.size()) * 128);
  rate = kReads * rate_per_round(pool_, seconds_, [&](int64_t thread, int64_t rounds) {
           const uint32_t salt = static_cast<uint32_t>(mix64(static_cast<uint64_t>(thread)));
           sink[static_cast<size_t>(thread) * 128] += random_row_loop(
               static_cast<int64_t>(bytes / 16), table.data(), kReads * rounds, salt);
         });
  return rate;
}

}  // namespace nerf::apps
