// What is done along rays: drawing samples, view directions, compositing.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "kernel_bench.h"
#include "nerf/autodiff/operations.h"
#include "nerf/kernels/encoding.h"
#include "nerf/kernels/linear.h"
#include "nerf/kernels/linear_bf16.h"
#include "nerf/kernels/resampling.h"
#include "nerf/kernels/roulette.h"
#include "nerf/kernels/sample_groups.h"
#include "nerf/kernels/volume_rendering.h"
#include "nerf/model/grid_field.h"
#include "nerf/parts/interval_sampler.h"

namespace nerf::apps {
namespace {

constexpr int64_t kChunks = 1 << 10;

// Each sample of the run's work moves so many bytes, of arrays that stay in a thread's cache.
void move_through_cache(KernelRun& run, double bytes) {
  run.bytes = run.work * bytes;
  run.ceiling = [bytes](Ceilings& c) { return c.cached() / bytes; };
}

// How the light of a ray is composited: by one operation, or by its two halves.
enum class Light { kComposite, kWeightsFirst };

// Rays of sixteen samples through the tape's compositing, forward and backward.
class Compositing {
 public:
  Compositing(int threads, Light light) {
    density_ = tape_.input(1, Domain::kSamples, true);
    colour_ = tape_.input(3, Domain::kSamples, true);
    const Value delta = tape_.input(1, Domain::kSamples);
    const Value background = tape_.input(3, Domain::kRays);
    if (light == Light::kComposite) {
      pixel_ = composite(tape_, density_, colour_, delta, background).pixel;
    } else {
      const Value weights = render_weights(tape_, density_, delta, /*opaque_end=*/false);
      pixel_ = accumulate(tape_, weights, colour_, background);
    }
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
      std::fill_n(c.gradient(pixel_), 4 * c.stride(pixel_), 0.1_r);
      tape_.backward(c);
    });
  }

 private:
  static constexpr int kSamplesPerRay = 16, kRays = kChunkSamples / kSamplesPerRay;
  Tape tape_{kChunkSamples, kChunkRays};
  Value density_ = 0, colour_ = 0, pixel_ = 0;
  std::vector<int32_t> ray_begin_;
  std::vector<std::unique_ptr<Chunk>> chunks_;
};

KernelRun compositing_run(int threads, Light light) {
  auto compositing = std::make_shared<Compositing>(threads, light);
  KernelRun run;
  run.work = static_cast<double>(kChunks * kChunkSamples);
  // Forward density, length and three colours in, a weight out; backward those six in, four out.
  move_through_cache(run, (6 + 10) * sizeof(Real));
  run.run = [compositing](ThreadPool& pool) { compositing->run(pool); };
  return run;
}

// Rays whose second level is drawn from the weights of a first one.
struct DrawnRay {
  explicit DrawnRay(const IntervalOptions& o)
      : sampler(o, 0.5, 4),
        before(static_cast<size_t>(sampler.posts(0))),
        weights(static_cast<size_t>(sampler.samples(0))),
        after(static_cast<size_t>(sampler.posts(1))) {
    sampler.first(nullptr, before);
    const AlignedArray<Real> random = noise(weights.size(), 6);
    for (size_t i = 0; i < weights.size(); ++i)
      weights[i] = (random[i] + 0.5_r) / static_cast<Real>(weights.size());
  }
  IntervalSampler sampler;
  std::vector<Real> before, weights, after;
};

KernelCase resampling(const char* name, const IntervalOptions& o) {
  const IntervalSampler sampler(o, 0.5, 4);
  const int drawn = sampler.samples(1), read = sampler.posts(0) + sampler.samples(0);
  return {fmt::format("{}, {} samples from {}", name, drawn, sampler.samples(0)), Unit::kSamples,
          kBoundCached, [=](int threads) {
            auto all =
                std::make_shared<std::vector<DrawnRay>>(static_cast<size_t>(threads), DrawnRay(o));
            constexpr int64_t kRays = 1 << 12;
            KernelRun run;
            run.work = static_cast<double>(kRays * drawn);
            move_through_cache(run, static_cast<double>((read + drawn) * sizeof(Real)) / drawn);
            run.run = [=](ThreadPool& pool) {
              pool.parallel_for_thread(kRays, [&](int64_t ray, int thread) {
                DrawnRay& own = (*all)[static_cast<size_t>(thread)];
                Random random(1, 2, static_cast<uint64_t>(ray));
                own.sampler.next(1, own.before, own.weights, 1, &random, own.after);
              });
            };
            return run;
          }};
}

KernelRun harmonics_run(int threads) {
  struct Own {
    AlignedArray<Real> directions = noise(3 * kChunkSamples, 1);
    AlignedArray<Real> out{static_cast<size_t>(kChunkSamples) * kSphericalHarmonics};
  };
  auto all = std::make_shared<std::vector<Own>>(static_cast<size_t>(threads));
  KernelRun run;
  run.work = static_cast<double>(kChunks * kChunkSamples);
  move_through_cache(run, (3 + kSphericalHarmonics) * sizeof(Real));
  run.run = [=](ThreadPool& pool) {
    pool.parallel_for_thread(kChunks, [&](int64_t, int thread) {
      Own& own = (*all)[static_cast<size_t>(thread)];
      spherical_harmonics(kChunkSamples, own.directions.data(), kChunkSamples, own.out.data(),
                          kChunkSamples);
    });
  };
  return run;
}

// Means of sixteen rows over groups of four samples, forward and backward.
KernelRun group_run(int threads) {
  constexpr int kRows = 16, kPerGroup = 4;
  constexpr size_t kSize = static_cast<size_t>(kChunkSamples);
  struct Own {
    std::vector<int32_t> of = std::vector<int32_t>(kSize);
    AlignedArray<Real> share = noise(kSize, 1), per_light = noise(kSize, 2),
                       x = noise(kRows * kSize, 3), dy = noise(kRows * kSize, 4);
    AlignedArray<Real> y{kRows * kSize}, dx{kRows * kSize}, dw{kSize};
  };
  auto all = std::make_shared<std::vector<Own>>(static_cast<size_t>(threads));
  for (Own& own : *all)
    for (size_t i = 0; i < kSize; ++i) own.of[i] = static_cast<int32_t>(i) / kPerGroup;
  KernelRun run;
  run.work = static_cast<double>(kChunks * kChunkSamples);
  // Rows are read twice and written once by samples, the same by groups.
  move_through_cache(run, 3.0 * kRows * sizeof(Real) * (kPerGroup + 1) / kPerGroup);
  run.run = [=](ThreadPool& pool) {
    pool.parallel_for_thread(kChunks, [&](int64_t, int thread) {
      Own& own = (*all)[static_cast<size_t>(thread)];
      const SampleGroups groups{kChunkSamples, kChunkSamples / kPerGroup, own.of.data(),
                                own.share.data(), own.per_light.data()};
      mean_of_groups_forward(groups, kRows, own.x.data(), kChunkSamples, own.y.data(),
                             kChunkSamples);
      std::fill(own.dx.begin(), own.dx.end(), 0.0_r);
      mean_of_groups_backward(groups, kRows, own.x.data(), kChunkSamples, own.y.data(),
                              own.dy.data(), kChunkSamples, own.dw.data(), own.dx.data());
    });
  };
  return run;
}

// Of a gradient of sixteen rows, and the 104 rows of values that the default density network goes
// back through, what Russian roulette keeps: with norms that fall from 1 over five decades.
KernelRun roulette_run(int threads, Precision precision) {
  constexpr int kRows = 16, kValues = 104;
  constexpr size_t kSize = static_cast<size_t>(kChunkSamples);
  const bool in_pairs = precision == Precision::kBf16;
  struct Own {
    AlignedArray<Real> gradient = noise(kRows * kSize, 1), values = noise(kValues * kSize, 2);
    AlignedArray<uint16_t> pairs{static_cast<size_t>(pairs_size(kValues, kChunkSamples))};
    AlignedArray<Real> norms{kSize}, given{kSize}, factor{kSize};
    std::vector<int32_t> kept = std::vector<int32_t>(kSize);
  };
  auto all = std::make_shared<std::vector<Own>>(static_cast<size_t>(threads));
  for (Own& own : *all)
    for (size_t i = 0; i < kSize; ++i)
      own.given[i] = std::pow(10.0_r, -5.0_r * static_cast<Real>(i * 37 % kSize) / kSize);
  KernelRun run;
  run.work = static_cast<double>(kChunks * kChunkSamples);
  // The gradient is read twice and the values once; what is written of them is counted as nothing.
  move_through_cache(
      run, 2 * kRows * sizeof(Real) + kValues * (in_pairs ? sizeof(uint16_t) : sizeof(Real)));
  run.run = [=](ThreadPool& pool) {
    pool.parallel_for_thread(kChunks, [&](int64_t, int thread) {
      Own& own = (*all)[static_cast<size_t>(thread)];
      column_norms(kRows, kChunkSamples, own.gradient.data(), kChunkSamples, own.norms.data());
      const int64_t count = gradient_roulette(kChunkSamples, own.given.data(), 1, 0.5,
                                              own.kept.data(), own.factor.data());
      keep_columns(kRows, own.kept.data(), count, own.gradient.data(), kChunkSamples);
      if (in_pairs)
        keep_pairs(kValues, own.kept.data(), count, own.pairs.data());
      else
        keep_columns(kValues, own.kept.data(), count, own.values.data(), kChunkSamples);
    });
  };
  return run;
}

// The scan along rays of sixteen samples by itself: from opacities to weights and pixels, and back.
enum class Scan { kComposite, kWeights };
struct ScanArrays {
  static constexpr int kSamplesPerRay = 16, kRays = kChunkSamples / kSamplesPerRay;
  static constexpr size_t kSize = static_cast<size_t>(kChunkSamples);
  static constexpr int64_t kRayStride = (kRays + kLane - 1) / kLane * kLane;
  ScanArrays() {
    for (int r = 0; r <= kRays; ++r) begin.push_back(r * kSamplesPerRay);
    std::ranges::fill(opacities, 0.1_r);
    std::ranges::fill(density, 2.0_r);
    std::ranges::fill(delta, 0.05_r);
    w = opacities;
    render_weights_forward({begin.data(), kRays}, false, w.data());
  }
  void forward(Scan scan) {
    std::ranges::copy(opacities, out.begin());  // in place, as a step's are made anew
    if (scan == Scan::kWeights)
      render_weights_forward({begin.data(), kRays}, false, out.data());
    else
      composite_forward({begin.data(), kRays}, out.data(), {colour.data(), kChunkSamples},
                        {background.data(), kRayStride}, {pixel.data(), kRayStride});
  }
  void backward(Scan scan) {
    if (scan == Scan::kWeights)
      render_weights_backward({begin.data(), kRays}, false, density.data(), delta.data(), w.data(),
                              dw.data(), out.data());
    else
      composite_backward({begin.data(), kRays}, density.data(), delta.data(), w.data(),
                         {colour.data(), kChunkSamples}, {background.data(), kRayStride},
                         {pixel.data(), kRayStride}, out.data(), {d_colour.data(), kChunkSamples});
  }
  std::vector<int32_t> begin;
  AlignedArray<Real> opacities{kSize}, density{kSize}, delta{kSize}, w, dw = noise(kSize, 1),
                                                                        out{kSize};
  AlignedArray<Real> colour = noise(3 * kSize, 2), d_colour{3 * kSize};
  AlignedArray<Real> background = noise(3 * kRayStride, 3), pixel = noise(4 * kRayStride, 4);
};

// `floats` that are read or written for each sample.
KernelCase scan_case(const char* name, double floats, Scan scan, void (ScanArrays::*pass)(Scan)) {
  return {fmt::format("{}, 16 samples per ray", name), Unit::kSamples, kBoundCached,
          [=](int threads) {
            auto all = std::make_shared<std::vector<ScanArrays>>(static_cast<size_t>(threads));
            KernelRun run;
            run.work = static_cast<double>(kChunks * kChunkSamples);
            move_through_cache(run, floats * sizeof(Real));
            run.run = [=](ThreadPool& pool) {
              pool.parallel_for_thread(kChunks, [&](int64_t, int thread) {
                ((*all)[static_cast<size_t>(thread)].*pass)(scan);
              });
            };
            return run;
          }};
}

// The weights of a ray of 64 samples raised to a power before more are drawn from them.
KernelRun anneal_run(int threads) {
  constexpr size_t kSamples = 64;
  struct Own {
    Own() {
      const AlignedArray<Real> random = noise(kSamples, 6);
      for (size_t i = 0; i <= kSamples; ++i) edges.push_back(static_cast<Real>(i));
      for (const Real r : random) weights.push_back((r + 0.5_r) / kSamples);
    }
    std::vector<Real> edges, weights, out = std::vector<Real>(kSamples);
  };
  auto all = std::make_shared<std::vector<Own>>(static_cast<size_t>(threads));
  constexpr int64_t kRays = 1 << 14;
  KernelRun run;
  run.work = static_cast<double>(kRays * kSamples);
  move_through_cache(run, 3 * sizeof(Real));
  run.run = [=](ThreadPool& pool) {
    pool.parallel_for_thread(kRays, [&](int64_t, int thread) {
      Own& own = (*all)[static_cast<size_t>(thread)];
      histogram_anneal(own.edges, own.weights, 0.5_r, own.out);
    });
  };
  return run;
}

}  // namespace

std::vector<KernelCase> ray_cases() {
  IntervalOptions coarse_fine, blurred, proposal;
  blurred.resampling = Resampling::kBlurred;
  blurred.coarse = blurred.fine = 128;
  proposal.resampling = Resampling::kProposal;
  proposal.coarse = proposal.fine = 64;
  const auto light = [](Light l) {
    return [=](int threads) { return compositing_run(threads, l); };
  };
  const auto roulette = [](Precision p) {
    return [=](int threads) { return roulette_run(threads, p); };
  };
  return {
      {"spherical harmonics", Unit::kSamples, kBoundCached, harmonics_run},
      resampling("coarse+fine resampling", coarse_fine),
      resampling("blurred resampling", blurred),
      resampling("dilated resampling", proposal),
      {"compositing forward+backward, 16 samples per ray", Unit::kSamples, kBoundCached,
       light(Light::kComposite)},
      {"weights and accumulation forward+backward, 16 samples per ray", Unit::kSamples,
       kBoundCached, light(Light::kWeightsFirst)},
      {"means of groups forward+backward, 4 samples each", Unit::kSamples, kBoundCached, group_run},
      // In opacities, colours and weights; back densities, lengths, weights and colours, then the
      // gradients. A ray's own numbers are counted as nothing.
      scan_case("compositing forward", 5, Scan::kComposite, &ScanArrays::forward),
      scan_case("compositing backward", 10, Scan::kComposite, &ScanArrays::backward),
      scan_case("weights forward", 2, Scan::kWeights, &ScanArrays::forward),
      scan_case("weights backward", 5, Scan::kWeights, &ScanArrays::backward),
      {"annealed weights, power 1/2, 64 samples", Unit::kSamples, kBoundCached, anneal_run},
      {"gradient roulette, 120 rows", Unit::kSamples, kBoundCached, roulette(Precision::kF32),
       roulette(Precision::kBf16)},
  };
}

}  // namespace nerf::apps
