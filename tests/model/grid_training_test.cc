// Ten steps of a tiny grid model, through kernels and tape but without a trainer, against those
// that tests/golden/grid_training.py computed independently in double.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "golden/draws.h"
#include "golden/golden.h"
#include "kernels/kernel_test.h"
#include "kernels/row_states.h"
#include "math/worst_error.h"
#include "nerf/kernels/adam.h"
#include "nerf/kernels/roulette.h"
#include "nerf/model/grid_field.h"

namespace nerf {
namespace {

constexpr int kSteps = 10, kRays = 6;
const std::vector<std::vector<int>> kCounts = {  // samples of each ray, step by step
    {7, 0, 5, 9, 3, 8},
    {1, 16, 0, 4, 17, 2},
    {12, 3, 3, 0, 1, 6}};

GridOptions tiny_options() {
  GridOptions o;
  o.table_bits = 32;
  o.levels = 2;
  o.log2_entries = 6;
  o.occupancy_side = 16;
  o.base_resolution = 3;
  o.finest_resolution = 9;
  o.hidden = 16;
  o.density_layers = 1;
  o.colour_layers = 2;
  o.geometry_features = 8;
  return o;
}

// The script's numbers are those of float, also where this is compiled for double.
AdamStep adam_step() {
  return {.rate = 0.01f, .beta1 = 0.9f, .beta2 = 0.99f, .epsilon = 1e-15f, .l2 = 1e-3f};
}

// The script's runs: a colour for each sample; shared by what has little light; and with samples
// that learn by chance besides.
enum class Variant { kOwnColours, kSharedColours, kRoulette };

GridLosses losses_of(Variant variant) {
  GridLosses losses{.pixel = PixelLoss::huber(0.1f)};
  if (variant != Variant::kOwnColours) {
    losses.shared_colour = 0.2_r;
    losses.stop_transmittance = 0.3_r;
  }
  if (variant == Variant::kRoulette) losses.roulette = 1;
  return losses;
}

struct TinyRun {
  explicit TinyRun(Variant variant = Variant::kOwnColours)
      : field(tiny_options(), false, 1),
        tape(field, /*training=*/true, losses_of(variant)),
        chunk(tape.tape) {
    EXPECT_EQ(field.shape.rows, 128u);
    EXPECT_TRUE(field.shape.levels[0].dense && !field.shape.levels[1].dense);
    uint32_t stream = 1;
    for (const auto* layers : {&field.density_layers, &field.colour_layers})
      for (const LinearWeights& w : *layers) {
        all_layers.push_back(w);
        const auto values = golden_draw(stream++, static_cast<size_t>(w.in * w.out));
        for (int i = 0; i < w.in * w.out; ++i)
          field.weights[at(w, i)] = (2 * values[static_cast<size_t>(i)] - 1) / 2;
      }
    const auto values = golden_draw(9, field.table.size());
    for (size_t i = 0; i < values.size(); ++i) field.table[i] = (2 * values[i] - 1) / 2;
    for (auto* a : {&gradient, &m, &v}) *a = AlignedArray<Real>(field.weights.size());
    for (const HashGridLevel& level : field.shape.levels)
      states.push_back(std::make_unique<RowStates>(level.entries, level.features));
    correction.resize(2 * kBiasCorrections);
    bias_corrections(adam_step(), correction.data());
  }

  // Element i of a layer, row by row without padding.
  static size_t at(const LinearWeights& w, int i) {
    return w.offset + static_cast<size_t>(i / w.in * weight_stride(w.in) + i % w.in);
  }

  // Forward, backward and update; the loss before the update.
  double step(int s) {
    const std::vector<int>& counts = kCounts[static_cast<size_t>(s) % kCounts.size()];
    std::vector<int32_t> begin{0};
    for (int c : counts) begin.push_back(begin.back() + c);
    const int n = begin.back();
    const uint32_t stream = static_cast<uint32_t>(100 * s);
    // Odd multiples of 1/2048.
    Matrix places(3, n);
    const auto drawn = golden_draw(stream + 10, static_cast<size_t>(3 * n));
    for (int k = 0; k < 3; ++k)
      for (int i = 0; i < places.padded; ++i)
        places.at(k, i) =
            i < n ? (2 * std::floor(1024 * drawn[static_cast<size_t>(k * n + i)]) + 1) / 2048
                  : 0.5_r;
    Real* x = places.data.data();
    const Real *y = x + places.ld, *z = y + places.ld;

    std::fill(gradient.begin(), gradient.end(), 0.0_r);
    chunk.weights = field.weights.data();
    chunk.weight_gradient = gradient.data();
    chunk.samples = n;
    chunk.rays = kRays;
    chunk.ray_begin = begin.data();
    chunk.loss = 0;
    fill_inputs(stream, n);
    const int64_t ld = chunk.stride(tape.features);
    encode(field, {x, y, z}, n, chunk.data(tape.features), ld);
    auto* const roulette =
        tape.gradient_roulette < 0 ? nullptr : &chunk.state<RouletteState>(tape.gradient_roulette);
    if (roulette) roulette->offset = golden_draw(stream + 15, 1)[0];
    tape.tape.forward(chunk);
    tape.tape.backward(chunk);
    learning += chunk.samples;
    all += n;
    if (chunk.samples < n) keep_columns(3, roulette->kept.data(), chunk.samples, x, places.ld);
    for (size_t l = 0; l < field.shape.levels.size(); ++l) {
      const HashGridLevel& level = field.shape.levels[l];
      hash_grid_backward(
          level, x, y, z, chunk.samples,
          chunk.gradient(tape.features) + static_cast<int64_t>(l) * level.features * ld, ld,
          states[l]->gradient.data(), states[l]->marks.data());
    }

    AdamStep options = adam_step();
    adam_dense(options, s + 1, static_cast<int64_t>(field.weights.size()), gradient.data(),
               m.data(), v.data(), field.weights.data());
    options.l2 = 0;
    for (size_t l = 0; l < field.shape.levels.size(); ++l) {
      const HashGridLevel& level = field.shape.levels[l];
      states[l]->take_marked();
      adam_rows(options, level.features, states[l]->list(), states[l]->count(),
                states[l]->gradient.data(), states[l]->data(), field.table.data() + level.begin(),
                correction.data());
    }
    return chunk.loss;
  }

  void fill_inputs(uint32_t stream, int n) {
    const auto put = [&](Value value, const std::vector<Real>& values, int columns, auto f) {
      for (int k = 0; k < tape.tape.rows(value); ++k)
        for (int i = 0; i < columns; ++i)
          chunk.data(value)[k * chunk.stride(value) + i] =
              f(values[static_cast<size_t>(k * columns + i)]);
    };
    const auto same = [](Real u) { return u; };
    put(tape.delta, golden_draw(stream + 12, static_cast<size_t>(n)), n,
        [](Real u) { return u / 4 + 0.0625_r; });
    for (int i = n; i < round_up(n, kLane); ++i) chunk.data(tape.delta)[i] = 0;
    put(tape.background, golden_draw(stream + 13, 3 * kRays), kRays, same);
    put(tape.pixel_loss.target, golden_draw(stream + 14, 3 * kRays), kRays, same);
    put(tape.pixel_loss.scale, std::vector<Real>(kRays, static_cast<float>(1.0 / (3 * kRays))),
        kRays, same);
    std::vector<Real> directions = golden_draw(stream + 11, 3 * kRays);
    for (size_t r = 0; r < kRays; ++r) {
      double d[3];
      for (size_t k = 0; k < 3; ++k)
        d[k] = 2.0 * static_cast<double>(directions[k * kRays + r]) - 1;
      const double size = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
      for (size_t k = 0; k < 3; ++k) directions[k * kRays + r] = static_cast<float>(d[k] / size);
    }
    put(tape.directions, directions, kRays, same);
  }

  GridField field;
  GridTape tape;
  Chunk chunk;
  std::vector<LinearWeights> all_layers;
  AlignedArray<Real> gradient, m, v;
  std::vector<std::unique_ptr<RowStates>> states;  // of each level
  std::vector<Real> correction;
  int learning = 0, all = 0;  // samples
};

void expect_golden_run(const char* file, Variant variant) {
  const auto losses = golden_lines(file, "loss");
  const auto layers = golden_lines(file, "layer");
  const auto table = golden_lines(file, "table");
  ASSERT_EQ(losses.size(), static_cast<size_t>(kSteps));
  ASSERT_EQ(table.size(), 1u);
  WorstError loss("loss"), network("network"), rows("table");
  for_each_target([&](const std::string&) {
    TinyRun run(variant);
    ASSERT_EQ(layers.size(), run.all_layers.size());
    ASSERT_EQ(table[0].size(), 2 * run.field.table.size());
    for (int s = 0; s < kSteps; ++s) {
      const auto& want = losses[static_cast<size_t>(s)];
      loss.compare(run.step(s), want[0], golden_tolerance(want[0], want[1]), "step", s);
    }
    for (size_t l = 0; l < layers.size(); ++l) {
      const LinearWeights& w = run.all_layers[l];
      ASSERT_EQ(layers[l].size(), static_cast<size_t>(2 * w.in * w.out));
      for (int i = 0; i < w.in * w.out; ++i) {
        const double want = layers[l][static_cast<size_t>(2 * i)];
        network.compare(run.field.weights[TinyRun::at(w, i)], want,
                        golden_tolerance(want, layers[l][static_cast<size_t>(2 * i + 1)]), "layer",
                        l, "element", i);
      }
    }
    for (size_t i = 0; i < run.field.table.size(); ++i)
      rows.compare(run.field.table[i], table[0][2 * i],
                   golden_tolerance(table[0][2 * i], table[0][2 * i + 1]), "row", i / 4, "feature",
                   i % 4);
    // Rows had steps of their own: some missed one.
    EXPECT_EQ(run.learning < run.all, variant == Variant::kRoulette);
    Real least = kSteps;
    for (const auto& states : run.states)
      least = std::min(least, std::ranges::min(states->part(kRowSteps)));
    EXPECT_LT(least, kSteps);
  });
  loss.report();
  network.report();
  rows.report();
}

TEST(GridTraining, TenStepsMatchTheGoldenRun) {
  expect_golden_run("grid_training.txt", Variant::kOwnColours);
}

TEST(GridTraining, TenStepsWithSharedColoursMatchTheGoldenRun) {
  expect_golden_run("grid_training_shared.txt", Variant::kSharedColours);
}

TEST(GridTraining, TenStepsWithRouletteMatchTheGoldenRun) {
  expect_golden_run("grid_training_roulette.txt", Variant::kRoulette);
}

// The same on any chunk memory, however often: nothing is left over from a run.
TEST(GridTraining, IsRepeatable) {
  TinyRun a, b;
  for (int s = 0; s < 3; ++s) ASSERT_EQ(a.step(s), b.step(s));
  for (size_t i = 0; i < a.field.table.size(); ++i) ASSERT_EQ(a.field.table[i], b.field.table[i]);
  for (size_t i = 0; i < a.field.weights.size(); ++i)
    ASSERT_EQ(a.field.weights[i], b.field.weights[i]);
}

}  // namespace
}  // namespace nerf
