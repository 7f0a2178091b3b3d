// Operations of the tape on numbers of every magnitude, forward and backward, by the generic test
// of gradients: against their templates in double, with tolerances from the templates' own terms.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "autodiff/reference_ops.h"
#include "autodiff/tangent_check.h"
#include "nerf/base/threads.h"
#include "stress/magnitudes.h"

namespace nerf::stress {
namespace {

const std::vector<Rays> kLayouts = {{0}, {0, 1}, {0, 17, 17, 37}, {0, 64}};
// Where a gradient by complex step takes long.
const std::vector<Rays> kFewSamples = {{0}, {0, 5, 5, 18}};

// Powers of ten whose products, summed over a ray, stay below the largest float. Where denormals
// are flushed what is one at the start is none.
struct Range {
  double low, high;
  bool flush;
};
constexpr Range kRanges[] = {{-18, 18, false}, {-18, 18, true},   {15, 18, true},
                             {-36, -2, true},  {-44, -20, false}, {-44, 0, false}};

TestInput any(int rows, Domain domain, const Range& r, bool gradient = true) {
  return {rows, domain, gradient, r.low, r.high, /*unit=*/false, /*any_size=*/true};
}

struct Stressed {
  OperationCase operation;
  ScalarFunction f;
};

// Roundings: a product or two, and the sum over a ray's 64 samples.
std::vector<Stressed> operations(const Range& r) {
  static const LinearWeights table{0, 5, 4};
  const double largest = std::pow(10.0, r.high);
  return {
      {{"stress_multiply",
        {any(3, kSamples, r), any(3, kSamples, r)},
        {},
        [](Tape& t, const Values& v) { return Values{multiply(t, v[0], v[1])}; },
        4},
       []<class T>(const Given<T>& v) -> Outputs<T> { return {on_columns::multiply(v[0], v[1])}; }},
      {{"stress_square",
        {any(2, kSamples, r)},
        {},
        [](Tape& t, const Values& v) { return Values{multiply(t, v[0], v[0]), v[0]}; },
        4},
       []<class T>(const Given<T>& v) -> Outputs<T> {
         return {on_columns::multiply(v[0], v[0]), v[0]};
       }},
      {{"stress_add",
        {any(3, kSamples, r), any(3, kSamples, r)},
        {},
        [](Tape& t, const Values& v) { return Values{add(t, v[0], v[1]), v[0]}; },
        4},
       []<class T>(const Given<T>& v) -> Outputs<T> {
         return {on_columns::add(v[0], v[1]), v[0]};
       }},
      {{"stress_sum_along_rays",
        {any(1, kSamples, r), any(5, kSamples, r)},
        {},
        [](Tape& t, const Values& v) { return Values{sum_along_rays(t, v[0], v[1])}; },
        70},
       []<class T>(const Given<T>& v) -> Outputs<T> {
         return {on_columns::sum_along_rays(v[0], v[1], v.rays, 5)};
       }},
      {{"stress_over",
        {any(3, kRays, r), {1, kRays, true, 0, 1}, any(3, kRays, r, false)},
        {},
        [](Tape& t, const Values& v) { return Values{over(t, v[0], v[1], v[2])}; },
        10},
       []<class T>(const Given<T>& v) -> Outputs<T> {
         return {on_columns::over(v[0], v[1], v[2])};
       }},
      {{"stress_repeat",
        {any(3, kRays, r)},
        {},
        [](Tape& t, const Values& v) {
          const Value a = repeat_for_samples(t, v[0]);
          return Values{a, scale_shift(t, a, -3, 0.5_r)};
        },
        140},
       []<class T>(const Given<T>& v) -> Outputs<T> {
         const auto a = on_columns::repeat_for_samples(v[0], v.rays);
         return {a, on_columns::scale_shift(a, -3, 0.5)};
       }},
      {{"stress_table_rows",
        {{1, kSamples, false, -1, 4}},
        {table},
        [](Tape& t, const Values& v) { return Values{table_rows(t, v[0], table)}; },
        70,
        0,
        largest},
       []<class T>(const Given<T>& v) -> Outputs<T> {
         return {on_columns::table_rows(v[0], v.weights, table)};
       }},
  };
}

TEST(StressTape, OperationsOfEveryMagnitude) {
  for (const Range& r : kRanges) {
    SCOPED_TRACE("magnitudes from 1e" + std::to_string(r.low) + " to 1e" + std::to_string(r.high));
    const auto guard = r.flush ? std::make_unique<FlushDenormals>() : nullptr;
    for (const Stressed& s : operations(r)) {
      OperationCase operation = s.operation;
      operation.norms = false;
      check_operation(operation, s.f, kLayouts);
    }
  }
}

// sin(frequency x): the kernel's argument is exact and its result off by 4 roundings of 1, however
// many turns there are, where Magnitude would count the argument's error.
template <class T>
T sine(double frequency, T x) {
  if constexpr (std::is_same_v<T, Magnitude>) {
    return {std::sin(frequency * x.value), 1,
            frequency * std::cos(frequency * x.value) * x.derivative,
            frequency * x.derivative_size};
  } else {
    using std::sin;
    return sin(T(frequency) * x);
  }
}
template <class T>
T cosine(double frequency, T x) {
  if constexpr (std::is_same_v<T, Magnitude>) {
    return {std::cos(frequency * x.value), 1,
            -frequency * std::sin(frequency * x.value) * x.derivative,
            frequency * x.derivative_size};
  } else {
    using std::cos;
    return cos(T(frequency) * x);
  }
}

// Means with many turns or next to 0, variances that damp nothing or everything. Roundings as in
// encoding_test.cc, where an exponent's own are Magnitude's; sums of 24 gradients.
TEST(StressTape, IntegratedEncodingOfEveryMeanAndVariance) {
  constexpr int kDegrees = 12;
  for (const auto& [low, high] : {std::pair{-30.0, -5.0}, {-3.0, 1.0}, {4.0, 6.0}})
    for (const double spread : {0.0, 1e-30, 1e-6, 1.0, 1e3, 1e10, 1e30})
      check_operation(
          {"stress_integrated_encoding",
           {{3, kSamples, true, low, high, /*unit=*/false, /*any_size=*/true},
            {3, kSamples, true, 0, spread}},
           {},
           [](Tape& t, const Values& v) {
             return Values{integrated_encoding(t, v[0], v[1], kDegrees)};
           },
           40,
           /*shared=*/0,
           /*weight_range=*/1,
           /*norms=*/false},
          []<class T>(const Given<T>& v) -> Outputs<T> {
            Columns<T> out;
            for (size_t s = 0; s < v[0].size(); ++s) {
              out.emplace_back();
              for (const bool sines : {true, false})
                for (int k = 0; k < kDegrees; ++k)
                  for (size_t i = 0; i < 3; ++i) {
                    using std::exp;
                    const double f = std::ldexp(1.0, k);
                    const T damped = exp(T(-0.5 * f * f) * v[1][s][i]);
                    out.back().push_back(damped *
                                         (sines ? sine(f, v[0][s][i]) : cosine(f, v[0][s][i])));
                  }
            }
            return {out};
          },
          kFewSamples);
}

// A sigmoid that is below the normal numbers may be 0, or the smallest of them: off by kTiny.
template <class T>
T sigmoid_of(T x) {
  const T y = on_columns::sigmoid<T>({{x}})[0][0];
  if constexpr (std::is_same_v<T, Magnitude>) {
    return {y.value, y.size + kTiny / kRoundoff, y.derivative,
            y.derivative_size + std::fabs(x.derivative) * kTiny / kRoundoff};
  } else {
    return y;
  }
}

// f of every number and its derivative.
template <class F>
auto of_each(const F& f) {
  return [f](auto x, const auto&) {
    for (auto& column : x)
      for (auto& v : column) v = f(v);
    return x;
  };
}

// Tangents by the tape's own formulas, from the outputs of activations: where a sigmoid is next to
// 1, its slope is off by roundings of 1, and Magnitude says so.
TEST(StressTape, TangentsOfEveryMagnitude) {
  const auto check = [](const std::string& name, int rows, double high, double low_direction,
                        double high_direction, const auto& record, const auto& f,
                        double roundings) {
    SCOPED_TRACE("numbers up to 1e" + std::to_string(high));
    check_tangents("stress_tangent_" + name, {rows, kSamples, true, -30, high, false, true},
                   {rows, kSamples, true, low_direction, high_direction, false, true}, {}, record,
                   f, roundings, kFewSamples, /*norms=*/false);
  };
  for (const auto& [low, high] : {std::pair{-15.0, 15.0}, {-30.0, -10.0}}) {
    for (const double numbers : {1.0, 4.0}) {
      check(
          "exp", 2, numbers, low, high,
          [](Tape& t, const WithTangents& x) { return truncated_exp(t, x); },
          of_each([]<class T>(const TDual<T>& x) -> TDual<T> {
            const T y = reference::truncated_exp(x.value);
            return {y, y * x.derivative};
          }),
          20);
      check(
          "sigmoid", 2, numbers, low, high,
          [](Tape& t, const WithTangents& x) { return sigmoid(t, x); },
          of_each([]<class T>(const TDual<T>& x) -> TDual<T> {
            const T y = sigmoid_of(x.value);
            return {y, y * (T(1) - y) * x.derivative};
          }),
          30);
      check(
          "softplus", 2, numbers, low, high,
          [](Tape& t, const WithTangents& x) { return softplus(t, x, -1); },
          of_each([]<class T>(const TDual<T>& x) -> TDual<T> {
            const T at = x.value + T(-1.0);
            return {reference::softplus(at), sigmoid_of(at) * x.derivative};
          }),
          30);
    }
    check(
        "relu", 2, 15, low, high, [](Tape& t, const WithTangents& x) { return relu(t, x); },
        of_each([](const auto& x) { return reference::relu(x); }), 4);
    check(
        "product", 4, 15, low, high,
        [](Tape& t, const WithTangents& x) { return products_and_sums(t, x); },
        [](const auto& x, const auto&) { return products_and_sums_of(x); }, 20);
    for (const double numbers : {0.0, 5.0}) {
      static const std::vector<Real> weights(12, 1.0_r);
      check(
          "encoding", 2, numbers, low, high,
          [](Tape& t, const WithTangents& x) { return frequency_encoding(t, x, weights, true); },
          []<class D>(const Columns<D>& x, const std::vector<D>&) {
            Columns<D> out;
            for (const auto& c : x) {
              out.push_back(c);
              for (size_t k = 0; k < weights.size(); ++k) {
                const double f = std::ldexp(1.0, static_cast<int>(k));
                using T = decltype(c[0].value);
                for (const D& v : c)
                  out.back().push_back(
                      {sine(f, v.value), T(f) * cosine(f, v.value) * v.derivative});
                for (const D& v : c)
                  out.back().push_back(
                      {cosine(f, v.value), T(-f) * sine(f, v.value) * v.derivative});
              }
            }
            return out;
          },
          60);
    }
  }
}

}  // namespace
}  // namespace nerf::stress
