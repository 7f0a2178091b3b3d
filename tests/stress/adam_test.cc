// Adam on gradients from nothing to the largest float, with rates from nothing to absurd, and with
// counters that stand at their limit.
#include "nerf/kernels/adam.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <vector>

#include "kernels/exact_adam.h"
#include "kernels/kernel_test.h"
#include "kernels/row_states.h"
#include "nerf/base/threads.h"

namespace nerf::stress {
namespace {

constexpr double kTiny = std::numeric_limits<Real>::min();
constexpr Real kMax = std::numeric_limits<Real>::max();
constexpr Real kGradients[] = {0.0_r,    -0.0_r,  1e-45_r, -1e-40_r, 1e-38_r, 1e-30_r,
                               -1e-20_r, 1e-18_r, 1e-15_r, -1e-8_r,  1.0_r,   -1e5_r,
                               1e15_r,   9e17_r,  1e18_r,  -2e18_r,  1e20_r,  -1e30_r,
                               1e38_r,   -kMax,   kMax,    1e-12_r,  0.3_r,   -7.0_r};
constexpr size_t kCount = std::size(kGradients) + 8;  // a multiple of kLane; the last stay 0
static_assert(kCount % kLane == 0);

double counted(Real gradient) { return reference::counted_gradient<double>(gradient); }

struct State {
  explicit State(size_t n, Real weight = 0) : gradient(n), m(n), v(n), w(n) {
    for (Real& x : w) x = weight;
  }
  AlignedArray<Real> gradient, m, v, w;
};

// One step of all by one of the kernels: dense, or rows of so many features with counters that
// stand at step - 1.
void step_all(int features, const AdamStep& options, int64_t step, State& s) {
  const size_t n = s.w.size();
  if (features == 0) {
    adam_dense(options, step, static_cast<int64_t>(n), s.gradient.data(), s.m.data(), s.v.data(),
               s.w.data());
    return;
  }
  std::vector<Real> correction(2 * kBiasCorrections);
  bias_corrections(options, correction.data());
  const size_t rows = n / static_cast<size_t>(features);
  std::vector<Real> steps(rows, static_cast<Real>(std::min<int64_t>(step - 1, 65535)));
  RowStates states(rows, features);
  states.set(s.gradient, s.m, s.v, steps);
  std::ranges::fill(states.marks, uint8_t{1});
  states.take_marked();
  adam_rows(options, features, states.list(), states.count(), states.gradient.data(), states.data(),
            s.w.data(), correction.data());
  states.take(s.gradient, s.m, s.v, steps);
  for (Real t : steps) ASSERT_EQ(t, static_cast<Real>(std::min<int64_t>(step, 65535)));
}

// The bounds of exact_adam.h, with what vanishes below the smallest normal number: up to three
// results of either moment, and a gradient, whose square counts as that much less. An error of v
// moves the root between those of v - error and v + error.
struct Bounds {
  Bounds(const AdamStep& o, int64_t step, double g, const ExactStep& want) {
    m = want.m_error + 4 * kTiny;
    v = want.v_error + (4 + 2 * std::fabs(g)) * kTiny;
    const double t = static_cast<double>(step);
    const double c1 = o.rate / (1 - std::pow(double{o.beta1}, t));
    const double c2 = 1 / (1 - std::pow(double{o.beta2}, t));
    const auto root = [&](double at) { return std::sqrt(std::max(at, 0.0) * c2) + o.epsilon; };
    const double low = root(want.v - v), high = root(want.v + v);
    const double move = c1 * std::fabs(want.m) / low;
    // c1 (twice where it is a product), c2, the root, the sum and the quotient; the weight itself.
    w = c1 / low * m + c1 * std::fabs(want.m) * (1 / low - 1 / high) + 6 * kRoundoff * move +
        kRoundoff * (std::fabs(want.w) + move) + 2 * kTiny;
  }
  double m, v, w;
};

TEST(StressAdam, OneStepOfEveryMagnitude) {
  WorstError m("m"), v("v"), weight("weight");
  for_each_target([&](const std::string&) {
    for (int features : {0, 2, 4})
      for (bool flush : {false, true})
        for (Real rate : {1e-30_r, 1e-7_r, 0.01_r, 1.0_r, 1e30_r})
          for (Real at : {0.0_r, 1e-40_r, -0.7_r, 1e12_r})
            for (int64_t step : {1, 2, 100, 4095, 4096, 65535, 65536, 1000000000}) {
              const AdamStep options{.rate = rate};
              State s(kCount, at);
              // Moments of an ordinary past, in half of the cases.
              for (size_t i = 0; i < kCount && step % 2 == 0; ++i) {
                s.m[i] = i % 3 ? 0.01_r : -2.0_r;
                s.v[i] = i % 3 ? 0.01_r : 4.0_r;
              }
              std::copy(std::begin(kGradients), std::end(kGradients), s.gradient.begin());
              const State before = s;
              {
                const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
                step_all(features, options, step, s);
              }
              for (size_t i = 0; i < kCount; ++i) {
                const double g = counted(before.gradient[i]);
                const int64_t t = features > 0 ? std::min<int64_t>(step, 65535) : step;
                const ExactStep want(options, t, g, before.m[i], before.v[i], before.w[i]);
                const Bounds bounds(options, t, g, want);
                ASSERT_TRUE(std::isfinite(s.w[i]) && std::isfinite(s.v[i])) << "gradient " << g;
                m.compare(s.m[i], want.m, bounds.m, "gradient", g, "step", step);
                v.compare(s.v[i], want.v, bounds.v, "gradient", g, "step", step);
                weight.compare(s.w[i], want.w, bounds.w, "gradient", g, "step", step, "rate", rate,
                               "weight", at, "features", features, "flush", flush);
              }
            }
  });
  m.report();
  v.report();
  weight.report();
}

// Whatever comes, no step is longer than rate (1 - b1) / sqrt((1 - b2) (1 - b1^2 / b2)), by the
// inequality of Cauchy and Schwarz between the two moments, and every number stays finite.
TEST(StressAdam, StepsAreBoundedWhateverComes) {
  const AdamStep options{.rate = 0.5_r};
  const double b1 = options.beta1, b2 = options.beta2;
  const double most = options.rate * (1 - b1) / std::sqrt((1 - b2) * (1 - b1 * b1 / b2));
  for_each_target([&](const std::string&) {
    for (int features : {0, 2, 4}) {
      State s(256);
      for (int64_t step = 1; step <= 400; ++step) {
        for (size_t i = 0; i < s.w.size(); ++i) {
          Random random(41, static_cast<uint64_t>(step), i);
          const size_t kind = i % 4;
          // Any magnitude after any other; jumps between two; a spike in an ordinary row; then
          // none.
          s.gradient[i] = kind == 0   ? kGradients[random.below(std::size(kGradients))]
                          : kind == 1 ? (step % 2 ? kMax : 1e-30_r)
                          : kind == 2 ? (step == 50 ? -1e30_r : random.uniform() - 0.5_r)
                                      : (step < 10 ? 1e30_r : 0.0_r);
        }
        const State before = s;
        step_all(features, options, step, s);
        for (size_t i = 0; i < s.w.size(); ++i) {
          ASSERT_TRUE(std::isfinite(s.w[i]) && std::isfinite(s.m[i]) && std::isfinite(s.v[i]))
              << "step " << step << " element " << i;
          ASSERT_LE(std::fabs(s.w[i] - before.w[i]),
                    most * (1 + 1e-4) + 2 * kRoundoff * std::fabs(s.w[i]))
              << "step " << step << " element " << i;
        }
      }
    }
  });
}

// The same gradient every time moves a weight by the rate, whatever the gradient's size: the errors
// of the moments, up to 3 u a step, fade with 1 - b1 and 1 - b2, and the root takes half of v's.
TEST(StressAdam, ConstantGradientsMoveByTheRate) {
  WorstError worst("move");
  const AdamStep options{.rate = 1e-3_r};
  for_each_target([&](const std::string&) {
    for (int features : {0, 2, 4})
      for (Real g : {1e-12_r, -1e-6_r, 1.0_r, 1e10_r, -1e18_r, 1e20_r, 1e38_r}) {
        State s(32);
        for (int64_t step = 1; step <= 200; ++step) {
          for (Real& x : s.gradient) x = g;
          const Real before = s.w[5];
          step_all(features, options, step, s);
          const double u = 3 * kRoundoff;
          const double error = u / (1 - options.beta1) + 0.5 * u / (1 - options.beta2) +
                               6 * kRoundoff + options.epsilon / std::fabs(double{g});
          worst.compare(before - s.w[5], g > 0 ? options.rate : -options.rate,
                        options.rate * error + kRoundoff * std::fabs(s.w[5]), "gradient", g, "step",
                        step, "features", features);
        }
      }
  });
  worst.report();
}

TEST(StressAdam, WithoutGradientNothingMovesAtAnyRate) {
  for_each_target([&](const std::string&) {
    for (int features : {0, 2, 4})
      for (Real rate : {1e-38_r, 1.0_r, 1e36_r})
        for (Real weight : {0.0_r, 1e-30_r, -1.0_r, 1e38_r}) {
          State s(32, weight);
          for (int64_t step : {1, 2, 3, 70000}) {
            step_all(features, AdamStep{.rate = rate}, step, s);
            for (Real w : s.w) ASSERT_EQ(w, weight) << "rate " << rate << " step " << step;
          }
        }
  });
}

// Of no rows and of one, with gradients of any size around: the one makes the step that it makes
// among all, and the others keep every bit, numbers or not.
TEST(StressAdam, NoRowsAndOneRow) {
  constexpr size_t kRows = 16;
  const AdamStep options{.rate = 0.5_r};
  std::vector<Real> correction(2 * kBiasCorrections);
  bias_corrections(options, correction.data());
  for_each_target([&](const std::string&) {
    for (int features : {2, 4}) {
      const size_t f = static_cast<size_t>(features), n = kRows * f;
      State start(n, -0.7_r);
      for (size_t i = 0; i < n; ++i) {
        start.gradient[i] = kGradients[i % std::size(kGradients)];
        start.m[i] = i % 5 ? 0.01_r : Real{NAN};
        start.v[i] = 0.25_r;
      }
      const auto step = [&](size_t first, size_t last) {
        State s = start;
        std::vector<Real> steps(kRows, 3);
        RowStates states(kRows, features);
        states.set(s.gradient, s.m, s.v, steps);
        for (size_t row = first; row < last; ++row) states.marks[row] = 1;
        states.take_marked();
        EXPECT_EQ(states.count(), static_cast<int64_t>(last - first));
        adam_rows(options, features, states.list(), states.count(), states.gradient.data(),
                  states.data(), s.w.data(), correction.data());
        states.take(s.gradient, s.m, s.v, steps);
        for (size_t row = 0; row < kRows; ++row)
          EXPECT_EQ(steps[row], row >= first && row < last ? 4 : 3) << row;
        return s;
      };
      const State all = step(0, kRows);
      for (const size_t row : {size_t{0}, size_t{5}, kRows - 1})
        for (const bool one : {false, true}) {
          const State got = step(row, row + one);
          const auto compare = [&](AlignedArray<Real> State::* part) {
            for (size_t i = 0; i < n; ++i) {
              const State& want = one && i / f == row ? all : start;
              ASSERT_EQ(std::memcmp(&(got.*part)[i], &(want.*part)[i], sizeof(Real)), 0)
                  << "row " << i / f << " beside " << row << ": " << (got.*part)[i];
            }
          };
          for (const auto part : {&State::gradient, &State::m, &State::v, &State::w}) compare(part);
        }
    }
  });
}

// Nothing hides a gradient that is no number: the health check of training looks for such.
TEST(StressAdam, GradientsThatAreNoNumbersShow) {
  for_each_target([&](const std::string&) {
    for (int features : {0, 2, 4}) {
      State s(32, 1);
      for (size_t i = 0; i < 32; i += 2) s.gradient[i] = Real{NAN};
      step_all(features, AdamStep(), 1, s);
      for (size_t i = 0; i < 32; ++i) EXPECT_EQ(std::isnan(s.w[i]), i % 2 == 0) << i;
    }
  });
}

}  // namespace
}  // namespace nerf::stress
