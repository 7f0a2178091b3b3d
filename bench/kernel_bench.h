// What the measurements of nerf_bench kernels share: timing, the machine's ceilings, the kernels as
// a list of cases.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/base/real.h"
#include "nerf/base/threads.h"

namespace nerf::apps {

// Uniform in [-0.5, 0.5).
AlignedArray<Real> noise(size_t n, uint64_t stream);

// Duration of a call, seconds of wall clock.
struct Timing {
  double median = 0, least = 0;  // over the repetitions
  double processors = 0;         // that the process had on average: below its threads, others ran
};

// Repeats run() for `seconds` in all, at least three times. The first call is not counted;
// prepare() runs before each call, outside the clock.
Timing time_calls(const std::function<void()>& prepare, const std::function<void()>& run,
                  double seconds);

// The most that the machine does, with the SIMD target in use and the pool's threads together. Each
// is measured when it is first asked for; the fastest repetition counts, since a ceiling is what
// can be reached.
class Ceilings {
 public:
  Ceilings(ThreadPool& pool, double seconds) : pool_(pool), seconds_(seconds) {}

  double flops();       // f32 multiply-adds, FLOP/s
  double bf16_flops();  // of the bf16 unit in use
  double cached();      // read in order, again and again 16 KB by each thread, bytes/s
  // Read in order, again and again the same array of so many bytes by all threads, bytes/s.
  double read(uint64_t bytes);
  // Rows of kRowBytes (peak.h) read at random places of one table, rows/s; its size is rounded up
  // to a power of two.
  double random_rows(uint64_t table_bytes);

 private:
  ThreadPool& pool_;
  double seconds_;
  double flops_ = 0, bf16_flops_ = 0, cached_ = 0;
  std::map<uint64_t, double> read_, random_rows_;
};

// A kernel with its arrays.
struct KernelRun {
  double work = 0;                           // of one run(), in the case's unit
  double bytes = 0;                          // of kSamples: that it must read and write
  std::function<double(Ceilings&)> ceiling;  // work per second
  std::function<void(ThreadPool&)> run;
  std::function<void()> prepare = [] {};
};

enum class Unit { kFlops, kBytes, kSamples };

struct KernelCase {
  std::string name;
  Unit unit = Unit::kFlops;
  std::string bound;                           // what its ceiling is
  std::function<KernelRun(int threads)> make;  // for pools of at most so many threads
  // The same on the bf16 unit in use; empty where the kernel knows f32 only.
  std::function<KernelRun(int threads)> make_bf16 = {};
};

std::vector<KernelCase> network_cases();
std::vector<KernelCase> grid_cases();
std::vector<KernelCase> elementwise_cases();
std::vector<KernelCase> ray_cases();
std::vector<KernelCase> descriptor_cases();

// Bounds of the cases.
inline constexpr const char* kBoundFma = "FMA";
inline constexpr const char* kBoundRead = "reading in order";
inline constexpr const char* kBoundCached = "L1";
inline constexpr const char* kBoundRows = "random rows";

}  // namespace nerf::apps
