// The one test of every differentiable operation: what a tape computes, and the gradients that its
// backward pass leaves, against a scalar template of the same function, whose gradient is found by
// complex step. Tolerances come from the template too (magnitude.h).
//
// The template is a generic callable
//   []<class T>(const Given<T>& v) -> Outputs<T>
// that returns the values in `outputs`, or the terms of the loss where the tape ends in one.
// Every memory of the chunk starts as noise, so that reading padding, or gradients that nobody has
// written, shows.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "autodiff/magnitude.h"
#include "kernels/kernel_test.h"
#include "math/complex_step.h"
#include "math/worst_error.h"
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

// A value that the test fills with random numbers in [low, high], or with unit vectors.
struct TestInput {
  int rows;
  Domain domain;
  bool gradient;
  double low = -1, high = 1;
  bool unit = false;
};

struct TapeUnderTest {
  const Tape* tape;
  std::vector<TestInput> specs;
  std::vector<Value> inputs;            // one for each of specs
  std::vector<LinearWeights> layers;    // of the weights
  std::vector<Value> outputs;           // compared with the template; empty: it returns loss terms
  double roundings;                     // that a result goes through: the longest chain of them
  double weight_range = 1;
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
                    round_up(c.count(inputs()[i]), kLane), 0.0f);
    }
    each(c, [&](size_t i, int row, int64_t column, size_t at) {
      if (c.tape->needs_gradient(inputs()[i]))
        c.gradient(inputs()[i])[at] = static_cast<float>(coefficient(i, row, column));
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
          v = uniform(random, in.low, in.high);
          square += v * v;
        }
        if (in.unit)
          for (double& v : column) v = static_cast<float>(v / std::sqrt(square));
      }
    }
    size_t size = 0;
    for (const LinearWeights& w : test.layers) size = std::max(size, w.offset + w.size());
    weights.resize(size);
    for (const LinearWeights& w : test.layers)
      for (int j = 0; j < w.out; ++j)
        for (int k = 0; k < w.in; ++k)
          weights[index(w, j, k)] = uniform(random, -test.weight_range, test.weight_range);
  }

  static size_t index(const LinearWeights& w, int row, int column) {
    return w.offset + static_cast<size_t>(row * weight_stride(w.in) + column);
  }

  // The template's outputs; `disturb` may change what it is given first.
  template <class T, class Function, class Disturb>
  Outputs<T> evaluate(const Function& f, const Disturb& disturb) const {
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
template <class Function, class Pick>
Expected expected_gradient(const Problem& p, const Function& f, const Pick& pick) {
  const auto step = [&](auto& given) { pick(given) += Complex(0, kComplexStep); };
  const auto mark = [&](auto& given) { pick(given).slope = 1; };
  return {p.loss(p.evaluate<Complex>(f, step)).imag() / kComplexStep,
          p.loss(p.evaluate<Magnitude>(f, mark)).slope};
}

// A chunk of noise with the problem's inputs in place.
struct Run {
  explicit Run(const Problem& p) : chunk(*p.test.tape), weights(p.weights.size()), gradient(p.weights.size()) {
    Random random(5, 5, 5);
    for (float& v : chunk.arena) v = uniform(random, -20, 20);
    for (size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<float>(p.weights[i]);
    chunk.weights = weights.data();
    chunk.weight_gradient = gradient.data();
    chunk.rays = static_cast<int>(p.rays.size()) - 1;
    chunk.samples = p.rays.back();
    chunk.ray_begin = p.rays.data();
    for (size_t i = 0; i < p.values.size(); ++i)
      for (size_t s = 0; s < p.values[i].size(); ++s)
        for (size_t r = 0; r < p.values[i][s].size(); ++r)
          chunk.data(p.test.inputs[i])[at(p.test.inputs[i], r, s)] = static_cast<float>(p.values[i][s][r]);
  }
  size_t at(Value v, size_t row, size_t column) const {
    return row * static_cast<size_t>(chunk.stride(v)) + column;
  }
  Chunk chunk;
  AlignedArray<float> weights, gradient;
};

}  // namespace gradient_check

// Rays of several lengths, empty ones among them; none at all; the whole of kSampleCapacity.
inline constexpr int kSampleCapacity = 64, kRayCapacity = 16;
inline std::vector<Rays> ray_layouts() {
  return {{0}, {0, 0}, {0, 1}, {0, 0, 15, 15, 16}, {0, 1, 17, 17, 20, 37, 37}, {0, 64}};
}

// Numbers below the smallest normal one may have lost digits, or be 0, at any stage.
inline constexpr double kUnderflow = 1e-36;
// Besides the bound of every single element, which is a worst case: all gradients of a case together
// have the relative error that roundings of random signs leave.
inline constexpr double kNormError = 1e-6;

template <class Function>
void check_gradients(const std::string& name, const TapeUnderTest& test, const Function& f,
                     const std::vector<Rays>& layouts) {
  using namespace gradient_check;
  SCOPED_TRACE(name);
  WorstError forward(name + "_forward"), backward(name + "_backward"),
      norm(name + "_norm");
  const auto nothing = [](auto&) {};
  for (const Rays& rays : layouts) {
    const Problem problem(test, rays, 1 + rays.size());
    SCOPED_TRACE("samples " + std::to_string(rays.back()) + " rays " + std::to_string(rays.size() - 1));
    const auto outputs = problem.evaluate<double>(f, nothing);
    const auto sizes = problem.evaluate<Magnitude>(f, nothing);
    const double unit = test.roundings * kRoundoff;

    // Gradients by complex step, once for all targets: of inputs, then of weights.
    std::vector<Expected> truth;
    for (size_t i = 0; i < test.specs.size(); ++i)
      for (size_t s = 0; test.specs[i].gradient && s < problem.values[i].size(); ++s)
        for (size_t r = 0; r < problem.values[i][s].size(); ++r)
          truth.push_back(expected_gradient(
              problem, f, [&](auto& given) -> auto& { return given.values[i][s][r]; }));
    for (const LinearWeights& w : test.layers)
      for (int j = 0; j < w.out; ++j)
        for (int k = 0; k < w.in; ++k)
          truth.push_back(expected_gradient(problem, f, [&](auto& given) -> auto& {
            return given.weights[Problem::index(w, j, k)];
          }));

    for_each_target([&](const std::string&) {
      Run run(problem);
      // Backward adds to the weights' gradients.
      constexpr float kBefore = 0.25f;
      for (const LinearWeights& w : test.layers)
        for (int j = 0; j < w.out; ++j)
          for (int k = 0; k < w.in; ++k) run.gradient[Problem::index(w, j, k)] = kBefore;
      test.tape->forward(run.chunk);
      for (size_t i = 0; i < test.outputs.size(); ++i)
        for (size_t s = 0; s < outputs[i].size(); ++s)
          for (size_t r = 0; r < outputs[i][s].size(); ++r)
            forward.compare(run.chunk.data(test.outputs[i])[run.at(test.outputs[i], r, s)],
                            outputs[i][s][r], unit * sizes[i][s][r].size + kUnderflow, "output", i, "row", r,
                            "column", s);
      forward.compare(run.chunk.loss, problem.loss(outputs), unit * problem.loss(sizes).size, "loss");

      test.tape->backward(run.chunk);
      size_t next = 0;
      double squared_error = 0, squared = 0;
      const auto check = [&](double got, double before, const auto&... where) {
        const Expected& want = truth[next++];
        backward.compare(got, want.gradient, unit * (want.size + before) + kUnderflow, where...);
        squared_error += (got - want.gradient) * (got - want.gradient);
        squared += want.gradient * want.gradient;
      };
      for (size_t i = 0; i < test.specs.size(); ++i) {
        if (!test.specs[i].gradient) continue;
        const float* got = run.chunk.gradient(test.inputs[i]);
        const int64_t test_columns = static_cast<int64_t>(problem.values[i].size());
        for (size_t s = 0; s < problem.values[i].size(); ++s)
          for (size_t r = 0; r < problem.values[i][s].size(); ++r)
            check(got[run.at(test.inputs[i], r, s)], 0, "input", i, "row", r, "column", s);
        for (int64_t s = test_columns; s < round_up(test_columns, kLane); ++s)
          for (int r = 0; r < test.specs[i].rows; ++r)
            backward.compare(got[run.at(test.inputs[i], static_cast<size_t>(r), static_cast<size_t>(s))],
                             0, 0, "padding of input", i, "row", r, "column", s);
      }
      for (const LinearWeights& w : test.layers)
        for (int j = 0; j < w.out; ++j)
          for (int k = 0; k < weight_stride(w.in); ++k) {
            const float got = run.gradient[Problem::index(w, j, k)];
            if (k >= w.in)
              backward.compare(got, 0, 0, "padding of weights at", w.offset, "row", j, "column", k);
            else
              check(got - static_cast<double>(kBefore), static_cast<double>(kBefore), "weights at", w.offset,
                    "row", j, "column", k);
          }
      ASSERT_EQ(next, truth.size());
      norm.compare(std::sqrt(squared_error), 0, kNormError * std::sqrt(squared), "all gradients");
    });
  }
  forward.report();
  backward.report();
  norm.report();
}

// An operation by itself: `record` writes it on a tape and returns what the loss is made of, or
// nothing where it recorded a loss.
struct OperationCase {
  std::string name;
  std::vector<TestInput> inputs;
  std::vector<LinearWeights> layers;
  std::function<std::vector<Value>(Tape&, const std::vector<Value>&)> record;
  double roundings;
};

template <class Function>
void check_operation(const OperationCase& c, const Function& f,
                     const std::vector<Rays>& layouts = ray_layouts()) {
  Tape tape(kSampleCapacity, kRayCapacity);
  TapeUnderTest test{&tape, c.inputs, {}, c.layers, {}, c.roundings};
  for (const TestInput& in : c.inputs)
    test.inputs.push_back(tape.input(in.rows, in.domain, in.gradient));
  test.outputs = c.record(tape, test.inputs);
  if (!test.outputs.empty()) {
    const Value out = tape.output(1, Domain::kRays, test.outputs);
    tape.record(std::make_unique<Probe>(test.outputs, out));
  }
  tape.plan();
  check_gradients(c.name, test, f, layouts);
}

}  // namespace nerf
