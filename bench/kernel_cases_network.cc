// The networks' kernels: single layers, and whole networks as a training step runs them.
#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <numeric>

#include "kernel_bench.h"
#include "nerf/autodiff/operations.h"
#include "nerf/autodiff/tape.h"
#include "nerf/kernels/bf16.h"
#include "nerf/kernels/linear.h"
#include "nerf/kernels/linear_bf16.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/network_levels.h"

namespace nerf::apps {
namespace {

constexpr int64_t kLayerSamples = 1 << 16;

double fma_ceiling(Ceilings& c) { return c.flops(); }
double bf16_ceiling(Ceilings& c) { return c.bf16_flops(); }

// A thread's chunk of one layer, which stays in its cache.
struct LayerArrays {
  LayerArrays(int in, int out)
      : x(noise(static_cast<size_t>(in) * kChunkSamples, 1)),
        y(noise(static_cast<size_t>(out) * kChunkSamples, 2)),
        dx(x.size()),
        w(noise(static_cast<size_t>(weight_stride(in) * out), 3)),
        dw(w.size()),
        pack(static_cast<size_t>(linear_pack_size(in, out))),
        pack_bf16(static_cast<size_t>(packed_layer_size(in, out))) {}
  AlignedArray<Real> x, y, dx, w, dw, pack;
  AlignedArray<uint16_t> pack_bf16;
};

using LayerKernel = void (*)(int in, int out, LayerArrays& a);

void forward(int in, int out, LayerArrays& a) {
  linear_forward(in, out, a.w.data(), nullptr, a.x.data(), a.y.data(), kChunkSamples, kChunkSamples,
                 LinearActivation::kRelu, a.pack.data());
}
void backward_input(int in, int out, LayerArrays& a) {
  linear_backward_input(in, out, a.w.data(), a.y.data(), a.dx.data(), kChunkSamples, kChunkSamples,
                        a.x.data(), a.pack.data());
}
void backward_weights(int in, int out, LayerArrays& a) {
  linear_backward_weights(in, out, a.y.data(), a.x.data(), kChunkSamples, kChunkSamples,
                          a.dw.data(), nullptr);
}

void forward_bf16(int in, int out, LayerArrays& a) {
  linear_forward_bf16(in, out, a.pack_bf16.data(), nullptr, a.x.data(), a.y.data(), kChunkSamples,
                      kChunkSamples, LinearActivation::kRelu);
}
void backward_input_bf16(int in, int out, LayerArrays& a) {
  linear_backward_input_bf16(in, out, a.pack_bf16.data(), a.y.data(), a.dx.data(), kChunkSamples,
                             kChunkSamples, a.x.data());
}
void backward_weights_bf16(int in, int out, LayerArrays& a) {
  linear_backward_weights_bf16(in, out, a.y.data(), a.x.data(), kChunkSamples, kChunkSamples,
                               a.dw.data(), nullptr);
}

KernelRun layer_run(int in, int out, int threads, Precision precision, LayerKernel kernel) {
  auto arrays = std::make_shared<std::vector<LayerArrays>>();
  for (int i = 0; i < threads; ++i) {
    arrays->emplace_back(in, out);
    LayerArrays& own = arrays->back();
    if (precision == Precision::kBf16)
      pack_layer(in, out, own.w.data(), own.pack_bf16.data());
    else
      linear_pack(in, out, own.w.data(), own.pack.data());
  }
  const int64_t chunks = kLayerSamples / kChunkSamples;
  KernelRun run;
  run.work = 2.0 * in * out * static_cast<double>(chunks * kChunkSamples);
  run.ceiling = precision == Precision::kBf16 ? bf16_ceiling : fma_ceiling;
  run.run = [=](ThreadPool& pool) {
    pool.parallel_for_thread(chunks, [&](int64_t, int thread) {
      kernel(in, out, (*arrays)[static_cast<size_t>(thread)]);
    });
  };
  return run;
}

// Forward alone; each chunk forward and then backward while its values are in a cache, as the
// trainers go; or forward over the whole batch, whose values wait in memory, and then backward.
enum class Passes { kForward, kByChunk, kWholeBatch };

// The layers of a network, one behind the other, and so their packs.
std::vector<LinearWeights> layers_of(const std::vector<int>& widths) {
  std::vector<LinearWeights> layers;
  size_t size = 0;
  for (size_t l = 0; l + 1 < widths.size(); ++l) {
    const LinearWeights w{size, widths[l], widths[l + 1]};
    size += w.size();
    layers.push_back(w);
  }
  std::vector<LinearWeights*> placed;
  for (LinearWeights& w : layers) placed.push_back(&w);
  place_packs(placed);
  return layers;
}

// ReLU layers with a linear last one, on a tape as the model records it.
class Network {
 public:
  Network(const std::vector<int>& widths, int64_t samples, Passes passes, int threads,
          Precision precision)
      : samples_(samples),
        passes_(passes),
        backward_(passes != Passes::kForward),
        precision_(precision),
        chunk_samples_(chunk_samples(widths)),
        tape_(chunk_samples_, kLane),
        layers_(layers_of(widths)) {
    const size_t size = layers_.back().offset + layers_.back().size();
    input_ = tape_.input(widths.front(), Domain::kSamples, backward_);
    output_ = mlp(tape_, input_, layers_);
    tape_.plan();
    weights_ = AlignedArray<Real>(size);
    for (const LinearWeights& w : layers_) {
      const AlignedArray<Real> random = noise(static_cast<size_t>(w.in) * w.out, w.offset);
      const Real scale = 2 * std::sqrt(6.0_r / static_cast<Real>(w.in));
      for (int j = 0; j < w.out; ++j)
        for (int k = 0; k < w.in; ++k)
          weights_[w.offset + static_cast<size_t>(j * weight_stride(w.in) + k)] =
              scale * random[static_cast<size_t>(j * w.in + k)];
    }
    const size_t floats = static_cast<size_t>(chunks()) * floats_of(input_);
    features_ = noise(floats, 4);
    if (backward_) d_features_ = AlignedArray<Real>(floats);
    d_output_ = noise(floats_of(output_), 5);
    if (passes == Passes::kWholeBatch)
      for (Value v = 0; v <= output_; ++v)
        kept_.emplace_back(v == input_ ? 0 : static_cast<size_t>(chunks()) * floats_of(v));
    for (int i = 0; i < threads; ++i) {
      chunks_.push_back(std::make_unique<Chunk>(tape_));
      gradients_.emplace_back(size);
      chunks_.back()->weights = weights_.data();
      chunks_.back()->packs = &packs_;
      chunks_.back()->weight_gradient = gradients_.back().data();
    }
  }

  double flops() const {
    double multiply_adds = 0;
    for (const LinearWeights& w : layers_) multiply_adds += static_cast<double>(w.in) * w.out;
    return 2 * (backward_ ? 3 : 1) * multiply_adds * static_cast<double>(samples_);
  }

  void run(ThreadPool& pool) {
    pack_layers(layers_, weights_.data(), precision_, packs_, pool);
    const auto each_chunk = [&](const auto& body) {
      pool.parallel_for_thread(chunks(), [&](int64_t c, int thread) {
        Chunk& chunk = *chunks_[static_cast<size_t>(thread)];
        take(chunk, c);
        body(chunk);
      });
    };
    const auto forward = [&](Chunk& chunk) { tape_.forward(chunk); };
    const auto backward = [&](Chunk& chunk) {
      std::memcpy(chunk.gradient(output_), d_output_.data(), d_output_.size() * sizeof(Real));
      tape_.backward(chunk);
    };
    if (passes_ == Passes::kByChunk)
      return each_chunk([&](Chunk& chunk) {
        forward(chunk);
        backward(chunk);
      });
    each_chunk(forward);
    if (passes_ == Passes::kWholeBatch) each_chunk(backward);
  }

 private:
  // As the trainers have them: those of the grid for narrow networks, of the paper methods for
  // wide.
  static int chunk_samples(const std::vector<int>& widths) {
    const int widest = std::ranges::max(widths);
    return widest <= 64 ? kChunkSamples : NetworkLevels::chunk_samples(widest);
  }
  int64_t chunks() const { return (samples_ + chunk_samples_ - 1) / chunk_samples_; }
  size_t floats_of(Value v) const {
    return static_cast<size_t>(tape_.rows(v)) *
           static_cast<size_t>(tape_.capacity(Domain::kSamples));
  }
  // As the grid's trainer: features are read where the lookups put them, and their gradient goes
  // where the scatter reads it.
  void take(Chunk& chunk, int64_t c) {
    chunk.samples =
        static_cast<int>(std::min<int64_t>(chunk_samples_, samples_ - c * int64_t{chunk_samples_}));
    const size_t at = static_cast<size_t>(c) * floats_of(input_);
    chunk.bind(input_, features_.data() + at, backward_ ? d_features_.data() + at : nullptr);
    for (Value v = 0; v < static_cast<Value>(kept_.size()); ++v)
      if (AlignedArray<Real>& kept = kept_[static_cast<size_t>(v)]; kept.size() > 0)
        chunk.bind(v, kept.data() + static_cast<size_t>(c) * floats_of(v), nullptr);
  }

  int64_t samples_;
  Passes passes_;
  bool backward_;
  Precision precision_;
  int chunk_samples_;
  Tape tape_;
  std::vector<LinearWeights> layers_;
  Value input_ = 0, output_ = 0;
  AlignedArray<Real> weights_, features_, d_features_, d_output_;
  LayerPacks packs_;
  std::vector<std::unique_ptr<Chunk>> chunks_;
  std::vector<AlignedArray<Real>> gradients_;
  std::vector<AlignedArray<Real>> kept_;  // each value of the whole batch, between two passes
};

KernelRun network_run(const std::vector<int>& widths, int64_t samples, Passes passes, int threads,
                      Precision precision) {
  auto network = std::make_shared<Network>(widths, samples, passes, threads, precision);
  KernelRun run;
  run.work = network->flops();
  run.ceiling = precision == Precision::kBf16 ? bf16_ceiling : fma_ceiling;
  run.run = [network](ThreadPool& pool) { network->run(pool); };
  return run;
}

// The weights of a network that is to be multiplied by, packed anew as after each step of training;
// in f32 those of its wide layers. They are read, and the packs written with their padding.
struct PackedNetwork {
  explicit PackedNetwork(const std::vector<int>& widths) : layers(layers_of(widths)) {
    weights = noise(layers.back().offset + layers.back().size(), 1);
  }
  double bytes(Precision precision) const {
    const bool bf16 = precision == Precision::kBf16;
    double sum = 0;
    for (const LinearWeights& w : layers) {
      const int64_t pack = bf16 ? packed_layer_size(w.in, w.out) : linear_pack_size(w.in, w.out);
      if (pack > 0)
        sum += static_cast<double>(w.parameters()) * sizeof(Real) +
               static_cast<double>(pack) * (bf16 ? sizeof(uint16_t) : sizeof(Real));
    }
    return sum;
  }
  std::vector<LinearWeights> layers;
  AlignedArray<Real> weights;
  LayerPacks packs;
};

KernelRun packing_run(const std::vector<int>& widths, Precision precision) {
  auto network = std::make_shared<PackedNetwork>(widths);
  KernelRun run;
  run.work = network->bytes(precision);
  run.ceiling = [bytes = static_cast<uint64_t>(run.work)](Ceilings& c) { return c.read(bytes); };
  run.run = [=](ThreadPool& pool) {
    pack_layers(network->layers, network->weights.data(), precision, network->packs, pool);
  };
  return run;
}

KernelCase packing_case(const char* name, const std::vector<int>& widths) {
  KernelCase packing{fmt::format("weight packing {}", name), Unit::kBytes, kBoundRead, {}, {}};
  if (PackedNetwork(widths).bytes(Precision::kF32) > 0)
    packing.make = [=](int) { return packing_run(widths, Precision::kF32); };
  packing.make_bf16 = [=](int) { return packing_run(widths, Precision::kBf16); };
  return packing;
}

}  // namespace

std::vector<KernelCase> network_cases() {
  std::vector<KernelCase> cases;
  constexpr struct {
    int in, out;
  } kLayers[] = {{32, 64}, {40, 64}, {64, 64}, {64, 16}, {64, 3}, {256, 256}};
  constexpr struct {
    const char* name;
    LayerKernel kernel, kernel_bf16;
  } kKernels[] = {{"forward", forward, forward_bf16},
                  {"backward input", backward_input, backward_input_bf16},
                  {"backward weights", backward_weights, backward_weights_bf16}};
  for (const auto& layer : kLayers)
    for (const auto& k : kKernels) {
      const auto make = [=](Precision precision) {
        return [=](int threads) {
          return layer_run(layer.in, layer.out, threads, precision,
                           precision == Precision::kBf16 ? k.kernel_bf16 : k.kernel);
        };
      };
      cases.push_back({fmt::format("linear {}-{} {}", layer.in, layer.out, k.name), Unit::kFlops,
                       kBoundFma, make(Precision::kF32), make(Precision::kBf16)});
    }
  const struct {
    const char* name;
    std::vector<int> widths;
    std::vector<int> log2_samples;
  } networks[] = {{"32-64-64-16", {32, 64, 64, 16}, {18, 12}},
                  {"32-64-64-64-3", {32, 64, 64, 64, 3}, {18, 12}},
                  {"63-256x8-4", {63, 256, 256, 256, 256, 256, 256, 256, 256, 4}, {14}},
                  {"504-1024x4-4", {504, 1024, 1024, 1024, 1024, 4}, {12}}};
  const struct {
    const char* name;
    Passes passes;
  } passes[] = {{"forward", Passes::kForward},
                {"forward+backward", Passes::kByChunk},
                {"forward, then backward", Passes::kWholeBatch}};
  for (const auto& n : networks)
    for (const int log2 : n.log2_samples)
      for (const auto& p : passes) {
        const auto make = [=](Precision precision) {
          return [=](int threads) {
            return network_run(n.widths, int64_t{1} << log2, p.passes, threads, precision);
          };
        };
        cases.push_back({fmt::format("MLP {} {}, 2^{} samples", n.name, p.name, log2), Unit::kFlops,
                         kBoundFma, make(Precision::kF32), make(Precision::kBf16)});
      }
  for (const auto& n : networks)
    if (KernelCase packing = packing_case(n.name, n.widths); packing.make || !bf16_units().empty())
      cases.push_back(std::move(packing));
  return cases;
}

}  // namespace nerf::apps
