// Elementwise kernels, encodings and conversions on a thread's chunk, which stays in its cache.
#include <algorithm>
#include <memory>

#include "kernel_bench.h"
#include "nerf/kernels/bf16.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/kernels/encoding.h"
#include "nerf/kernels/linear.h"
#include "nerf/model/grid_field.h"

namespace nerf::apps {
namespace {

constexpr int64_t kChunks = 1 << 10;

constexpr int64_t kRows = 16;  // of a chunk's features that are transposed

struct ElementwiseArrays {
  ElementwiseArrays() { relu_forward(kChunkSamples, a.data(), rectified.data()); }
  AlignedArray<Real> a = noise(kChunkSamples, 1), b = noise(kChunkSamples, 2);
  AlignedArray<Real> c = noise(kChunkSamples, 3), d = noise(kChunkSamples, 4);
  AlignedArray<Real> rows = noise(kRows * kChunkSamples, 5);
  AlignedArray<Real> variance{kChunkSamples}, rectified{kChunkSamples};
  AlignedArray<Real> out{kChunkSamples}, out2{kChunkSamples}, turned{kRows * kChunkSamples};
  AlignedArray<float> wide{kChunkSamples};
  AlignedArray<uint16_t> narrow{kChunkSamples};
};

// `arrays` of floats that are read or written for each value.
KernelCase elementwise(const char* name, double arrays, void (*kernel)(ElementwiseArrays&)) {
  return {name, Unit::kBytes, kBoundCached, [=](int threads) {
            auto all = std::make_shared<std::vector<ElementwiseArrays>>(threads);
            KernelRun run;
            run.work = static_cast<double>(kChunks * kChunkSamples) * arrays * sizeof(Real);
            run.ceiling = [](Ceilings& c) { return c.cached(); };
            run.run = [=](ThreadPool& pool) {
              pool.parallel_for_thread(kChunks, [&](int64_t, int thread) {
                kernel((*all)[static_cast<size_t>(thread)]);
              });
            };
            return run;
          }};
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
      elementwise("softplus forward", 2,
                  [](A& a) { softplus_forward(n, -1, a.a.data(), a.out.data()); }),
      elementwise("softplus backward", 3,
                  [](A& a) { softplus_backward(n, -1, a.a.data(), a.b.data(), a.out.data()); }),
      elementwise("ReLU forward", 2, [](A& a) { relu_forward(n, a.a.data(), a.out.data()); }),
      elementwise("ReLU backward", 3,
                  [](A& a) { relu_backward(1, a.rectified.data(), a.b.data(), n, n); }),
      elementwise("transpose, 16 rows", 2 * kRows,
                  [](A& a) { transpose(n, kRows, a.rows.data(), n, a.turned.data(), kRows); }),
      // A weight of 1, or a window's: the same kernel.
      elementwise("sine and cosine forward", 3,
                  [](A& a) {
                    sine_cosine_forward(n, a.a.data(), nullptr, 64, 0.5_r, a.out.data(),
                                        a.out2.data());
                  }),
      elementwise("sine and cosine forward, damped", 4,
                  [](A& a) {
                    sine_cosine_forward(n, a.a.data(), a.variance.data(), 64, 1, a.out.data(),
                                        a.out2.data());
                  }),
      elementwise("sine and cosine backward", 6,
                  [](A& a) {
                    sine_cosine_backward(n, a.a.data(), a.b.data(), a.c.data(), a.d.data(), 64,
                                         a.out.data(), nullptr);
                  }),
      elementwise("sine and cosine backward, damped", 8,
                  [](A& a) {
                    sine_cosine_backward(n, a.a.data(), a.b.data(), a.c.data(), a.d.data(), 64,
                                         a.out.data(), a.out2.data());
                  }),
      elementwise("f32 to bf16", 1.5 * sizeof(float) / sizeof(Real),
                  [](A& a) { round_to_bf16(n, a.wide.data(), a.narrow.data()); }),
      elementwise("bf16 to f32", 1.5 * sizeof(float) / sizeof(Real),
                  [](A& a) { widen_bf16(n, a.narrow.data(), a.wide.data()); }),
      elementwise("opacity", 3, [](A& a) { opacity(n, a.a.data(), a.b.data(), a.out.data()); }),
      elementwise("add", 3, [](A& a) { add_to(n, a.a.data(), a.out.data()); }),
  };
}

}  // namespace nerf::apps
