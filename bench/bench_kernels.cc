// Throughput of the kernels, single-threaded, in the shapes that the grid method calls them with.
#include <benchmark/benchmark.h>

#include <string>

#include "app.h"
#include "bench_commands.h"
#include "nerf/base/aligned.h"
#include "nerf/kernels/hash_grid.h"
#include "nerf/kernels/linear.h"
#include "nerf/math/random.h"
#include "nerf/model/grid_field.h"

namespace nerf::apps {
namespace {

AlignedArray<float> noise(size_t n, uint64_t stream) {
  AlignedArray<float> a(n);
  Random random(7, stream, 0);
  for (float& v : a) v = random.uniform() - 0.5f;
  return a;
}

// One layer on one chunk: what forward, input gradient and weight gradient reach. FLOPs are
// 2 x in x out x samples; padding does not count.
struct Layer {
  explicit Layer(const benchmark::State& state)
      : in(static_cast<int>(state.range(0))),
        out(static_cast<int>(state.range(1))),
        x(noise(static_cast<size_t>(in) * kChunkSamples, 1)),
        y(noise(static_cast<size_t>(out) * kChunkSamples, 2)),
        dx(static_cast<size_t>(in) * kChunkSamples),
        w(noise(static_cast<size_t>(weight_stride(in) * out), 3)),
        dw(w.size()) {}
  void finish(benchmark::State& state) const {
    state.counters["FLOP/s"] =
        benchmark::Counter(2.0 * in * out * kChunkSamples * static_cast<double>(state.iterations()),
                           benchmark::Counter::kIsRate);
  }
  int in, out;
  AlignedArray<float> x, y, dx, w, dw;
};

void layer_forward(benchmark::State& state) {
  Layer l(state);
  for (auto _ : state)
    linear_forward(l.in, l.out, l.w.data(), nullptr, l.x.data(), l.y.data(), kChunkSamples,
                   kChunkSamples, LinearActivation::kRelu);
  l.finish(state);
}

void layer_backward_input(benchmark::State& state) {
  Layer l(state);
  for (auto _ : state)
    linear_backward_input(l.in, l.out, l.w.data(), l.y.data(), l.dx.data(), kChunkSamples,
                          kChunkSamples, l.x.data());
  l.finish(state);
}

void layer_backward_weights(benchmark::State& state) {
  Layer l(state);
  for (auto _ : state)
    linear_backward_weights(l.in, l.out, l.y.data(), l.x.data(), kChunkSamples, kChunkSamples,
                            l.dw.data(), nullptr);
  l.finish(state);
}

#define NERF_LAYERS Args({40, 64})->Args({64, 64})->Args({64, 16})->Args({64, 3})->Args({256, 256})
BENCHMARK(layer_forward)->NERF_LAYERS;
BENCHMARK(layer_backward_input)->NERF_LAYERS;
BENCHMARK(layer_backward_weights)->NERF_LAYERS;

// All levels of the default grid over samples along straight rays.
struct Grid {
  explicit Grid(const benchmark::State& state)
      : shape(shape_of(static_cast<int>(state.range(0)))),
        table(noise(shape.rows * kGridFeatures, 4)),
        gradient(table.size()),
        touched(shape.rows),
        x(kSamples),
        y(kSamples),
        z(kSamples),
        features(static_cast<size_t>(shape.features()) * kSamples) {
    for (size_t s = 0; s < kSamples; s += 16) {
      Random random(7, 5, s);
      float p[3], d[3];
      for (int k = 0; k < 3; ++k) {
        p[k] = random.uniform();
        d[k] = (random.uniform() - 0.5f) * 0.01f;
      }
      for (size_t i = s; i < s + 16; ++i) {
        const float t = static_cast<float>(i - s);
        x[i] = p[0] + t * d[0];
        y[i] = p[1] + t * d[1];
        z[i] = p[2] + t * d[2];
      }
    }
  }
  static HashGridShape shape_of(int log2_entries) {
    const GridOptions o;
    return hash_grid_shape(o.levels, log2_entries, o.base_resolution, o.finest_resolution);
  }
  static constexpr size_t kSamples = 1 << 15;
  void finish(benchmark::State& state) const {
    state.SetItemsProcessed(static_cast<int64_t>(kSamples) * state.iterations());
  }
  HashGridShape shape;
  AlignedArray<float> table, gradient;
  AlignedArray<uint8_t> touched;
  AlignedArray<float> x, y, z, features;
};

void grid_forward(benchmark::State& state) {
  Grid g(state);
  for (auto _ : state)
    for (size_t l = 0; l < g.shape.levels.size(); ++l)
      hash_grid_forward(g.shape.levels[l],
                        g.table.data() + g.shape.levels[l].offset * kGridFeatures, g.x.data(),
                        g.y.data(), g.z.data(), Grid::kSamples,
                        g.features.data() + l * kGridFeatures * Grid::kSamples, Grid::kSamples);
  g.finish(state);
}

void grid_backward(benchmark::State& state) {
  Grid g(state);
  g.features = noise(g.features.size(), 6);
  for (auto _ : state)
    for (size_t l = 0; l < g.shape.levels.size(); ++l)
      hash_grid_backward(g.shape.levels[l], g.x.data(), g.y.data(), g.z.data(), Grid::kSamples,
                         g.features.data() + l * kGridFeatures * Grid::kSamples, Grid::kSamples,
                         g.gradient.data() + g.shape.levels[l].offset * kGridFeatures,
                         g.touched.data() + g.shape.levels[l].offset);
  g.finish(state);
}

BENCHMARK(grid_forward)->DenseRange(15, 19);
BENCHMARK(grid_backward)->DenseRange(15, 19);

}  // namespace

int bench_kernels(int argc, char** argv) {
  log_machine("nerf_bench kernels", 1, "f32");
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return kExitUser;
  benchmark::RunSpecifiedBenchmarks();
  return kExitOk;
}

}  // namespace nerf::apps
