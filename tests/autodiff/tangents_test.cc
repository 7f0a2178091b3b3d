// Derivatives of derivatives: tangents against dual numbers, and their gradients against dual
// numbers over complex ones with an imaginary step.
#include "nerf/autodiff/tangents.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "autodiff/reference_ops.h"
#include "autodiff/tangent_check.h"
#include "nerf/math/reference/encoding.h"
#include "nerf/math/window.h"

namespace nerf {
namespace {

// Where a gradient by complex step takes long: a part of a vector, a ray without samples.
const std::vector<Rays> kFewSamples = {{0}, {0, 1, 17, 17, 20}};

TEST(Tangents, OfActivations) {
  check_tangents(
      "tangent_truncated_exp", 2, 8, {},
      [](Tape& t, const WithTangents& x) { return truncated_exp(t, x); },
      [](auto x, const auto&) {
        for (auto& column : x)
          for (auto& v : column) {
            using std::exp;
            v = exp(v);
          }
        return x;
      },
      100);
  check_tangents(
      "tangent_sigmoid", 2, 4, {}, [](Tape& t, const WithTangents& x) { return sigmoid(t, x); },
      [](const auto& x, const auto&) { return on_columns::sigmoid(x); }, 100);
  check_tangents(
      "tangent_softplus", 2, 20, {},
      [](Tape& t, const WithTangents& x) { return softplus(t, x, -1); },
      [](const auto& x, const auto&) { return on_columns::softplus(x, -1.0); }, 120);
  check_tangents(
      "tangent_relu", 2, 1, {}, [](Tape& t, const WithTangents& x) { return relu(t, x); },
      [](const auto& x, const auto&) { return on_columns::relu(x); }, 10);
}

TEST(Tangents, OfProductsAndSums) {
  check_tangents(
      "tangent_product", 4, 2, {},
      [](Tape& t, const WithTangents& x) { return products_and_sums(t, x); },
      [](const auto& x, const auto&) { return products_and_sums_of(x); }, 20);
}

TEST(Tangents, OfEncodings) {
  static const std::vector<double> weights{1, 1, 0.75, 0.25};
  static const std::vector<Real> as_float(weights.begin(), weights.end());
  for (const bool identity : {false, true})
    check_tangents(
        "tangent_encoding", {3, Domain::kSamples, true, -2, 2}, {3, Domain::kSamples, true}, {},
        [=](Tape& t, const WithTangents& x) {
          return frequency_encoding(t, x, as_float, identity);
        },
        [=](const auto& x, const auto&) {
          return on_columns::frequency_encoding(x, weights, identity);
        },
        100, kFewSamples);
}

// A window that is shut, opens within a frequency, has just opened one, and is open. The weights
// are one rounding more, and those of the template are not those of the library.
TEST(Tangents, OfAWindowThatOpens) {
  for (const double alpha : {0.0, 0.5, 1.25, 3.0, 3.5, 4.0}) {
    std::vector<Real> open(4);
    window_weights(alpha, open);
    std::vector<double> weights;
    for (int k = 0; k < 4; ++k) weights.push_back(reference::window_weight(alpha, k));
    for (const bool identity : {false, true})
      check_tangents(
          "tangent_window", {3, Domain::kSamples, true, -2, 2}, {3, Domain::kSamples, true}, {},
          [=](Tape& t, const WithTangents& x) { return frequency_encoding(t, x, open, identity); },
          [=](const auto& x, const auto&) {
            return on_columns::frequency_encoding(x, weights, identity);
          },
          101, kFewSamples);
  }
}

// The same window on one tape, while a training opens it: values and tangents are those of what it
// is at the time of a pass, and so are their gradients.
TEST(Tangents, OfAWindowThatOpensBetweenPasses) {
  const auto window = std::make_shared<std::vector<Real>>(4);
  for (const bool identity : {false, true}) {
    Tape tape(kSampleCapacity, kRayCapacity);
    TapeUnderTest test{&tape, {}, {}, {}, {}, /*roundings=*/101};
    test.specs = {{3, Domain::kSamples, true, -2, 2}, {3, Domain::kSamples, true}};
    for (const TestInput& in : test.specs)
      test.inputs.push_back(tape.input(in.rows, in.domain, in.gradient));
    const WithTangents x{test.inputs[0], {test.inputs[1]}};
    const WithTangents y = frequency_encoding(tape, x, FrequencyWeights(window), identity);
    test.outputs = {y.value, y.tangents[0]};
    const Value end = tape.output(1, Domain::kRays, test.outputs);
    tape.record(std::make_unique<Probe>(test.outputs, end));
    tape.plan();
    for (const double alpha : {0.5, 4.0, 2.25, 0.0}) {
      SCOPED_TRACE("alpha " + std::to_string(alpha));
      window_weights(alpha, *window);
      std::vector<double> weights;
      for (int k = 0; k < 4; ++k) weights.push_back(reference::window_weight(alpha, k));
      check_gradients(
          "tangent_opening_window", test,
          [=]<class T>(const Given<T>& v) -> Outputs<T> {
            const auto out = on_columns::frequency_encoding(dual(v[0], v[1]), weights, identity);
            return {part(out, &TDual<T>::value), part(out, &TDual<T>::derivative)};
          },
          kFewSamples);
    }
  }
}

// Rays' values and tangents for all of their samples, which other operations read: a gradient is a
// sum over up to 64 samples.
TEST(Tangents, OfValuesOfRays) {
  for (int needs = 1; needs < 4; ++needs) {  // which of x and the directions need a gradient
    const TestInput direction{3, Domain::kRays, (needs & 2) != 0};
    check_operation({"tangent_repeat",
                     {{3, Domain::kRays, (needs & 1) != 0}, direction, direction},
                     {},
                     [](Tape& t, const std::vector<Value>& v) {
                       const WithTangents x =
                           repeat_for_samples(t, WithTangents{v[0], {v[1], v[2]}});
                       const WithTangents y = multiply(t, x, x);
                       return std::vector<Value>{y.value, y.tangents[0], y.tangents[1]};
                     },
                     140},
                    []<class T>(const Given<T>& v) -> Outputs<T> {
                      Outputs<T> out;
                      for (const size_t i : {size_t{1}, size_t{2}}) {
                        const auto x = on_columns::repeat_for_samples(dual(v[0], v[i]), v.rays);
                        const auto y = on_columns::multiply(x, x);
                        if (out.empty()) out.push_back(part(y, &TDual<T>::value));
                        out.push_back(part(y, &TDual<T>::derivative));
                      }
                      return out;
                    });
  }
}

// Constants above and below: their rows have tangents of 0, and their gradients are the value's
// alone. The tangents are read twice, so that one reader adds to what the other has left.
TEST(Tangents, OfConstantsBeside) {
  for (int needs = 1; needs < 8; ++needs) {  // which of x, the direction and the constants
    const TestInput constant{2, Domain::kSamples, (needs & 4) != 0};
    check_operation({"tangent_constants",
                     {{3, Domain::kSamples, (needs & 1) != 0},
                      {3, Domain::kSamples, (needs & 2) != 0},
                      constant,
                      constant},
                     {},
                     [](Tape& t, const std::vector<Value>& v) {
                       const WithTangents x{v[0], {v[1]}};
                       const WithTangents y = concat(t, v[2], concat(t, x, v[3]));
                       const WithTangents z = multiply(t, y, concat(t, concat(t, v[3], x), v[2]));
                       return std::vector<Value>{y.value, y.tangents[0], z.value, z.tangents[0]};
                     },
                     20},
                    []<class T>(const Given<T>& v) -> Outputs<T> {
                      const Columns<T> none(v[2].size(), std::vector<T>(2, T(0)));
                      const auto x = dual(v[0], v[1]), above = dual(v[2], none),
                                 below = dual(v[3], none);
                      const auto y = on_columns::concat(above, on_columns::concat(x, below));
                      const auto z = on_columns::multiply(
                          y, on_columns::concat(on_columns::concat(below, x), above));
                      return {part(y, &TDual<T>::value), part(y, &TDual<T>::derivative),
                              part(z, &TDual<T>::value), part(z, &TDual<T>::derivative)};
                    });
  }
}

// A constant that is no number has no part in the tangents beside it.
TEST(Tangents, OfConstantsThatAreNoNumbers) {
  Tape tape(kLane, kLane);
  const Value x = tape.input(1, Domain::kSamples), along = tape.input(1, Domain::kSamples);
  const Value code = tape.input(2, Domain::kSamples);
  const Value tangent =
      concat(tape, code, concat(tape, WithTangents{x, {along}}, code)).tangents[0];
  tape.plan();
  Chunk chunk(tape);
  chunk.samples = 1;
  chunk.data(x)[0] = 2;
  chunk.data(along)[0] = 3;
  for (int r = 0; r < 2; ++r) chunk.data(code)[r * chunk.stride(code)] = Real{NAN};
  tape.forward(chunk);
  for (int r = 0; r < 5; ++r)
    EXPECT_EQ(chunk.data(tangent)[r * chunk.stride(tangent)], r == 2 ? 3 : 0) << r;
}

// A warp and its Jacobian, as a deformation field has them: x + mlp(x behind a window, a code). The
// code is a photo's row of a table, the same for a ray's samples and for whichever way x goes: its
// tangents are 0, and its gradient is of both. Roundings: of features and their tangents 8, of the
// layers' sums and biases 27 and 8, as many backward, and sums over 20 samples and their rays.
TEST(Tangents, OfAWarpWithACode) {
  static const LinearWeights table{0, 5, 4}, a{table.size(), 3 + 3 * 6 + 5, 7, true},
      b{table.size() + a.size(), 7, 3, true};
  constexpr double kOpen = 1.5;
  const std::vector<double> weights{reference::window_weight(kOpen, 0),
                                    reference::window_weight(kOpen, 1),
                                    reference::window_weight(kOpen, 2)};
  std::vector<Real> open(3);
  window_weights(kOpen, open);
  for (int needs = 1; needs < 4; ++needs) {  // which of x and the directions need a gradient
    const TestInput direction{3, Domain::kSamples, (needs & 2) != 0};
    check_operation(
        {"tangent_warp",
         {{3, Domain::kSamples, (needs & 1) != 0},
          {1, Domain::kRays, false, -1, 3},  // -1: no photo's
          direction,
          direction},
         {table, a, b},
         [=](Tape& t, const std::vector<Value>& v) {
           const WithTangents x{v[0], {v[2], v[3]}};
           const Value code = repeat_for_samples(t, table_rows(t, v[1], table));
           WithTangents h = concat(t, frequency_encoding(t, x, open, true), code);
           h = linear(t, h, a, LinearActivation::kRelu);
           const WithTangents y = add(t, x, linear(t, h, b, LinearActivation::kNone));
           return std::vector<Value>{y.value, y.tangents[0], y.tangents[1]};
         },
         110},
        [=]<class T>(const Given<T>& v) -> Outputs<T> {
          const Columns<T> code = on_columns::repeat_for_samples(
              on_columns::table_rows(v[1], v.weights, table), v.rays);
          const Columns<T> none(code.size(), std::vector<T>(5, T(0)));
          Outputs<T> out;
          for (const size_t i : {size_t{2}, size_t{3}}) {
            const Columns<TDual<T>> x = dual(v[0], v[i]);
            const std::vector<TDual<T>> w = constants(v.weights);
            auto h = on_columns::frequency_encoding(x, weights, true);
            h = on_columns::concat(h, dual(code, none));
            h = on_columns::linear(on_columns::linear(h, w, a, true), w, b, false);
            const auto y = on_columns::add(x, h);
            if (out.empty()) out.push_back(part(y, &TDual<T>::value));
            out.push_back(part(y, &TDual<T>::derivative));
          }
          return out;
        },
        kFewSamples);
  }
}

// The gradient of density, as a loss on normals sees it: encoding, layers with biases, softplus.
TEST(Tangents, OfAWholeField) {
  static const std::vector<double> weights{1, 1};
  static const std::vector<Real> as_float{1, 1};
  static const LinearWeights a{0, 15, 7, true}, b{a.size(), 7, 6, true},
      c{a.size() + b.size(), 6, 1, true};
  check_tangents(
      "tangent_field", 3, 1, {a, b, c},
      [](Tape& t, const WithTangents& x) {
        WithTangents h = frequency_encoding(t, x, as_float, true);
        h = linear(t, h, a, LinearActivation::kRelu);
        h = linear(t, h, b, LinearActivation::kRelu);
        return softplus(t, linear(t, h, c, LinearActivation::kNone), -1);
      },
      [](const auto& x, const auto& w) {
        auto h = on_columns::frequency_encoding(x, weights, true);
        h = on_columns::linear(h, w, a, true);
        h = on_columns::linear(h, w, b, true);
        return on_columns::softplus(on_columns::linear(h, w, c, false), -1.0);
      },
      260);
}

}  // namespace
}  // namespace nerf
