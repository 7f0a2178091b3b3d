#include "train/least_squares.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <span>
#include <vector>

namespace nerf {
namespace {

using Values = std::vector<double>;

TEST(LeastSquares, SolvesALinearProblemAtOnce) {
  // Points on y = 3 - 2 u + 0.5 u^2.
  const auto residuals = [](std::span<const double> x, Values& r) {
    r.clear();
    for (int i = 0; i < 7; ++i) {
      const double u = 0.5 * i;
      r.push_back(x[0] + x[1] * u + x[2] * u * u - (3 - 2 * u + 0.5 * u * u));
    }
  };
  Values x(3);
  LeastSquaresOptions options;
  options.damping = 0;
  options.most_iterations = 1;
  const LeastSquaresResult result = minimise_squares(residuals, Values(3, 0.5), x, options);
  EXPECT_EQ(result.iterations, 1);
  EXPECT_GT(result.before, 10);
  // Differences of what is linear are exact but for rounding.
  EXPECT_NEAR(x[0], 3, 1e-12);
  EXPECT_NEAR(x[1], -2, 1e-12);
  EXPECT_NEAR(x[2], 0.5, 1e-12);
}

TEST(LeastSquares, FollowsABentValley) {
  // Rosenbrock's function.
  const auto residuals = [](std::span<const double> x, Values& r) {
    r = {10 * (x[1] - x[0] * x[0]), 1 - x[0]};
  };
  Values x = {-1.2, 1};
  LeastSquaresOptions options;
  options.most_iterations = 200;
  options.tolerance = 0;
  const LeastSquaresResult result = minimise_squares(residuals, Values(2, 1e-4), x, options);
  EXPECT_NEAR(x[0], 1, 1e-7);
  EXPECT_NEAR(x[1], 1, 1e-7);
  EXPECT_LT(result.after, 1e-14);
  EXPECT_DOUBLE_EQ(result.before, 4.4 * 4.4 + 2.2 * 2.2);
}

TEST(LeastSquares, AParameterWithoutEffectStays) {
  const auto residuals = [](std::span<const double> x, Values& r) {
    r = {std::exp(x[0]) - 2, x[0] * 0.1};
  };
  Values x = {0, 7, 0};
  minimise_squares(residuals, Values(3, 1e-4), x);
  EXPECT_NEAR(x[0], std::log(2.0), 5e-3);
  EXPECT_EQ(x[1], 7);
  EXPECT_EQ(x[2], 0);
}

TEST(LeastSquares, TwoParametersThatDoTheSameShareIt) {
  const auto residuals = [](std::span<const double> x, Values& r) { r = {x[0] + x[1] - 1}; };
  Values x(2);
  LeastSquaresOptions options;
  options.tolerance = 0;
  minimise_squares(residuals, Values(2, 1e-3), x, options);
  EXPECT_NEAR(x[0] + x[1], 1, 1e-6);
  EXPECT_NEAR(x[0], x[1], 1e-6);
}

// Where the residuals are rounded, the differences' steps are wide, and the end is as near as that.
TEST(LeastSquares, WideStepsStandClearOfRounding) {
  const auto residuals = [](std::span<const double> x, Values& r) {
    r.clear();
    for (int i = 0; i < 200; ++i)
      r.push_back(static_cast<double>(std::lround(255 * std::sin(0.03 * i + x[0]))) / 255 -
                  std::sin(0.03 * i + 0.2));
  };
  Values x(1);
  const LeastSquaresResult result = minimise_squares(residuals, Values(1, 0.02), x);
  EXPECT_NEAR(x[0], 0.2, 1e-3);
  EXPECT_LT(result.after, 1e-3 * result.before);
}

TEST(LeastSquares, NeverEndsWorseThanItBegan) {
  const auto residuals = [](std::span<const double> x, Values& r) {
    r = {x[0] > 0.1 ? std::numeric_limits<double>::quiet_NaN() : 1 - x[0]};
  };
  Values x(1);
  const LeastSquaresResult result = minimise_squares(residuals, Values(1, 1e-3), x);
  EXPECT_LE(result.after, result.before);
  EXPECT_LE(x[0], 0.1);
  // At a start that is no number there is nothing to follow.
  Values nowhere = {1};
  minimise_squares(residuals, Values(1, 1e-3), nowhere);
  EXPECT_EQ(nowhere[0], 1);
}

TEST(LeastSquares, ASolutionAlreadyStays) {
  const auto residuals = [](std::span<const double> x, Values& r) { r = {x[0]}; };
  Values x(1);
  EXPECT_EQ(minimise_squares(residuals, Values(1, 1e-3), x).iterations, 0);
  EXPECT_EQ(x[0], 0);
}

}  // namespace
}  // namespace nerf
