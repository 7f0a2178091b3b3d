#include "nerf/autodiff/tape.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "autodiff/gradient_check.h"
#include "nerf/autodiff/operations.h"

namespace nerf {
namespace {

// x [3 x samples] -> relu layer -> layer -> a loss of the result.
struct SmallNetwork {
  SmallNetwork() : tape(kSampleCapacity, kRayCapacity) {
    x = tape.input(3, Domain::kSamples, true);
    const LinearWeights first{0, 3, 8}, second{first.size(), 8, 2};
    a = linear(tape, x, first, LinearActivation::kRelu);
    operations_of_a = tape.operations();
    y = linear(tape, a, second, LinearActivation::kNone);
    tape.record(
        std::make_unique<Probe>(std::vector<Value>{y}, tape.output(1, Domain::kRays, {&y, 1})));
    tape.plan();
    weights = AlignedArray<Real>(first.size() + second.size());
    gradient = AlignedArray<Real>(weights.size());
    Random random(61, 0, 0);
    for (const LinearWeights& w : {first, second})
      for (int j = 0; j < w.out; ++j)
        for (int k = 0; k < w.in; ++k)
          weights[gradient_check::Problem::index(w, j, k)] = uniform(random, -1, 1);
  }

  void fill(Chunk& chunk, int samples, uint64_t seed) {
    Random random(seed, 0, 0);
    rays = {0, samples};
    chunk.samples = samples;
    chunk.rays = 1;
    chunk.ray_begin = rays.data();
    chunk.weights = weights.data();
    chunk.weight_gradient = gradient.data();
    for (int k = 0; k < 3; ++k)
      for (int s = 0; s < samples; ++s)
        chunk.data(x)[k * chunk.stride(x) + s] = uniform(random, -1, 1);
  }

  std::vector<Real> outputs(const Chunk& chunk) const {
    std::vector<Real> out;
    for (int k = 0; k < 2; ++k)
      for (int s = 0; s < chunk.samples; ++s) out.push_back(chunk.data(y)[k * chunk.stride(y) + s]);
    return out;
  }

  Tape tape;
  Value x, a, y;
  size_t operations_of_a;
  AlignedArray<Real> weights, gradient;
  Rays rays;
};

// Values and gradients that lie in the caller's memory: the same bits, and the chunk's own again
// afterwards.
TEST(Tape, InputsInTheCallersMemory) {
  SmallNetwork network;
  Chunk own(network.tape), other(network.tape);
  network.fill(own, 21, 7);
  network.fill(other, 21, 8);
  const int64_t stride = own.stride(network.x);
  AlignedArray<Real> values(static_cast<size_t>(3 * stride)), gradient(values.size());
  std::copy_n(own.data(network.x), values.size(), values.data());
  other.bind(network.x, values.data(), gradient.data());
  for (Chunk* chunk : {&own, &other}) {
    network.tape.forward(*chunk);
    network.tape.backward(*chunk);
  }
  EXPECT_EQ(network.outputs(other), network.outputs(own));
  double size = 0;
  for (int k = 0; k < 3; ++k)
    for (int s = 0; s < 21; ++s) {
      const Real want = own.gradient(network.x)[k * stride + s];
      EXPECT_EQ(gradient[static_cast<size_t>(k * stride + s)], want) << k << ", " << s;
      size += std::fabs(static_cast<double>(want));
    }
  EXPECT_GT(size, 0);

  const std::vector<Real> before = network.outputs(other);
  other.bind(network.x, nullptr, nullptr);
  network.tape.forward(other);
  EXPECT_NE(network.outputs(other), before);
  EXPECT_THROW(other.bind(network.y, nullptr, gradient.data()), std::logic_error);
}

// Samples to an odd number of cache lines: rows so far apart use all sets of a cache.
TEST(Tape, CapacitiesAreRoundedUp) {
  for (const auto& [samples, capacity] :
       {std::pair{1, 16}, {16, 16}, {17, 48}, {240, 240}, {384, 400}})
    EXPECT_EQ(Tape(samples, 1).capacity(Domain::kSamples), capacity);
  EXPECT_EQ(Tape(17, 1).capacity(Domain::kRays), kLane);
}

// What a chunk computed before leaves no trace in what it computes next, also with fewer samples.
TEST(Tape, ReusedChunkGivesTheSameBits) {
  SmallNetwork net;
  Chunk fresh(net.tape), used(net.tape);
  net.fill(used, 64, 1);
  net.tape.forward(used);
  net.tape.backward(used);
  std::fill(net.gradient.begin(), net.gradient.end(), 0.0_r);
  used.loss = 0;
  net.fill(used, 19, 2);
  net.tape.forward(used);
  net.tape.backward(used);
  const AlignedArray<Real> from_used = net.gradient;

  std::fill(net.gradient.begin(), net.gradient.end(), 0.0_r);
  net.fill(fresh, 19, 2);
  net.tape.forward(fresh);
  net.tape.backward(fresh);
  EXPECT_EQ(net.outputs(fresh), net.outputs(used));
  EXPECT_EQ(fresh.loss, used.loss);
  for (size_t i = 0; i < from_used.size(); ++i) ASSERT_EQ(net.gradient[i], from_used[i]) << i;
}

// Two chunks of one tape, interleaved; weight gradients of both add up.
TEST(Tape, ChunksAreIndependentAndGradientsAddUp) {
  SmallNetwork net;
  Chunk a(net.tape), b(net.tape), both(net.tape);
  net.fill(a, 40, 3);
  net.fill(b, 24, 4);
  const Rays rays_a{0, 40}, rays_b{0, 24};
  a.ray_begin = rays_a.data();
  b.ray_begin = rays_b.data();
  AlignedArray<Real> ga(net.gradient.size()), gb(net.gradient.size());
  a.weight_gradient = ga.data();
  b.weight_gradient = gb.data();
  net.tape.forward(a);
  net.tape.forward(b);
  net.tape.backward(b);
  net.tape.backward(a);

  std::fill(net.gradient.begin(), net.gradient.end(), 0.0_r);
  net.fill(both, 40, 3);
  net.tape.forward(both);
  EXPECT_EQ(net.outputs(both), net.outputs(a));
  net.tape.backward(both);
  net.fill(both, 24, 4);
  net.tape.forward(both);
  EXPECT_EQ(net.outputs(both), net.outputs(b));
  net.tape.backward(both);
  WorstError worst("sum");
  for (size_t i = 0; i < ga.size(); ++i)
    worst.compare(net.gradient[i], static_cast<double>(ga[i]) + static_cast<double>(gb[i]),
                  rounding_bound(26) * (std::fabs(ga[i]) + 24 * 8), "weight", i);
  worst.report();
}

// Of two results the caller fills both gradients before the backward pass.
TEST(Tape, ResultsHaveGradientsOfTheirOwn) {
  Tape tape(16, 16);
  const Value x = tape.input(2, Domain::kSamples, true);
  const Value a = scale_shift(tape, x, 3, 0), b = scale_shift(tape, x, 5, 0);
  tape.plan();
  Chunk chunk(tape);
  const std::vector<int32_t> rays = {0, 16};
  chunk.samples = 16;
  chunk.rays = 1;
  chunk.ray_begin = rays.data();
  std::fill_n(chunk.data(x), 32, 1.0_r);
  tape.forward(chunk);
  std::fill_n(chunk.gradient(a), 32, 0.25_r);
  std::fill_n(chunk.gradient(b), 32, 2.0_r);
  tape.backward(chunk);
  for (int i = 0; i < 32; ++i) EXPECT_EQ(chunk.gradient(x)[i], 3 * 0.25_r + 5 * 2.0_r) << i;
}

TEST(Tape, ForwardOfTheFirstOperationsOnly) {
  SmallNetwork net;
  Chunk chunk(net.tape);
  net.fill(chunk, 16, 5);
  net.tape.forward(chunk, 0, net.operations_of_a);
  EXPECT_EQ(net.outputs(chunk), std::vector<Real>(32, 0.0_r)) << "the second layer did not run";
  net.tape.forward(chunk);
  EXPECT_NE(net.outputs(chunk), std::vector<Real>(32, 0.0_r));
}

TEST(Tape, KnowsReadersAndMakers) {
  Tape tape(16, 16);
  const Value x = tape.input(2, Domain::kSamples, true);
  const Value y = sigmoid(tape, x), z = concat(tape, y, y), u = truncated_exp(tape, x);
  EXPECT_EQ(tape.producer(x), nullptr);
  ASSERT_NE(tape.producer(z), nullptr);
  EXPECT_STREQ(tape.producer(z)->name(), "concat");
  EXPECT_EQ(tape.only_consumer(x), nullptr) << "two operations read it";
  EXPECT_EQ(tape.only_consumer(y), nullptr) << "one operation reads it twice";
  EXPECT_EQ(tape.only_consumer(u), nullptr) << "nobody reads it";
  const Value w = slice(tape, u, 0, 1);
  EXPECT_EQ(tape.only_consumer(u), tape.producer(w));
  EXPECT_TRUE(tape.needs_gradient(w));
  EXPECT_EQ(tape.rows(z), 4);
}

TEST(Tape, GradientOfAValueWithoutOneIsABug) {
  Tape tape(16, 16);
  const Value x = tape.input(2, Domain::kSamples);
  sigmoid(tape, x);
  tape.plan();
  Chunk chunk(tape);
  EXPECT_THROW(chunk.gradient(x), std::logic_error);
}

TEST(Tape, WrongShapesAreBugs) {
  Tape tape(16, 16);
  const Value three = tape.input(3, Domain::kSamples), rays = tape.input(3, Domain::kRays);
  const Value one = tape.input(1, Domain::kSamples), learned = tape.input(3, Domain::kRays, true);
  const Value learned_delta = tape.input(1, Domain::kSamples, true);
  EXPECT_THROW(linear(tape, three, {0, 4, 2}, LinearActivation::kNone), std::logic_error);
  EXPECT_THROW(concat(tape, three, rays), std::logic_error);
  EXPECT_THROW(slice(tape, three, 2, 2), std::logic_error);
  EXPECT_THROW(view_code(tape, tape.input(2, Domain::kRays)), std::logic_error);
  EXPECT_THROW(composite(tape, three, three, one, rays), std::logic_error);
  EXPECT_THROW(composite(tape, one, one, one, rays), std::logic_error);
  EXPECT_THROW(huber_loss(tape, rays, rays, one, 0.1_r), std::logic_error);
  // Operations that have no derivative with respect to an input refuse one that wants it.
  EXPECT_THROW(view_code(tape, learned), std::logic_error);
  EXPECT_THROW(composite(tape, one, three, learned_delta, rays), std::logic_error);
  EXPECT_THROW(composite(tape, one, three, one, learned), std::logic_error);
  const Value pixel = tape.input(4, Domain::kRays, true), scale = tape.input(1, Domain::kRays);
  EXPECT_THROW(huber_loss(tape, pixel, learned, scale, 0.1_r), std::logic_error);
  EXPECT_THROW(huber_loss(tape, pixel, rays, tape.input(1, Domain::kRays, true), 0.1_r),
               std::logic_error);
}

}  // namespace
}  // namespace nerf
