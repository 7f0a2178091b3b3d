#include "nerf/autodiff/operations.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "autodiff/reference_ops.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/kernels/encoding.h"

namespace nerf {
namespace {

constexpr LinearActivation kPlain = LinearActivation::kNone, kRelu = LinearActivation::kRelu;

// Layers placed one after the other, as a model does.
std::vector<LinearWeights> place(const std::vector<int>& widths) {
  std::vector<LinearWeights> out;
  size_t offset = 0;
  for (size_t i = 0; i + 1 < widths.size(); ++i) {
    out.push_back({offset, widths[i], widths[i + 1]});
    offset += out.back().size();
  }
  return out;
}

TEST(Gradient, Linear) {
  for (const auto& [in, out] : {std::pair{1, 1}, {5, 3}, {3, 17}, {31, 8}})
    for (Domain domain : {kSamples, kRays})
      for (bool relu : {false, true}) {
        const auto w = place({in, out});
        SCOPED_TRACE(std::to_string(in) + " to " + std::to_string(out));
        check_operation({"linear",
                         {{in, domain, true}},
                         w,
                         [&](Tape& t, const Values& v) {
                           return Values{linear(t, v[0], w[0], relu ? kRelu : kPlain)};
                         },
                         // Sums over inputs, outputs and samples, and the loss's over all.
                         70.0 + in + out},
                        [&]<class T>(const Given<T>& v) -> Outputs<T> {
                          return {on_columns::linear(v[0], v.weights, w[0], relu)};
                        });
      }
}

// A first layer needs no gradient of its input; its weights do.
TEST(Gradient, LinearOfConstantInput) {
  static const auto w = place({6, 4});
  check_operation({"linear_constant",
                   {{6, kSamples, false}},
                   w,
                   [](Tape& t, const Values& v) { return Values{linear(t, v[0], w[0], kRelu)}; },
                   80},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    return {on_columns::linear(v[0], v.weights, w[0], true)};
                  });
}

// The output of a ReLU layer read by: another layer alone (which masks it), two layers, a layer and
// the loss, something that is no layer. And one input read by three layers.
TEST(Gradient, ReluWithEveryKindOfReader) {
  static const std::vector<LinearWeights> w = place({7, 6, 5});
  static const LinearWeights other{w[1].offset + w[1].size(), 6, 9};
  static const LinearWeights third{other.offset + other.size(), 7, 2};
  const std::vector<LinearWeights> all{w[0], w[1], other, third};
  check_operation({"relu_one_layer",
                   {{7, kSamples, true}},
                   w,
                   [](Tape& t, const Values& v) {
                     return Values{linear(t, linear(t, v[0], w[0], kRelu), w[1], kPlain)};
                   },
                   100},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    return {on_columns::mlp(v[0], v.weights, w)};
                  });
  check_operation({"relu_two_layers",
                   {{7, kSamples, true}},
                   all,
                   [](Tape& t, const Values& v) {
                     const Value a = linear(t, v[0], w[0], kRelu);
                     const Value y = linear(t, a, w[1], kRelu), z = linear(t, a, other, kPlain);
                     return Values{y, z, linear(t, v[0], third, kRelu)};
                   },
                   100},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto a = on_columns::linear(v[0], v.weights, w[0], true);
                    return {on_columns::linear(a, v.weights, w[1], true),
                            on_columns::linear(a, v.weights, other, false),
                            on_columns::linear(v[0], v.weights, third, true)};
                  });
  check_operation({"relu_layer_and_loss",
                   {{7, kSamples, true}},
                   w,
                   [](Tape& t, const Values& v) {
                     const Value a = linear(t, v[0], w[0], kRelu);
                     return Values{a, linear(t, a, w[1], kPlain)};
                   },
                   100},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto a = on_columns::linear(v[0], v.weights, w[0], true);
                    return {a, on_columns::linear(a, v.weights, w[1], false)};
                  });
  check_operation({"relu_sigmoid_and_layer",
                   {{7, kSamples, true}},
                   w,
                   [](Tape& t, const Values& v) {
                     const Value a = linear(t, v[0], w[0], kRelu);
                     const Value y = linear(t, a, w[1], kPlain);
                     return Values{sigmoid(t, a), y};
                   },
                   100},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto a = on_columns::linear(v[0], v.weights, w[0], true);
                    return {on_columns::sigmoid(a), on_columns::linear(a, v.weights, w[1], false)};
                  });
}

TEST(Gradient, Mlp) {
  for (const std::vector<int>& widths :
       {std::vector<int>{5, 3}, {8, 16, 3}, {6, 16, 17, 4}, {3, 16, 16, 16, 1}}) {
    const auto w = place(widths);
    check_operation({"mlp_" + std::to_string(w.size()),
                     {{widths[0], kSamples, true}},
                     w,
                     [&](Tape& t, const Values& v) { return Values{mlp(t, v[0], w)}; },
                     64.0 + 20 * static_cast<double>(widths.size())},
                    [&]<class T>(const Given<T>& v) -> Outputs<T> {
                      return {on_columns::mlp(v[0], v.weights, w)};
                    },
                    {{0, 1, 17, 17, 20, 37, 37}});
  }
}

// Layers wide enough for packs and panels, the input given again in the middle. Sums of 100 terms
// in each of three layers; two samples, for each of 9900 weights has its complex step.
TEST(Gradient, WideMlpWithASkip) {
  static const LinearWeights first{0, 3, 96}, second{first.size(), 99, 96},
      last{first.size() + second.size(), 96, 2};
  check_operation({"wide_mlp",
                   {{3, kSamples, true}},
                   {first, second, last},
                   [](Tape& t, const Values& v) {
                     const Value h = concat(t, linear(t, v[0], first, kRelu), v[0]);
                     return Values{linear(t, linear(t, h, second, kRelu), last, kPlain)};
                   },
                   300},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto h =
                        on_columns::concat(on_columns::linear(v[0], v.weights, first, true), v[0]);
                    return {on_columns::linear(on_columns::linear(h, v.weights, second, true),
                                               v.weights, last, false)};
                  },
                  {{0, 1, 2}});
}

TEST(Gradient, Concat) {
  for (int needs = 1; needs < 4; ++needs)  // which of the two need a gradient
    check_operation(
        {"concat",
         {{3, kSamples, (needs & 1) != 0}, {5, kSamples, (needs & 2) != 0}},
         {},
         [](Tape& t, const Values& v) { return Values{concat(t, v[0], v[1])}; },
         80},
        []<class T>(const Given<T>& v) -> Outputs<T> { return {on_columns::concat(v[0], v[1])}; });
  // Values that have other readers, and a value beside itself.
  check_operation({"concat_shared",
                   {{3, kRays, true}, {5, kRays, true}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value a = concat(t, v[0], v[1]), b = concat(t, v[1], v[0]);
                     return Values{a, b, concat(t, v[0], v[0]), v[1]};
                   },
                   80},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    return {on_columns::concat(v[0], v[1]), on_columns::concat(v[1], v[0]),
                            on_columns::concat(v[0], v[0]), v[1]};
                  });
}

TEST(Gradient, Slice) {
  for (const auto& [first, rows] : {std::pair{0, 1}, {0, 6}, {2, 3}, {5, 1}})
    check_operation({"slice",
                     {{6, kSamples, true}},
                     {},
                     [=](Tape& t, const Values& v) { return Values{slice(t, v[0], first, rows)}; },
                     80},
                    [=]<class T>(const Given<T>& v) -> Outputs<T> {
                      return {on_columns::slice(v[0], first, rows)};
                    });
  // Overlapping slices, one of them beside another reader: whichever runs backwards first must not
  // wipe out what the others add.
  check_operation({"slice_shared",
                   {{6, kSamples, true}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value a = slice(t, v[0], 0, 4), y = sigmoid(t, v[0]);
                     return Values{a, y, slice(t, v[0], 3, 3), slice(t, a, 1, 2)};
                   },
                   80},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto a = on_columns::slice(v[0], 0, 4);
                    return {a, on_columns::sigmoid(v[0]), on_columns::slice(v[0], 3, 3),
                            on_columns::slice(a, 1, 2)};
                  });
}

TEST(Gradient, TruncatedExp) {
  for (double range : {3.0, 40.0})  // beyond both kinks, where the slope is by definition
    for (Domain domain : {kSamples, kRays})
      check_operation({"truncated_exp",
                       {{2, domain, true, -range, range}},
                       {},
                       [](Tape& t, const Values& v) { return Values{truncated_exp(t, v[0])}; },
                       80},
                      []<class T>(const Given<T>& v) -> Outputs<T> {
                        return {on_columns::truncated_exp(v[0])};
                      });
}

TEST(Gradient, Sigmoid) {
  check_operation(
      {"sigmoid",
       {{3, kSamples, true, -6, 6}},
       {},
       [](Tape& t, const Values& v) { return Values{sigmoid(t, v[0])}; },
       80},
      []<class T>(const Given<T>& v) -> Outputs<T> { return {on_columns::sigmoid(v[0])}; });
}

// Two functions of one value, one after the other: the second to run backwards adds.
TEST(Gradient, ElementwiseWithSeveralReaders) {
  check_operation({"elementwise_shared",
                   {{4, kSamples, true, -3, 3}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value a = truncated_exp(t, v[0]), b = sigmoid(t, v[0]);
                     const Value c = sigmoid(t, a), d = truncated_exp(t, b);
                     return Values{c, d, a};
                   },
                   90},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto a = on_columns::truncated_exp(v[0]), b = on_columns::sigmoid(v[0]);
                    return {on_columns::sigmoid(a), on_columns::truncated_exp(b), a};
                  });
}

TEST(Gradient, ViewCode) {
  static const auto w = place({kSphericalHarmonics, 3});
  check_operation({"view_code",
                   {{3, kRays, false, -1, 1, /*unit=*/true}},
                   w,
                   [](Tape& t, const Values& v) {
                     const Value code = view_code(t, v[0]);
                     return Values{code, linear(t, code, w[0], kPlain)};
                   },
                   100},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto code = on_columns::view_code(v[0], v.rays);
                    return {code, on_columns::linear(code, v.weights, w[0], false)};
                  });
  check_operation({"view_code_of_rays",
                   {{3, kRays, false, -1, 1, /*unit=*/true}},
                   w,
                   [](Tape& t, const Values& v) {
                     const Value code = view_code(t, v[0], kRays);
                     return Values{code, linear(t, code, w[0], kPlain)};
                   },
                   100},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto code = on_columns::view_code_of_rays(v[0]);
                    return {code, on_columns::linear(code, v.weights, w[0], false)};
                  });
}

// Thin, ordinary and opaque matter. Optical depths are sums of up to 64 terms.
TEST(Gradient, Composite) {
  for (double most : {0.01, 8.0, 1e4})
    check_operation({"composite",
                     {{1, kSamples, true, 0, most},
                      {3, kSamples, true, 0, 1},
                      {1, kSamples, false, 0.01, 0.3},
                      {3, kRays, false, 0, 1}},
                     {},
                     [](Tape& t, const Values& v) {
                       return Values{composite(t, v[0], v[1], v[2], v[3]).pixel};
                     },
                     300,
                     /*shared=*/1},
                    []<class T>(const Given<T>& v) -> Outputs<T> {
                      return {on_columns::composite(v[0], v[1], v[2], v[3], v.rays).first};
                    });
}

// The weights that compositing leaves behind, and through the rest of a pixel's path.
TEST(Gradient, CompositeBehindActivations) {
  check_operation({"composite_weights",
                   {{1, kSamples, true, -4, 4},
                    {3, kSamples, true, -3, 3},
                    {1, kSamples, false, 0.01, 0.3},
                    {3, kRays, false, 0, 1}},
                   {},
                   [](Tape& t, const Values& v) {
                     const Value density = truncated_exp(t, v[0]), colour = sigmoid(t, v[1]);
                     const Composite image = composite(t, density, colour, v[2], v[3]);
                     return Values{image.pixel};
                   },
                   300,
                   /*shared=*/1},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto density = on_columns::truncated_exp(v[0]);
                    const auto colour = on_columns::sigmoid(v[1]);
                    return {on_columns::composite(density, colour, v[2], v[3], v.rays).first};
                  });
}

TEST(Gradient, HuberLoss) {
  for (double delta : {0.1, 0.5, 100.0})
    check_operation(
        {"huber_loss",
         {{4, kRays, true, -0.2, 1.2}, {3, kRays, false, 0, 1}, {1, kRays, false, 0.01, 1}},
         {},
         [=](Tape& t, const Values& v) {
           huber_loss(t, v[0], v[1], v[2], static_cast<Real>(delta));
           return Values{};
         },
         40},
        [=]<class T>(const Given<T>& v) -> Outputs<T> {
          return {on_columns::huber_loss(v[0], v[1], v[2],
                                         static_cast<double>(static_cast<Real>(delta)))};
        });
}

// A loss straight behind a layer over rays: columns that are padding must not reach its weights.
TEST(Gradient, HuberLossBehindALayer) {
  static const auto w = place({5, 4});
  check_operation({"huber_layer",
                   {{5, kRays, true}, {3, kRays, false, 0, 1}, {1, kRays, false, 0.01, 1}},
                   w,
                   [](Tape& t, const Values& v) {
                     huber_loss(t, linear(t, v[0], w[0], kPlain), v[1], v[2], 0.5_r);
                     return Values{};
                   },
                   60},
                  []<class T>(const Given<T>& v) -> Outputs<T> {
                    const auto pixel = on_columns::linear(v[0], v.weights, w[0], false);
                    return {on_columns::huber_loss(pixel, v[1], v[2], 0.5)};
                  });
}

}  // namespace
}  // namespace nerf
