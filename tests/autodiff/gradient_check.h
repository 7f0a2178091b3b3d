// The one test of every differentiable operation: what a tape computes, and the gradients that its
// backward pass leaves, against a scalar template of the same function, whose gradient is found by
// complex step. Tolerances come from the template too (magnitude.h).
//
// The template returns the values in `outputs`, or the terms of the loss where the tape ends in
// one. Every memory of the chunk starts as noise, so that reading padding, or gradients that nobody
// has written, shows.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "autodiff/gradient_problem.h"
#include "math/worst_error.h"

namespace nerf {

using enum Domain;
using Values = std::vector<Value>;

// Rays of several lengths, empty ones among them; none at all; the whole of kSampleCapacity.
inline constexpr int kSampleCapacity = 64, kRayCapacity = 16;
inline std::vector<Rays> ray_layouts() {
  return {{0}, {0, 0}, {0, 1}, {0, 0, 15, 15, 16}, {0, 1, 17, 17, 20, 37, 37}, {0, 64}};
}

// Numbers below the smallest normal one may have lost digits, or be 0, at any stage.
inline constexpr double kUnderflow = 1e-36;
// The bound of a single element is a worst case, and a loose one behind many layers. The gradient
// of a whole tensor, as a vector, has the relative error that roundings of random signs leave.
inline constexpr double kNormError = 2e-6 * (kRoundoff / kFloatRoundoff);

// A norm's bound is at most this share of the norm.
inline constexpr double kMostAllowed = 0.05;

namespace gradient_check {

// The gradient of input or layer `i`, element by element, and as a vector where it is long enough
// for cancellation and roundings to average out.
inline void compare_gradient(const TapeUnderTest& test, size_t i, bool is_layer,
                             const std::vector<double>& got, const std::vector<Expected>& truth,
                             WorstError& element, WorstError& norm) {
  ASSERT_EQ(got.size(), truth.size());
  const double before = is_layer ? static_cast<double>(Run::kBefore) : 0;
  double largest = 0, squares = 0, size_squares = 0, squared_errors = 0;
  for (const Expected& want : truth) largest = std::max(largest, want.size);
  for (size_t k = 0; k < truth.size(); ++k) {
    const Expected& want = truth[k];
    element.compare(
        got[k], want.gradient,
        test.roundings * kRoundoff * (want.size + test.shared * largest + before) + kUnderflow,
        is_layer ? "layer" : "input", "tensor", i, "element", k);
    squares += want.gradient * want.gradient;
    size_squares += want.size * want.size;
    squared_errors += std::pow(got[k] - want.gradient, 2);
  }
  if (truth.size() < 16 || !test.norms) return;
  const double rounding = std::sqrt(static_cast<double>(truth.size())) * kRoundoff * before;
  // Behind compositing the terms of a gradient cancel (light is only moved between samples):
  // roundings of random signs leave the root of their number times the terms' size.
  const double cancelled =
      test.shared > 0 ? std::sqrt(test.roundings * size_squares) * kRoundoff : 0;
  const double allowed =
      std::max(kNormError * std::sqrt(squares), cancelled) + rounding + kUnderflow;
  norm.compare(std::sqrt(squared_errors), 0, allowed, "tensor", i);
  // A bound that a gradient of another sign or size would meet says nothing. Of gradients that
  // floats cannot hold nothing else can be said.
  if (kMostAllowed * std::sqrt(squares) > kUnderflow) {
    EXPECT_LT(allowed, kMostAllowed * std::sqrt(squares)) << "tensor " << i;
  }
}

}  // namespace gradient_check

inline void check_gradients(const std::string& name, const TapeUnderTest& test,
                            const ScalarFunction& f, const std::vector<Rays>& layouts) {
  using namespace gradient_check;
  SCOPED_TRACE(name);
  WorstError forward(name + "_forward"), backward(name + "_backward"), norm(name + "_norm");
  const auto nothing = [](auto&) {};
  const double unit = test.roundings * kRoundoff;
  for (const Rays& rays : layouts) {
    const Problem problem(test, rays, 1 + rays.size());
    SCOPED_TRACE("samples " + std::to_string(rays.back()) + " rays " +
                 std::to_string(rays.size() - 1));
    const auto outputs = problem.evaluate<double>(f, nothing);
    const auto sizes = problem.evaluate<Magnitude>(f, nothing);
    const auto truth = expected_gradients(problem, f);

    for_each_target([&](const std::string&) {
      Run run(problem);
      test.tape->forward(run.chunk);
      for (size_t i = 0; i < test.outputs.size(); ++i)
        for (size_t s = 0; s < outputs[i].size(); ++s)
          for (size_t r = 0; r < outputs[i][s].size(); ++r)
            forward.compare(run.chunk.data(test.outputs[i])[run.at(test.outputs[i], r, s)],
                            outputs[i][s][r], unit * sizes[i][s][r].size + kUnderflow, "output", i,
                            "row", r, "column", s);
      forward.compare(run.chunk.loss, problem.loss(outputs),
                      unit * problem.loss(sizes).size + kUnderflow * problem.elements(outputs),
                      "loss");

      test.tape->backward(run.chunk);
      const auto got = run.gradients();
      ASSERT_EQ(got.size(), truth.size());
      for (size_t i = 0; i < truth.size(); ++i)
        compare_gradient(test, i, i + test.layers.size() >= truth.size(), got[i], truth[i],
                         backward, norm);
    });
  }
  forward.report();
  backward.report();
  if (norm.count() > 0) norm.report();
}

// An operation by itself: `record` writes it on a tape and returns what the loss is made of, or
// nothing where it recorded a loss.
struct OperationCase {
  std::string name;
  std::vector<TestInput> inputs;
  std::vector<LinearWeights> layers;
  std::function<std::vector<Value>(Tape&, const std::vector<Value>&)> record;
  double roundings;
  double shared = 0;
  double weight_range = 1;
  bool norms = true;
};

inline void check_operation(const OperationCase& c, const ScalarFunction& f,
                            const std::vector<Rays>& layouts = ray_layouts()) {
  Tape tape(kSampleCapacity, kRayCapacity);
  TapeUnderTest test{&tape,    c.inputs,       {},     c.layers, {}, c.roundings,
                     c.shared, c.weight_range, c.norms};
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
