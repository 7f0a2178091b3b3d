// Losses on warps: against templates (gradient_check.h) and against numbers from characteristic
// polynomials (golden/warp_losses.py).

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "autodiff/elastic_reference.h"
#include "autodiff/reference_ops.h"
#include "golden/golden.h"
#include "nerf/autodiff/operations.h"

namespace nerf {
namespace {

using Doubles = std::vector<double>;

// Sum over a ray's samples of f(sample), times the ray's scale.
template <class T, class F>
Outputs<T> terms_of_rays(const Columns<T>& scale, const Rays& rays, const F& f) {
  Columns<T> terms;
  for (size_t r = 0; r + 1 < rays.size(); ++r) {
    T sum(0);
    for (size_t s = static_cast<size_t>(rays[r]); s < static_cast<size_t>(rays[r + 1]); ++s)
      sum += f(s);
    terms.push_back({sum * scale[r][0]});
  }
  return {terms};
}

// Jacobians that stretch by a factor up to 3, and turn.
TEST(Gradient, ElasticLoss) {
  for (const double penalty : {0.03, 0.5}) {
    std::vector<TestInput> inputs;
    for (int k = 0; k < 9; ++k)
      inputs.push_back(k % 4 == 0 ? TestInput{1, kSamples, true, 0.5, 3}
                                  : TestInput{1, kSamples, true, -0.2, 0.2});
    inputs.push_back({1, kSamples, false, 0, 1});
    inputs.push_back({1, kRays, false, 0, 1});
    check_operation({"elastic_loss",
                     inputs,
                     {},
                     [=](Tape& t, const Values& v) {
                       const auto column = [&](size_t i) {
                         return concat(t, v[i], concat(t, v[i + 1], v[i + 2]));
                       };
                       elastic_loss(t, {column(0), column(3), column(6)}, v[9], v[10],
                                    static_cast<Real>(penalty));
                       return Values{};
                     },
                     8},
                    [=]<class T>(const Given<T>& v) -> Outputs<T> {
                      return terms_of_rays(v[10], v.rays, [&](size_t s) {
                        std::vector<T> numbers;
                        for (size_t k = 0; k < 9; ++k) numbers.push_back(v[k][s][0]);
                        return v[9][s][0] * elastic_of(numbers, penalty);
                      });
                    },
                    {{0}, {0, 1, 3, 3, 6}});
  }
}

TEST(Gradient, StillLoss) {
  for (const double penalty : {0.001, 0.5})
    for (int needs = 1; needs < 4; ++needs)  // which of both points
      check_operation({"still_loss",
                       {{3, kSamples, (needs & 1) != 0},
                        {3, kSamples, (needs & 2) != 0},
                        {1, kRays, false, 0, 1}},
                       {},
                       [=](Tape& t, const Values& v) {
                         still_loss(t, v[0], v[1], v[2], static_cast<Real>(penalty));
                         return Values{};
                       },
                       12},
                      [=]<class T>(const Given<T>& v) -> Outputs<T> {
                        return terms_of_rays(v[2], v.rays, [&](size_t s) {
                          T square(0);
                          for (size_t k = 0; k < 3; ++k) {
                            const T apart = v[0][s][k] - v[1][s][k];
                            square += apart * apart;
                          }
                          return reference::geman_mcclure(square, penalty);
                        });
                      });
}

// Equal singular values, none of them, a mirror, and what is as good as flat: there the loss is the
// constant that the least singular value gives.
TEST(ElasticLoss, IsThatOfTheSingularValues) {
  for (const Doubles& line : golden_lines("warp_losses.txt", "elastic")) {
    Tape tape(kLane, kLane);
    const Value weight = tape.input(1, kSamples), scale = tape.input(1, kRays);
    std::array<Value, 3> columns;
    for (Value& v : columns) v = tape.input(3, kSamples, true);
    elastic_loss(tape, columns, weight, scale, static_cast<Real>(line[0]));
    tape.plan();
    Chunk c(tape);
    c.samples = c.rays = 1;
    const int32_t ray_begin[] = {0, 1};
    c.ray_begin = ray_begin;
    c.data(weight)[0] = c.data(scale)[0] = 1;
    const auto at = [&](size_t k) {
      const Value v = columns[k / 3];
      return static_cast<int64_t>(k % 3) * c.stride(v);
    };
    for (size_t k = 0; k < 9; ++k) c.data(columns[k / 3])[at(k)] = static_cast<Real>(line[1 + k]);
    tape.forward(c);
    tape.backward(c);
    double largest = line[0];
    for (size_t k = 10; k < 20; ++k) largest = std::max(largest, std::fabs(line[k]));
    EXPECT_NEAR(c.loss, line[10], 4 * kRoundoff * largest) << line[1] << " " << line[9];
    for (size_t k = 0; k < 9; ++k)
      EXPECT_NEAR(c.gradient(columns[k / 3])[at(k)], line[11 + k], 4 * kRoundoff * largest)
          << "entry " << k << " of " << line[1] << " " << line[9];
  }
}

}  // namespace
}  // namespace nerf
