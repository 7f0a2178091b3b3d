// Packs of layers on a tape: those of f32 change nothing, those of bf16 round the operands.
#include <gtest/gtest.h>

#include <cmath>
#include <type_traits>
#include <vector>

#include "kernels/kernel_test.h"
#include "nerf/autodiff/operations.h"
#include "nerf/autodiff/tangents.h"

namespace nerf {
namespace {

struct Results {
  std::vector<Real> output, input_gradient, weight_gradient;
};

// Layers wide and narrow, so that some have a pack in f32 and some have not, and every offset
// differs.
class PackedLayers : public ::testing::Test {
 protected:
  explicit PackedLayers(std::vector<int> widths = {40, 128, 112, 20, 96, 130, 5}, int samples = 100)
      : samples_(samples), tape_(samples, kLane) {
    size_t size = 0;
    for (size_t l = 0; l + 1 < widths.size(); ++l) {
      LinearWeights w{size, widths[l], widths[l + 1]};
      w.bias = l % 2 == 0;
      size += w.size();
      layers_.push_back(w);
    }
    std::vector<LinearWeights*> placed;
    for (LinearWeights& w : layers_) placed.push_back(&w);
    place_packs(placed);
    input_ = tape_.input(widths.front(), Domain::kSamples, true);
    output_ = mlp(tape_, input_, layers_);
    tape_.plan();
    weights_ = AlignedArray<Real>(size);
    for (const LinearWeights& w : layers_) {
      Random random(7, w.offset, 0);
      const Real scale = std::sqrt(6.0_r / static_cast<Real>(w.in));
      for (int j = 0; j < w.out; ++j)
        for (int k = 0; k < w.in; ++k)
          weights_[w.offset + static_cast<size_t>(j * weight_stride(w.in) + k)] =
              scale * (2 * random.uniform() - 1);
      for (int j = 0; w.bias && j < w.out; ++j)
        weights_[w.bias_offset() + static_cast<size_t>(j)] = 0.1_r * random.uniform();
    }
  }

  Results run(const LayerPacks* packs) const { return run(packs, tape_, output_); }
  Results run(const LayerPacks* packs, const Tape& tape, Value output) const {
    AlignedArray<Real> gradient(weights_.size());
    Chunk chunk(tape);
    chunk.weights = weights_.data();
    chunk.weight_gradient = gradient.data();
    chunk.packs = packs;
    const int32_t ray_begin[] = {0, samples_};
    chunk.samples = samples_;
    chunk.rays = 1;
    chunk.ray_begin = ray_begin;
    const int64_t ld = chunk.stride(input_), lo = chunk.stride(output);
    Random random(8, 0, 0);
    for (int r = 0; r < layers_.front().in; ++r)
      for (int s = 0; s < samples_; ++s) chunk.data(input_)[r * ld + s] = 2 * random.uniform() - 1;
    tape.forward(chunk);
    for (int r = 0; r < layers_.back().out; ++r)
      for (int s = 0; s < samples_; ++s)
        chunk.gradient(output)[r * lo + s] = 2 * random.uniform() - 1;
    tape.backward(chunk);
    samples_behind_ = chunk.samples;
    Results out;
    for (int r = 0; r < layers_.back().out; ++r)
      for (int s = 0; s < samples_; ++s) out.output.push_back(chunk.data(output)[r * lo + s]);
    for (int r = 0; r < layers_.front().in; ++r)
      for (int s = 0; s < samples_; ++s)
        out.input_gradient.push_back(chunk.gradient(input_)[r * ld + s]);
    out.weight_gradient.assign(gradient.begin(), gradient.end());
    return out;
  }

  LayerPacks packed(Precision precision) const {
    LayerPacks packs;
    ThreadPool pool(2);
    pack_layers(layers_, weights_.data(), precision, packs, pool);
    return packs;
  }

  void expect_f32_changes_nothing() const {
    for_each_target([&](const std::string&) {
      const LayerPacks packs = packed(Precision::kF32);
      if constexpr (std::is_same_v<Real, float>) {
        EXPECT_GT(packs.f32.size(), 0u);
      }
      const Results without = run(nullptr), with = run(&packs);
      EXPECT_EQ(with.output, without.output);
      EXPECT_EQ(with.input_gradient, without.input_gradient);
      EXPECT_EQ(with.weight_gradient, without.weight_gradient);
    });
  }

  int samples_;
  Tape tape_;
  std::vector<LinearWeights> layers_;
  Value input_ = 0, output_ = 0;
  AlignedArray<Real> weights_;
  mutable int samples_behind_ = 0;  // that the last backward pass ended with
};

// Hidden values as pairs give the bits that rows give, also where the backward pass goes on with a
// part of the samples.
TEST_F(PackedLayers, PairsChangeNothing) {
  for_each_bf16_unit([&](Bf16Unit) {
    const LayerPacks packs = packed(Precision::kBf16);
    for (const bool some : {false, true}) {
      const auto results = [&](bool pairs) {
        Tape tape(samples_, kLane);
        const Value input = tape.input(layers_.front().in, Domain::kSamples, true);
        const Value output = mlp(tape, input, layers_);
        for (Value v = input + 1; !pairs && v < output; ++v) tape.keep_rows(v);
        if (some) roulette(tape, output, 1);
        const Value scaled = scale_shift(tape, output, 2, 0);
        tape.plan();
        Chunk chunk(tape);
        chunk.packs = &packs;
        for (Value v = input; v <= output; ++v)
          EXPECT_EQ(chunk.has_pairs(v), pairs && v > input && v < output);
        return run(&packs, tape, scaled);
      };
      const Results got = results(true), want = results(false);
      EXPECT_GT(samples_behind_, 0);
      EXPECT_EQ(samples_behind_ < samples_, some);
      EXPECT_EQ(got.output, want.output);
      EXPECT_EQ(got.input_gradient, want.input_gradient);
      EXPECT_EQ(got.weight_gradient, want.weight_gradient);
    }
  });
}

// The gates of tangents read what the layers before them put out, which therefore is no pairs.
TEST_F(PackedLayers, TangentsSeeHiddenRows) {
  for_each_bf16_unit([&](Bf16Unit) {
    const LayerPacks packs = packed(Precision::kBf16);
    const auto results = [&](bool keep) {
      Tape tape(samples_, kLane);
      const Value input = tape.input(layers_.front().in, Domain::kSamples, true);
      const WithTangents output = mlp(tape, {input, {input}}, layers_);
      for (Value v = input + 1; keep && v < output.value; ++v) tape.keep_rows(v);
      const Value sum = add(tape, output.value, output.tangents[0]);
      tape.plan();
      return run(&packs, tape, sum);
    };
    const Results got = results(false), want = results(true);
    EXPECT_EQ(got.output, want.output);
    EXPECT_EQ(got.input_gradient, want.input_gradient);
    EXPECT_EQ(got.weight_gradient, want.weight_gradient);
  });
}

double relative(const std::vector<Real>& got, const std::vector<Real>& want) {
  double error = 0, size = 0;
  for (size_t i = 0; i < want.size(); ++i) {
    error += std::pow(static_cast<double>(got[i]) - static_cast<double>(want[i]), 2);
    size += std::pow(static_cast<double>(want[i]), 2);
  }
  return std::sqrt(error / size);
}

TEST_F(PackedLayers, F32ChangesNothing) { expect_f32_changes_nothing(); }

// Square layers as wide as models have, and wider, of a part of a strip.
class WidePackedLayers : public PackedLayers {
 protected:
  WidePackedLayers() : PackedLayers({256, 256, 512, 512, 1024, 1024, 3}, 17) {}
};
TEST_F(WidePackedLayers, F32ChangesNothing) { expect_f32_changes_nothing(); }

// Each operand is off by at most 2^-9 of itself: 2^-8 of a product, and with random signs the same
// share of a layer's whole output. Layer l is off by e_l = sqrt(l) 2^-8, so that a share e_l / pi
// of its values falls on the other side of 0, which is 2 e_l / pi of those that let gradients
// through; a gradient's squared error is the sum of that over the five hidden layers, 0.021, and
// more than the roundings'. A pack at another layer's place would be wrong by 1.
TEST_F(PackedLayers, Bf16RoundsTheOperands) {
  const double of_output = std::sqrt(6.0) / 256, of_gradients = std::sqrt(0.021);
  const Results exact = run(nullptr);
  for_each_bf16_unit([&](Bf16Unit) {
    const LayerPacks packs = packed(Precision::kBf16);
    const Results rounded = run(&packs);
    const auto check = [&](auto part, double most) {
      const double error = relative(rounded.*part, exact.*part);
      EXPECT_GT(error, 1e-4);
      EXPECT_LT(error, most);
    };
    check(&Results::output, of_output);
    check(&Results::input_gradient, of_gradients);
    check(&Results::weight_gradient, of_gradients);
  });
}

}  // namespace
}  // namespace nerf
