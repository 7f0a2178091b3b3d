// Derivatives of derivatives: tangents against dual numbers, and their gradients against dual
// numbers over complex ones with an imaginary step.
#include "nerf/autodiff/tangents.h"

#include <gtest/gtest.h>

#include <vector>

#include "autodiff/reference_ops.h"
#include "autodiff/tangent_check.h"

namespace nerf {
namespace {

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
