// Elementwise kernels and compositing on a thread's chunk, which stays in its cache.
#include <algorithm>
#include <memory>

#include "kernel_bench.h"
#include "nerf/autodiff/operations.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/model/grid_field.h"

namespace nerf::apps {
namespace {

constexpr int64_t kChunks = 1 << 10;

struct ElementwiseArrays {
  AlignedArray<Real> a = noise(kChunkSamples, 1), b = noise(kChunkSamples, 2);
  AlignedArray<Real> out{kChunkSamples};
};

// `arrays` of floats that are read or written for each value.
KernelCase elementwise(const char* name, int arrays, void (*kernel)(ElementwiseArrays&)) {
  return {name, Unit::kBytes, kBoundCached, [=](int threads) {
            auto all = std::make_shared<std::vector<ElementwiseArrays>>(threads);
            KernelRun run;
            run.work = static_cast<double>(kChunks * kChunkSamples * arrays) * sizeof(Real);
            run.ceiling = [](Ceilings& c) { return c.cached(); };
            run.run = [=](ThreadPool& pool) {
              pool.parallel_for_thread(kChunks, [&](int64_t, int thread) {
                kernel((*all)[static_cast<size_t>(thread)]);
              });
            };
            return run;
          }};
}

// Rays of sixteen samples through the tape's compositing, forward and backward.
class Compositing {
 public:
  explicit Compositing(int threads) {
    density_ = tape_.input(1, Domain::kSamples, true);
    colour_ = tape_.input(3, Domain::kSamples, true);
    const Value delta = tape_.input(1, Domain::kSamples);
    const Value background = tape_.input(3, Domain::kRays);
    image_ = composite(tape_, density_, colour_, delta, background);
    tape_.plan();
    for (int r = 0; r <= kRays; ++r) ray_begin_.push_back(r * kSamplesPerRay);
    for (int i = 0; i < threads; ++i) {
      chunks_.push_back(std::make_unique<Chunk>(tape_));
      Chunk& c = *chunks_.back();
      c.samples = kChunkSamples;
      c.rays = kRays;
      c.ray_begin = ray_begin_.data();
      std::fill_n(c.data(density_), kChunkSamples, 2.0_r);
      std::fill_n(c.data(colour_), 3 * kChunkSamples, 0.5_r);
      std::fill_n(c.data(delta), kChunkSamples, 0.05_r);
      std::fill_n(c.data(background), 3 * c.stride(background), 1.0_r);
    }
  }
  void run(ThreadPool& pool) {
    pool.parallel_for_thread(kChunks, [&](int64_t, int thread) {
      Chunk& c = *chunks_[static_cast<size_t>(thread)];
      tape_.forward(c);
      std::fill_n(c.gradient(image_.pixel), 4 * c.stride(image_.pixel), 0.1_r);
      tape_.backward(c);
    });
  }

 private:
  static constexpr int kSamplesPerRay = 16, kRays = kChunkSamples / kSamplesPerRay;
  Tape tape_{kChunkSamples, kChunkRays};
  Value density_ = 0, colour_ = 0;
  Composite image_{};
  std::vector<int32_t> ray_begin_;
  std::vector<std::unique_ptr<Chunk>> chunks_;
};

KernelRun compositing_run(int threads) {
  auto compositing = std::make_shared<Compositing>(threads);
  KernelRun run;
  run.work = static_cast<double>(kChunks * kChunkSamples);
  // Forward density, length and three colours in, a weight out; backward those six in, four out.
  constexpr double kBytes = (6 + 10) * sizeof(Real);
  run.ceiling = [](Ceilings& c) { return c.cached() / kBytes; };
  run.run = [compositing](ThreadPool& pool) { compositing->run(pool); };
  return run;
}

}  // namespace

std::vector<KernelCase> elementwise_cases() {
  using A = ElementwiseArrays;
  constexpr int64_t n = kChunkSamples;
  return {
      elementwise("truncated exp forward", 2,
                  [](A& a) { truncated_exp_forward(n, a.a.data(), a.out.data()); }),
      elementwise("truncated exp backward", 3,
                  [](A& a) { truncated_exp_backward(n, a.a.data(), a.b.data(), a.out.data()); }),
      elementwise("sigmoid forward", 2, [](A& a) { sigmoid_forward(n, a.a.data(), a.out.data()); }),
      elementwise("sigmoid backward", 3,
                  [](A& a) { sigmoid_backward(n, a.a.data(), a.b.data(), a.out.data()); }),
      elementwise("opacity", 3, [](A& a) { opacity(n, a.a.data(), a.b.data(), a.out.data()); }),
      elementwise("add", 3, [](A& a) { add_to(n, a.a.data(), a.out.data()); }),
      {"compositing forward+backward, 16 samples per ray", Unit::kSamples, kBoundCached,
       compositing_run},
  };
}

}  // namespace nerf::apps
