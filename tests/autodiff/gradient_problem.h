// What gradient_check.h compares: a tape with random inputs and weights, the scalar template of the
// same function on the same numbers, and a loss that depends on every output.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "autodiff/magnitude.h"
#include "kernels/kernel_test.h"
#include "math/complex_step.h"
#include "nerf/autodiff/operations.h"

namespace nerf {

template <class T>
using Columns = std::vector<std::vector<T>>;  // [sample or ray][row]
using Rays = std::vector<int32_t>;            // offsets of the rays' samples, one more than rays

// What a template starts from: a value for each input, the weights as the tape lays them out.
template <class T>
struct Given {
  std::vector<Columns<T>> values;
  std::vector<T> weights;
  const Rays& rays;
  const Columns<T>& operator[](size_t input) const { return values[input]; }
};
template <class T>
using Outputs = std::vector<Columns<T>>;

// A template, held by its three instances: []<class T>(const Given<T>& v) -> Outputs<T>.
struct ScalarFunction {
  template <class F>
  ScalarFunction(const F& f)
      : in_double(f), in_complex(f), in_magnitude(f) {}  // NOLINT: any such F
  std::function<Outputs<double>(const Given<double>&)> in_double;
  std::function<Outputs<Complex>(const Given<Complex>&)> in_complex;
  std::function<Outputs<Magnitude>(const Given<Magnitude>&)> in_magnitude;

  Outputs<double> operator()(const Given<double>& v) const { return in_double(v); }
  Outputs<Complex> operator()(const Given<Complex>& v) const { return in_complex(v); }
  Outputs<Magnitude> operator()(const Given<Magnitude>& v) const { return in_magnitude(v); }
};

// A value that the test fills with random numbers in [low, high], with unit vectors, or with any
// magnitudes, powers of ten in [low, high] of either sign, some of them 0.
struct TestInput {
  int rows;
  Domain domain;
  bool gradient;
  double low = -1, high = 1;
  bool unit = false;
  bool any_size = false;
};

struct TapeUnderTest {
  const Tape* tape;
  std::vector<TestInput> specs;
  std::vector<Value> inputs;          // one for each of specs
  std::vector<LinearWeights> layers;  // of the weights
  std::vector<Value> outputs;         // compared with the template; empty: it returns loss terms
  double roundings;                   // that a result goes through: the longest chain of them
  // Share of its tensor's largest size that any element may be off by: 1 where elements have a
  // factor of absolute precision, as the transmittance before a sample is, a product of 1 -
  // opacity.
  double shared = 0;
  double weight_range = 1;
  // Whether whole gradients are compared as vectors too. Not where numbers of any size cancel.
  bool norms = true;
};

// The random linear functional of some values that makes a loss of them.
class Probe : public Operation {
 public:
  Probe(std::vector<Value> values, Value out) : Operation(std::move(values), out) {}
  const char* name() const override { return "probe"; }
  static double coefficient(size_t value, int64_t row, int64_t column) {
    Random random(77, value, static_cast<uint64_t>(row * 4096 + column));
    return static_cast<double>(2 * random.uniform() - 1);
  }
  void forward(Chunk& c) const override {
    each(c, [&](size_t i, int row, int64_t column, size_t at) {
      c.loss += coefficient(i, row, column) * static_cast<double>(c.data(inputs()[i])[at]);
    });
  }
  void backward(Chunk& c) const override {
    for (size_t i = 0; i < inputs().size(); ++i) {
      if (!c.tape->needs_gradient(inputs()[i])) continue;
      ASSERT_TRUE(overwrites(i)) << "the probe is the last to read its values";
      for (int row = 0; row < c.tape->rows(inputs()[i]); ++row)
        std::fill_n(c.gradient(inputs()[i]) + row * c.stride(inputs()[i]),
                    round_up(c.count(inputs()[i]), kLane), 0.0_r);
    }
    each(c, [&](size_t i, int row, int64_t column, size_t at) {
      if (c.tape->needs_gradient(inputs()[i]))
        c.gradient(inputs()[i])[at] = static_cast<Real>(coefficient(i, row, column));
    });
  }

 private:
  template <class F>
  void each(const Chunk& c, const F& f) const {
    for (size_t i = 0; i < inputs().size(); ++i)
      for (int row = 0; row < c.tape->rows(inputs()[i]); ++row)
        for (int64_t column = 0; column < c.count(inputs()[i]); ++column)
          f(i, row, column, static_cast<size_t>(row * c.stride(inputs()[i]) + column));
  }
};

namespace gradient_check {

// Random numbers of one comparison, and the template's function of all of them in one list.
struct Problem {
  Problem(const TapeUnderTest& t, const Rays& r, uint64_t seed) : test(t), rays(r) {
    Random random(seed, rays.size(), static_cast<uint64_t>(rays.back()));
    for (const TestInput& in : test.specs) {
      const size_t columns =
          in.domain == Domain::kSamples ? static_cast<size_t>(rays.back()) : rays.size() - 1;
      values.emplace_back(columns, std::vector<double>(static_cast<size_t>(in.rows)));
      for (std::vector<double>& column : values.back()) {
        double square = 0;
        for (double& v : column) {
          v = in.any_size ? any_size(random, in.low, in.high) : uniform(random, in.low, in.high);
          square += v * v;
        }
        if (in.unit)
          for (double& v : column) v = static_cast<Real>(v / std::sqrt(square));
      }
    }
    size_t size = 0;
    for (const LinearWeights& w : test.layers) size = std::max(size, w.offset + w.size());
    weights.resize(size);
    for (const LinearWeights& w : test.layers)
      for (const size_t at : places(w))
        weights[at] = uniform(random, -test.weight_range, test.weight_range);
  }

  static size_t index(const LinearWeights& w, int row, int column) {
    return w.offset + static_cast<size_t>(row * weight_stride(w.in) + column);
  }

  // Of every weight of a layer, row by row, then of its biases.
  static std::vector<size_t> places(const LinearWeights& w) {
    std::vector<size_t> out;
    for (int j = 0; j < w.out; ++j)
      for (int k = 0; k < w.in; ++k) out.push_back(index(w, j, k));
    for (int j = 0; w.bias && j < w.out; ++j)
      out.push_back(w.bias_offset() + static_cast<size_t>(j));
    return out;
  }

  // The template's outputs; `disturb` may change what it is given first.
  template <class T, class Disturb>
  Outputs<T> evaluate(const ScalarFunction& f, const Disturb& disturb) const {
    Given<T> given{{}, {weights.begin(), weights.end()}, rays};
    for (const Columns<double>& value : values) {
      given.values.emplace_back();
      for (const std::vector<double>& column : value)
        given.values.back().emplace_back(column.begin(), column.end());
    }
    disturb(given);
    return f(given);
  }

  template <class T>
  T loss(const Outputs<T>& outputs) const {
    T sum(0);
    for (size_t i = 0; i < outputs.size(); ++i)
      for (size_t s = 0; s < outputs[i].size(); ++s)
        for (size_t r = 0; r < outputs[i][s].size(); ++r)
          sum += outputs[i][s][r] *
                 T(test.outputs.empty()
                       ? 1.0
                       : Probe::coefficient(i, static_cast<int64_t>(r), static_cast<int64_t>(s)));
    return sum;
  }

  static double elements(const Outputs<double>& outputs) {
    size_t count = 0;
    for (const Columns<double>& output : outputs)
      for (const std::vector<double>& column : output) count += column.size();
    return static_cast<double>(count);
  }

  const TapeUnderTest& test;
  const Rays& rays;
  std::vector<Columns<double>> values;
  std::vector<double> weights;
};

// What one element's gradient is, and its size without cancellation.
struct Expected {
  double gradient, size;
};

// `pick(given)` is a reference to the element.
template <class Pick>
Expected expected_gradient(const Problem& p, const ScalarFunction& f, const Pick& pick) {
  const auto step = [&](auto& given) { pick(given) += Complex(0, kComplexStep); };
  const auto mark = [&](auto& given) { pick(given).derivative = pick(given).derivative_size = 1; };
  return {p.loss(p.evaluate<Complex>(f, step)).imag() / kComplexStep,
          p.loss(p.evaluate<Magnitude>(f, mark)).derivative_size};
}

// Gradients of each input that has one, column by column, and of each layer, row by row.
inline std::vector<std::vector<Expected>> expected_gradients(const Problem& p,
                                                             const ScalarFunction& f) {
  std::vector<std::vector<Expected>> out;
  for (size_t i = 0; i < p.test.specs.size(); ++i) {
    if (!p.test.specs[i].gradient) continue;
    out.emplace_back();
    for (size_t s = 0; s < p.values[i].size(); ++s)
      for (size_t r = 0; r < p.values[i][s].size(); ++r)
        out.back().push_back(
            expected_gradient(p, f, [&](auto& given) -> auto& { return given.values[i][s][r]; }));
  }
  for (const LinearWeights& w : p.test.layers) {
    out.emplace_back();
    for (const size_t at : Problem::places(w))
      out.back().push_back(
          expected_gradient(p, f, [&](auto& given) -> auto& { return given.weights[at]; }));
  }
  return out;
}

// A chunk of noise with the problem's inputs in place.
struct Run {
  // What stands in the weights' gradients before: backward adds to them.
  static constexpr Real kBefore = 0x1p-10_r;

  explicit Run(const Problem& p)
      : problem(p),
        chunk(*p.test.tape),
        weights(p.weights.size()),
        weight_gradient(p.weights.size()) {
    Random random(5, 5, 5);
    for (Real& v : chunk.arena) v = uniform(random, -20, 20);
    for (size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<Real>(p.weights[i]);
    for (const LinearWeights& w : p.test.layers)
      for (const size_t at : Problem::places(w)) weight_gradient[at] = kBefore;
    chunk.weights = weights.data();
    chunk.weight_gradient = weight_gradient.data();
    chunk.rays = static_cast<int>(p.rays.size()) - 1;
    chunk.samples = p.rays.back();
    chunk.ray_begin = p.rays.data();
    for (size_t i = 0; i < p.values.size(); ++i)
      for (size_t s = 0; s < p.values[i].size(); ++s)
        for (size_t r = 0; r < p.values[i][s].size(); ++r)
          chunk.data(p.test.inputs[i])[at(p.test.inputs[i], r, s)] =
              static_cast<Real>(p.values[i][s][r]);
  }

  size_t at(Value v, size_t row, size_t column) const {
    return row * static_cast<size_t>(chunk.stride(v)) + column;
  }

  // In the order of expected_gradients(). Padding must be 0.
  std::vector<std::vector<double>> gradients() {
    std::vector<std::vector<double>> out;
    for (size_t i = 0; i < problem.test.specs.size(); ++i) {
      const TestInput& spec = problem.test.specs[i];
      if (!spec.gradient) continue;
      const Value v = problem.test.inputs[i];
      const size_t used = static_cast<size_t>(chunk.count(v)),
                   rows = static_cast<size_t>(spec.rows);
      out.emplace_back();
      int stained = 0;
      for (size_t s = 0; s < static_cast<size_t>(round_up(chunk.count(v), kLane)); ++s)
        for (size_t r = 0; r < rows; ++r) {
          const Real g = chunk.gradient(v)[at(v, r, s)];
          if (s < used)
            out.back().push_back(g);
          else
            stained += g != 0;
        }
      EXPECT_EQ(stained, 0) << "padding of the gradient of input " << i;
    }
    for (const LinearWeights& w : problem.test.layers) {
      out.emplace_back();
      AlignedArray<Real> rest = weight_gradient;  // what is no weight
      for (const size_t at : Problem::places(w)) {
        out.back().push_back(static_cast<double>(weight_gradient[at]) -
                             static_cast<double>(kBefore));
        rest[at] = 0;
      }
      const auto begin = rest.begin() + static_cast<ptrdiff_t>(w.offset);
      const auto stained = std::count_if(begin, begin + static_cast<ptrdiff_t>(w.size()),
                                         [](Real g) { return g != 0; });
      EXPECT_EQ(stained, 0) << "padding of the weights at " << w.offset;
    }
    return out;
  }

  const Problem& problem;
  Chunk chunk;
  AlignedArray<Real> weights, weight_gradient;
};

}  // namespace gradient_check
}  // namespace nerf
