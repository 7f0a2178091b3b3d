// Ten steps of two tiny radiance networks, through kernels and tape but without a trainer, against
// those that tests/golden/network_training.py computed independently in double.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "golden/draws.h"
#include "golden/golden.h"
#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/kernels/adam.h"
#include "nerf/model/network_field.h"
#include "nerf/parts/losses.h"

namespace nerf {
namespace {

// The script's numbers are those of float, also where this is compiled for double.
constexpr int kNetworkSteps = 10, kNetworkRays = 5, kSamples = 7;
constexpr Real kDistortion = 0.01f;

NetworkOptions tiny_options(bool gaussians) {
  NetworkOptions o;
  o.position_degrees = 2;
  o.direction_degrees = 1;
  o.depth = 3;
  o.width = 16;
  o.skip = 1;
  o.bottleneck = 5;
  o.view_width = 7;
  o.sampling.rounds = 0;
  if (!gaussians) return o;
  o.encoding = Encoding::kIntegrated;
  o.density = DensityActivation::kSoftplus;
  o.density_bias = -1;
  o.colour_padding = 0.001f;
  o.opaque_end = true;
  return o;
}

struct TinyRun {
  explicit TinyRun(bool with_gaussians)
      : gaussians(with_gaussians),
        field(tiny_options(gaussians), 2, 6),
        tape(field.options, field.networks[0], kNetworkRays * kSamples, kNetworkRays,
             NetworkTape::Purpose::kTrain,
             {.pixel = gaussians ? PixelLoss::charbonnier(0.001f) : PixelLoss(),
              .on_weights = gaussians}),
        chunk(tape.tape),
        layers(field.layers()) {
    for (auto* a : {&gradient, &m, &v}) *a = AlignedArray<Real>(field.weights.size());
    for (size_t l = 0; l < layers.size(); ++l) {
      const LinearWeights& w = layers[l];
      const uint32_t stream = static_cast<uint32_t>(l);
      const auto values = golden_draw(stream + 1, static_cast<size_t>(w.in * w.out));
      for (int i = 0; i < w.in * w.out; ++i)
        field.weights[at(w, i)] = (2 * values[static_cast<size_t>(i)] - 1) / 2;
      const auto biases = golden_draw(stream + 21, static_cast<size_t>(w.out));
      for (int j = 0; j < w.out; ++j)
        field.weights[at(w, w.in * w.out + j)] = (2 * biases[static_cast<size_t>(j)] - 1) / 4;
    }
    for (int r = 0; r <= kNetworkRays; ++r) ray_begin.push_back(r * kSamples);
  }

  // Element i of a layer, row by row without padding; then its biases.
  static size_t at(const LinearWeights& w, int i) {
    if (i >= w.in * w.out) return w.bias_offset() + static_cast<size_t>(i - w.in * w.out);
    return w.offset + static_cast<size_t>(i / w.in * weight_stride(w.in) + i % w.in);
  }

  void put(Value value, uint32_t stream, Real factor, Real shift) {
    const size_t columns = static_cast<size_t>(chunk.count(value));
    const auto drawn = golden_draw(stream, static_cast<size_t>(tape.tape.rows(value)) * columns);
    for (size_t i = 0; i < drawn.size(); ++i)
      chunk.data(value)[static_cast<int64_t>(i / columns) * chunk.stride(value) +
                        static_cast<int64_t>(i % columns)] = factor * drawn[i] + shift;
  }

  void fill_inputs(uint32_t stream) {
    put(tape.position, stream + 10, 2, -1);
    if (gaussians) put(tape.variance, stream + 11, 0.25_r, 0);
    put(tape.directions, stream + 12, 2, -1);
    const int64_t lr = chunk.stride(tape.directions);
    for (int r = 0; r < kNetworkRays; ++r) {
      Real* d = chunk.data(tape.directions) + r;
      double square = 0;
      for (int k = 0; k < 3; ++k) square += std::pow(static_cast<double>(d[k * lr]), 2);
      for (int k = 0; k < 3; ++k)
        d[k * lr] = static_cast<float>(static_cast<double>(d[k * lr]) / std::sqrt(square));
      chunk.data(tape.pixel_loss.scale)[r] = static_cast<float>(1.0 / (3 * kNetworkRays));
    }
    put(tape.delta, stream + 13, 0.25_r, 0.0625_r);
    put(tape.background, stream + 14, 1, 0);
    put(tape.pixel_loss.target, stream + 15, 1, 0);
  }

  double distortion(uint32_t stream) {
    constexpr size_t kEdges = kSamples + 1;
    const auto steps = golden_draw(stream + 16, kNetworkRays * kEdges);
    double loss = 0;
    for (size_t r = 0; r < kNetworkRays; ++r) {
      std::vector<Real> edges;
      Real sum = 0;
      for (size_t i = 0; i < kEdges; ++i)
        edges.push_back((sum += 1 + std::floor(127 * steps[r * kEdges + i])) / 1024);
      Real* out = chunk.data(tape.weight_gradient) + r * kSamples;
      std::fill_n(out, kSamples, 0.0_r);
      loss += distortion_loss(edges, {chunk.data(tape.weights) + r * kSamples, kSamples},
                              kDistortion / kNetworkRays, {out, kSamples});
    }
    return loss;
  }

  // Forward, backward and update; the loss before the update.
  double step(int s) {
    const uint32_t stream = static_cast<uint32_t>(100 * s);
    std::fill(gradient.begin(), gradient.end(), 0.0_r);
    chunk.weights = field.weights.data();
    chunk.weight_gradient = gradient.data();
    chunk.samples = kNetworkRays * kSamples;
    chunk.rays = kNetworkRays;
    chunk.ray_begin = ray_begin.data();
    chunk.loss = 0;
    fill_inputs(stream);
    tape.forward(chunk);
    if (gaussians) chunk.loss += distortion(stream);
    tape.tape.backward(chunk);
    const AdamStep adam{.rate = 0.01f, .beta1 = 0.9f, .beta2 = 0.999f, .epsilon = 1e-6f};
    adam_dense(adam, s + 1, static_cast<int64_t>(field.weights.size()), gradient.data(), m.data(),
               v.data(), field.weights.data());
    return chunk.loss;
  }

  bool gaussians;
  NetworkField field;
  NetworkTape tape;
  Chunk chunk;
  std::vector<LinearWeights> layers;
  std::vector<int32_t> ray_begin;
  AlignedArray<Real> gradient, m, v;
};

TEST(NetworkTraining, TenStepsMatchTheGoldenRun) {
  for (const bool gaussians : {false, true}) {
    const std::string name = gaussians ? "gaussians" : "points";
    SCOPED_TRACE(name);
    const auto losses = golden_lines("network_training.txt", name + "-loss");
    const auto layers = golden_lines("network_training.txt", name + "-layer");
    ASSERT_EQ(losses.size(), static_cast<size_t>(kNetworkSteps));
    WorstError loss(name + "_loss"), network(name);
    for_each_target([&](const std::string&) {
      TinyRun run(gaussians);
      ASSERT_EQ(layers.size(), run.layers.size());
      for (int s = 0; s < kNetworkSteps; ++s) {
        const auto& want = losses[static_cast<size_t>(s)];
        loss.compare(run.step(s), want[0], golden_tolerance(want[0], want[1]), "step", s);
      }
      for (size_t l = 0; l < layers.size(); ++l) {
        const LinearWeights& w = run.layers[l];
        ASSERT_EQ(layers[l].size(), 2 * w.parameters());
        for (size_t i = 0; i < w.parameters(); ++i)
          network.compare(run.field.weights[TinyRun::at(w, static_cast<int>(i))], layers[l][2 * i],
                          golden_tolerance(layers[l][2 * i], layers[l][2 * i + 1]), "layer", l,
                          "element", i);
      }
    });
    loss.report();
    network.report();
  }
}

}  // namespace
}  // namespace nerf
