// Derivatives of the templates of encodings and of softplus, by complex step, against formulas
// written out, in the order of features that the operations document.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <type_traits>
#include <vector>

#include "math/complex_step.h"
#include "math/template_error.h"
#include "math/worst_error.h"
#include "nerf/math/reference/activations.h"
#include "nerf/math/reference/encoding.h"

namespace nerf {
namespace {

namespace ref = reference;
using test::kExact;
using test::tolerance;

// exp(y) = 1 + exp(x), and the slope of a sigmoid; each relative to itself, however small it is.
TEST(ReferenceSoftplus, HasTheSlopeOfASigmoid) {
  WorstError value("value"), slope("slope"), dual("dual");
  for (const double x :
       {-500.0, -40.0, -15.0, -1.0, -1e-9, 0.0, 1e-300, 1e-9, 0.7, 20.0, 37.0, 700.0, 1e6, 1e300}) {
    const double e = std::exp(-std::fabs(x)), sigmoid = (x < 0 ? e : 1) / (1 + e);
    const Complex y = ref::softplus(Complex(x, kComplexStep));
    if (x < 700) value.compare(std::expm1(y.real()), std::exp(x), kExact * std::exp(x), "at", x);
    if (x > 30) value.compare(y.real(), x, kExact * x, "at", x);
    slope.compare(y.imag() / kComplexStep, sigmoid, kExact * sigmoid, "at", x);
    dual.compare(ref::softplus(ref::Dual(x, 1)).derivative, sigmoid, kExact * sigmoid, "at", x);
  }
  for (const WorstError* e : {&value, &slope, &dual}) e->report();
}

// A row of features, and its derivative by the coordinate that it is made of.
struct Feature {
  size_t coordinate;
  double value, slope;
};

// A frequency's features: weight sin(f x), or weight cos(f x).
Feature feature(bool sine, size_t coordinate, int k, double weight, double x) {
  const double f = std::ldexp(1.0, k);
  return sine ? Feature{coordinate, weight * std::sin(f * x), weight * f * std::cos(f * x)}
              : Feature{coordinate, weight * std::cos(f * x), -weight * f * std::sin(f * x)};
}

// The features f(x), and the derivatives of each by every coordinate: 0 but by its own.
template <class F>
void check_features(const std::string& name, const F& f, const std::vector<double>& x,
                    const std::vector<Feature>& want) {
  WorstError value(name), slope(name + "_slope"), dual(name + "_dual");
  const std::vector<double> got = f(x);
  ASSERT_EQ(got.size(), want.size());
  for (size_t i = 0; i < x.size(); ++i) {
    std::vector<Complex> stepped = to_complex(x);
    stepped[i] += Complex(0, kComplexStep);
    std::vector<ref::Dual> along(x.begin(), x.end());
    along[i].derivative = 1;
    const auto by_step = f(stepped);
    const auto by_dual = f(along);
    for (size_t row = 0; row < want.size(); ++row) {
      const double d = i == want[row].coordinate ? want[row].slope : 0;
      slope.compare(by_step[row].imag() / kComplexStep, d, tolerance(d), "row", row, "by", i, "at",
                    x[i]);
      dual.compare(by_dual[row].derivative, d, tolerance(d), "row", row, "by", i, "at", x[i]);
    }
  }
  for (size_t row = 0; row < want.size(); ++row)
    value.compare(got[row], want[row].value, tolerance(want[row].value), "row", row);
  for (const WorstError* e : {&value, &slope, &dual}) e->report();
}

// Near 0, within a turn and beyond thousands: 2^k x is exact.
const std::vector<std::vector<double>> kPlaces = {
    {0, -0.0, 1e-300}, {0.3, -1.7, 3.14159}, {1e-9, 1e5, -98765.4321}, {0.5, 1e6, -2}};

void check_frequencies(const std::string& name, const std::vector<double>& weights) {
  for (const std::vector<double>& x : kPlaces)
    for (const bool identity : {false, true}) {
      std::vector<Feature> want;
      for (size_t i = 0; identity && i < x.size(); ++i) want.push_back({i, x[i], 1});
      for (int k = 0; k < static_cast<int>(weights.size()); ++k)
        for (const bool sine : {true, false})
          for (size_t i = 0; i < x.size(); ++i)
            want.push_back(feature(sine, i, k, weights[static_cast<size_t>(k)], x[i]));
      check_features(
          name, [&](const auto& at) { return ref::frequency_encoding(at, weights, identity); }, x,
          want);
    }
}

TEST(ReferenceEncoding, FrequenciesHaveTheirSlopes) {
  check_frequencies("frequency", std::vector<double>(10, 1.0));
}

// Shut, within a frequency, at the end of one, next to it, and open. Weights by another formula:
// (1 - cos a) / 2 = sin^2(a / 2).
TEST(ReferenceEncoding, WindowsScaleFeaturesAndSlopes) {
  constexpr int kFrequencies = 6;
  for (const double alpha : {0.0, 1e-3, 0.5, 2.0, std::nextafter(2.0, 3.0), 4.75, 6.0, 9.0}) {
    std::vector<double> weights;
    for (int k = 0; k < kFrequencies; ++k) {
      weights.push_back(ref::window_weight(alpha, k));
      const double open = std::fmin(1.0, std::fmax(0.0, alpha - k));
      const double half = std::sin(0.5 * std::acos(-1.0) * open);
      EXPECT_NEAR(weights.back(), half * half, 1e-15) << alpha << ' ' << k;
    }
    check_frequencies("window", weights);
  }
}

// The expectations of sin(f x) and cos(f x) of a Gaussian: exp(-f^2 v / 2) times those of its mean;
// by the variance, -f^2 / 2 times themselves. x: the means, then the variances.
TEST(ReferenceEncoding, IntegratedHasItsSlopesByMeanAndVariance) {
  constexpr int kDegrees = 8;
  for (const std::vector<double>& mean : kPlaces)
    for (const double spread : {0.0, 1e-12, 1e-3, 0.2, 30.0}) {
      std::vector<double> x = mean;
      for (const double share : {1.0, 0.0, 0.37}) x.push_back(spread * share);
      std::vector<Feature> by_mean, by_variance;
      for (const bool sine : {true, false})
        for (int k = 0; k < kDegrees; ++k)
          for (size_t i = 0; i < 3; ++i) {
            const double half = 0.5 * std::ldexp(1.0, 2 * k), left = std::exp(-half * x[3 + i]);
            by_mean.push_back(feature(sine, i, k, left, x[i]));
            by_variance.push_back({i, by_mean.back().value, -half * by_mean.back().value});
          }
      const auto of_mean = [&](const auto& at) {
        using V = std::decay_t<decltype(at)>;
        return ref::integrated_encoding(at, V(x.begin() + 3, x.end()), kDegrees);
      };
      const auto of_variance = [&](const auto& at) {
        using V = std::decay_t<decltype(at)>;
        return ref::integrated_encoding(V(x.begin(), x.begin() + 3), at, kDegrees);
      };
      check_features("integrated_mean", of_mean, mean, by_mean);
      check_features("integrated_variance", of_variance, {x.begin() + 3, x.end()}, by_variance);
    }
}

}  // namespace
}  // namespace nerf
