// Derivatives of derivatives: tangents against dual numbers, and their gradients against dual
// numbers over complex ones with an imaginary step.
#include "nerf/autodiff/tangents.h"

#include <gtest/gtest.h>

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
        "tangent_encoding", 3, 2, {},
        [=](Tape& t, const WithTangents& x) {
          return frequency_encoding(t, x, as_float, identity);
        },
        [=](const auto& x, const auto&) {
          return on_columns::frequency_encoding(x, weights, identity);
        },
        100);
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
           const Value none = scale_shift(t, code, 0, 0);
           WithTangents h = frequency_encoding(t, x, open, true);
           h = concat(t, h, {code, {none, none}});
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
