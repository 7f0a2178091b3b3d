// Gradients of the operations that the paper methods are written with; operations_test.cc has those
// of the grid method.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/autodiff/operations.h"
#include "nerf/math/reference/encoding.h"
#include "nerf/math/window.h"

namespace nerf {
namespace {

TEST(Gradient, LinearWithBias) {
  static const LinearWeights w{0, 5, 19, true}, next{w.size(), 19, 2, true};
  for (Domain domain : {kSamples, kRays})
    check_operation({"linear_bias",
                     {{5, domain, true}},
                     {w, next},
                     [](Tape& t, const Values& v) {
                       const Value a = linear(t, v[0], w, LinearActivation::kRelu);
                       return Values{linear(t, a, next, LinearActivation::kNone)};
                     },
                     110},
                    []<class T>(const Given<T>& v) -> Outputs<T> {
                      const auto a = on_columns::linear(v[0], v.weights, w, true);
                      return {on_columns::linear(a, v.weights, next, false)};
                    });
}

// Frequencies up to 2^5, some of them partly open.
TEST(Gradient, FrequencyEncoding) {
  static const std::vector<double> weights{1, 1, 0.75, 0.5, 0.25, 0};
  static const std::vector<Real> as_float(weights.begin(), weights.end());
  for (bool identity : {false, true})
    for (Domain domain : {kSamples, kRays})
      check_operation({"frequency_encoding",
                       {{3, domain, true, -2, 2}},
                       {},
                       [=](Tape& t, const Values& v) {
                         return Values{frequency_encoding(t, v[0], as_float, identity)};
                       },
                       90},
                      [=]<class T>(const Given<T>& v) -> Outputs<T> {
                        return {on_columns::frequency_encoding(v[0], weights, identity)};
                      });
}

// A window that opens between passes: the tape stays, its features are those of the new weights.
TEST(FrequencyEncoding, TheWindowMayOpenWhileTraining) {
  constexpr int kFrequencies = 4;
  const auto window = std::make_shared<std::vector<Real>>(kFrequencies);
  Tape tape(kLane, kLane);
  const Value x = tape.input(2, kSamples);
  const Value y = frequency_encoding(tape, x, FrequencyWeights(window), /*identity=*/true);
  tape.plan();
  Chunk chunk(tape);
  chunk.samples = kLane;
  const int64_t ld = chunk.stride(y);
  for (int64_t i = 0; i < kLane; ++i) {
    chunk.data(x)[i] = static_cast<Real>(0.1 * static_cast<double>(i));
    chunk.data(x)[chunk.stride(x) + i] = -0.3_r;
  }
  for (const double alpha : {0.0, 1.0, 2.5, 4.0}) {
    window_weights(alpha, *window);
    tape.forward(chunk);
    for (int k = 0; k < kFrequencies; ++k) {
      const double weight = reference::window_weight(alpha, k);
      for (int64_t i = 0; i < kLane; ++i) {
        const double at = std::ldexp(static_cast<double>(chunk.data(x)[i]), k);
        EXPECT_NEAR(chunk.data(y)[(2 + 4 * k) * ld + i], weight * std::sin(at), 1e-6) << alpha;
        EXPECT_NEAR(chunk.data(y)[(4 + 4 * k) * ld + i], weight * std::cos(at), 1e-6) << alpha;
      }
    }
  }
}

TEST(Gradient, IntegratedEncoding) {
  for (int needs = 1; needs < 4; ++needs)  // which of mean and variance need a gradient
    for (double spread : {0.0, 0.01, 3.0})
      check_operation(
          {"integrated_encoding",
           {{3, kSamples, (needs & 1) != 0, -2, 2}, {3, kSamples, (needs & 2) != 0, 0, spread}},
           {},
           [](Tape& t, const Values& v) { return Values{integrated_encoding(t, v[0], v[1], 6)}; },
           90},
          []<class T>(const Given<T>& v) -> Outputs<T> {
            return {on_columns::integrated_encoding(v[0], v[1], 6)};
          });
}

TEST(Gradient, EncodingBesideOtherReaders) {
  static const std::vector<double> weights{1, 1};
  static const std::vector<Real> as_float{1, 1};
  check_operation({"encoding_shared",
                   {{2, kSamples, true, -2, 2}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value a = frequency_encoding(t, v[0], as_float, true);
                     const Value b = sigmoid(t, v[0]);
                     return Values{a, b, frequency_encoding(t, b, as_float, false), v[0]};
                   },
                   110},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto b = on_columns::sigmoid(v[0]);
                    return {on_columns::frequency_encoding(v[0], weights, true), b,
                            on_columns::frequency_encoding(b, weights, false), v[0]};
                  });
}

// Some rows are asked for several times, some never, and some columns ask for none.
TEST(Gradient, TableRows) {
  static const LinearWeights table{0, 5, 4};
  for (Domain domain : {kSamples, kRays})
    check_operation(
        {"table_rows",
         {{1, domain, false, -1, 4}},
         {table},
         [](Tape& t, const Values& v) { return Values{sigmoid(t, table_rows(t, v[0], table))}; },
         60},
        []<class T>(const Given<T>& v) -> Outputs<T> {
          return {on_columns::sigmoid(on_columns::table_rows(v[0], v.weights, table))};
        });
}

TEST(Gradient, Softplus) {
  for (double range : {3.0, 60.0})
    for (Real shift : {0.0_r, -1.0_r})
      check_operation({"softplus",
                       {{2, kSamples, true, -range, range}},
                       {},
                       [=](Tape& t, const Values& v) { return Values{softplus(t, v[0], shift)}; },
                       90},
                      [=]<class T>(const Given<T>& v) -> Outputs<T> {
                        return {on_columns::softplus(v[0], static_cast<double>(shift))};
                      });
}

TEST(Gradient, ReluAndScaleShift) {
  check_operation({"relu",
                   {{3, kSamples, true}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value a = relu(t, v[0]);
                     return Values{a, scale_shift(t, v[0], 1.5_r, -0.25_r), sigmoid(t, a)};
                   },
                   80},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto a = on_columns::relu(v[0]);
                    return {a, on_columns::scale_shift(v[0], 1.5, -0.25), on_columns::sigmoid(a)};
                  });
}

TEST(Gradient, Add) {
  for (int needs = 1; needs < 4; ++needs)
    check_operation({"add",
                     {{3, kSamples, (needs & 1) != 0}, {3, kSamples, (needs & 2) != 0}},
                     {},
                     [](Tape& t, const Values& v) {
                       const Value a = add(t, v[0], v[1]);
                       return Values{a, add(t, a, v[0]), add(t, v[1], v[1])};
                     },
                     90},
                    []<class T>(const Given<T>& v) -> Outputs<T> {
                      const auto a = on_columns::add(v[0], v[1]);
                      return {a, on_columns::add(a, v[0]), on_columns::add(v[1], v[1])};
                    });
}

TEST(Gradient, RepeatForSamples) {
  check_operation({"repeat",
                   {{3, kRays, true}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value a = repeat_for_samples(t, v[0]), b = sigmoid(t, v[0]);
                     return Values{a, b, repeat_for_samples(t, v[0])};
                   },
                   140},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto a = on_columns::repeat_for_samples(v[0], v.rays);
                    return {a, on_columns::sigmoid(v[0]), a};
                  });
}

// Thin, ordinary and opaque matter, with and without a closed end.
TEST(Gradient, RenderWeights) {
  for (bool opaque_end : {false, true})
    for (double most : {0.01, 8.0, 1e4})
      check_operation({"render_weights",
                       {{1, kSamples, true, 0, most}, {1, kSamples, false, 0.01, 0.3}},
                       {},
                       [=](Tape& t, const Values& v) {
                         return Values{render_weights(t, v[0], v[1], opaque_end)};
                       },
                       300,
                       /*shared=*/1},
                      [=]<class T>(const Given<T>& v) -> Outputs<T> {
                        return {on_columns::render_weights(v[0], v[1], v.rays, opaque_end)};
                      });
}

TEST(Gradient, Accumulate) {
  for (int needs = 1; needs < 4; ++needs)
    check_operation(
        {"accumulate",
         {{1, kSamples, (needs & 1) != 0, 0, 0.1},
          {3, kSamples, (needs & 2) != 0, 0, 1},
          {3, kRays, false, 0, 1}},
         {},
         [](Tape& t, const Values& v) { return Values{accumulate(t, v[0], v[1], v[2])}; },
         300},
        []<class T>(const Given<T>& v) -> Outputs<T> {
          return {on_columns::accumulate(v[0], v[1], v[2], v.rays)};
        });
}

TEST(Gradient, SumAlongRays) {
  for (int needs = 1; needs < 4; ++needs)
    check_operation(
        {"sum_along_rays",
         {{1, kSamples, (needs & 1) != 0, 0, 0.1}, {5, kSamples, (needs & 2) != 0, -1, 1}},
         {},
         [](Tape& t, const Values& v) { return Values{sum_along_rays(t, v[0], v[1])}; },
         300},
        []<class T>(const Given<T>& v) -> Outputs<T> {
          return {on_columns::sum_along_rays(v[0], v[1], v.rays, 5)};
        });
}

TEST(Gradient, Over) {
  for (int needs = 1; needs < 4; ++needs)
    check_operation({"over",
                     {{3, kRays, (needs & 1) != 0, 0, 1},
                      {1, kRays, (needs & 2) != 0, 0, 1},
                      {3, kRays, false, 0, 1}},
                     {},
                     [](Tape& t, const Values& v) { return Values{over(t, v[0], v[1], v[2])}; },
                     20},
                    []<class T>(const Given<T>& v) -> Outputs<T> {
                      return {on_columns::over(v[0], v[1], v[2])};
                    });
}

// Features and weights read twice, by what adds to a gradient that is there.
TEST(Gradient, SumsAlongRaysWithOtherReaders) {
  check_operation({"sums_shared",
                   {{1, kSamples, true, -2, 2},
                    {4, kSamples, true, -1, 1},
                    {1, kSamples, false, 0.01, 0.3},
                    {3, kRays, false, 0, 1}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value w = render_weights(t, softplus(t, v[0], -1), v[2], false);
                     const Value sums = sum_along_rays(t, w, v[1]);
                     const Value colour = slice(t, sums, 0, 3), opacity = slice(t, sums, 4, 1);
                     return Values{over(t, colour, opacity, v[3]), colour, opacity, w, v[1]};
                   },
                   400,
                   /*shared=*/4},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto w = on_columns::render_weights(on_columns::softplus(v[0], -1), v[2],
                                                              v.rays, false);
                    const auto sums = on_columns::sum_along_rays(w, v[1], v.rays, 4);
                    const auto colour = on_columns::slice(sums, 0, 3);
                    const auto opacity = on_columns::slice(sums, 4, 1);
                    return {on_columns::over(colour, opacity, v[3]), colour, opacity, w, v[1]};
                  });
}

// The whole path, weights read twice.
TEST(Gradient, WeightsWithTwoReaders) {
  check_operation({"weights_shared",
                   {{1, kSamples, true, -2, 2},
                    {3, kSamples, true, -2, 2},
                    {1, kSamples, false, 0.01, 0.3},
                    {3, kRays, false, 0, 1}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value w = render_weights(t, softplus(t, v[0], -1), v[2], false);
                     return Values{accumulate(t, w, sigmoid(t, v[1]), v[3]), w};
                   },
                   400,
                   /*shared=*/1},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto w = on_columns::render_weights(on_columns::softplus(v[0], -1), v[2],
                                                              v.rays, false);
                    return {on_columns::accumulate(w, on_columns::sigmoid(v[1]), v[3], v.rays), w};
                  });
}

TEST(Gradient, SquaredAndCharbonnierLoss) {
  const std::vector<TestInput> inputs{
      {4, kRays, true, -0.2, 1.2}, {3, kRays, false, 0, 1}, {1, kRays, false, 0.01, 1}};
  check_operation({"squared_loss",
                   inputs,
                   {},
                   [](Tape& t, const Values& v) {
                     squared_loss(t, v[0], v[1], v[2]);
                     return Values{};
                   },
                   40},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    return {on_columns::squared_loss(v[0], v[1], v[2])};
                  });
  for (double epsilon : {0.001, 0.5})
    check_operation({"charbonnier_loss",
                     inputs,
                     {},
                     [=](Tape& t, const Values& v) {
                       charbonnier_loss(t, v[0], v[1], v[2], static_cast<Real>(epsilon));
                       return Values{};
                     },
                     40},
                    [=]<class T>(const Given<T>& v) -> Outputs<T> {
                      return {on_columns::charbonnier_loss(
                          v[0], v[1], v[2], static_cast<double>(static_cast<Real>(epsilon)))};
                    });
}

// What a caller writes between the passes reaches the value, beside its other readers.
TEST(Gradient, AddGradient) {
  WorstError worst("add_gradient");
  for_each_target([&](const std::string&) {
    for (bool shared : {false, true}) {
      Tape tape(32, 16);
      const Value x = tape.input(2, kSamples, true), extra = tape.input(2, kSamples);
      const Value y = shared ? sigmoid(tape, x) : x;
      if (shared) add_gradient(tape, x, extra);
      add_gradient(tape, y, extra);
      tape.plan();
      Chunk chunk(tape);
      const Rays rays{0, 3, 20};
      chunk.samples = 20;
      chunk.rays = 2;
      chunk.ray_begin = rays.data();
      std::fill(chunk.arena.begin(), chunk.arena.end(), 0.25_r);
      tape.forward(chunk);
      const int ld = static_cast<int>(chunk.stride(x));
      for (int i = 0; i < 2 * ld; ++i) chunk.data(extra)[i] = static_cast<Real>(i);
      tape.backward(chunk);
      for (int row = 0; row < 2; ++row)
        for (int s = 0; s < 32; ++s) {
          const double given = row * ld + s;
          const Complex at(0.25, kComplexStep);
          Complex loss =
              reference::add_gradient<Complex>({shared ? reference::sigmoid(at) : at}, {given});
          if (shared) loss += reference::add_gradient<Complex>({at}, {given});
          const double want = s >= 20 ? 0 : loss.imag() / kComplexStep;
          // A sigmoid is off by a few roundings, its slope by as many again.
          worst.compare(chunk.gradient(x)[row * ld + s], want, 20 * kRoundoff * want, "shared",
                        shared, "row", row, "sample", s);
        }
    }
  });
  worst.report();
}

}  // namespace
}  // namespace nerf
