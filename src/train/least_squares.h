// Damped Gauss-Newton (Levenberg 1944, Marquardt 1963) for a few parameters of a function that is
// only known by its values: what a held-out photo's camera or code is fitted with.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "nerf/base/error.h"

namespace nerf {

struct LeastSquaresOptions {
  int most_iterations = 20;  // each asks for 2 n + 1 to 2 n + kMostTries vectors of residuals
  double damping = 1e-3;     // at first, as a share of the normal equations' diagonal
  double tolerance = 1e-4;   // ends where the sum of squares falls by a smaller share of it
};

struct LeastSquaresResult {
  double before = 0, after = 0;  // sums of squares
  int iterations = 0;
};

namespace internal {

// Solves A x = b for a symmetric positive definite A, row by row, [n][n], whose lower half becomes
// its factor (Cholesky); b becomes x. False where A is not positive definite.
inline bool solve_positive(std::vector<double>& a, std::vector<double>& b) {
  const size_t n = b.size();
  for (size_t i = 0; i < n; ++i)
    for (size_t j = 0; j <= i; ++j) {
      double sum = a[i * n + j];
      for (size_t k = 0; k < j; ++k) sum -= a[i * n + k] * a[j * n + k];
      if (i > j)
        a[i * n + j] = sum / a[j * n + j];
      else if (sum > 0)
        a[i * n + i] = std::sqrt(sum);
      else
        return false;
    }
  for (size_t i = 0; i < n; ++i) {
    for (size_t k = 0; k < i; ++k) b[i] -= a[i * n + k] * b[k];
    b[i] /= a[i * n + i];
  }
  for (size_t i = n; i-- > 0;) {
    for (size_t k = i + 1; k < n; ++k) b[i] -= a[k * n + i] * b[k];
    b[i] /= a[i * n + i];
  }
  return true;
}

}  // namespace internal

// Moves x to where the sum of the residuals' squares is least nearby; never to where it is larger
// than at the start. residuals(std::span<const double> x, std::vector<double>& r) fills in r, of
// the same size each time; a prior is more residuals. steps: of the central differences, one for
// each parameter, as large as it takes for the change to stand clear of rounding. A parameter that
// changes nothing stays. Residuals that are no number count as infinite.
template <class Residuals>
LeastSquaresResult minimise_squares(const Residuals& residuals, std::span<const double> steps,
                                    std::vector<double>& x,
                                    const LeastSquaresOptions& options = {}) {
  constexpr int kMostTries = 6;  // of one iteration, each damped ten times as much
  const size_t n = x.size();
  NERF_CHECK_EQ(steps.size(), n);
  const auto sum_of = [](const std::vector<double>& r) {
    double sum = 0;
    for (const double e : r) sum += e * e;
    return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
  };
  std::vector<double> r, ahead, behind, trial;
  residuals(std::span<const double>(x), r);
  LeastSquaresResult result;
  result.before = result.after = sum_of(r);
  double damping = options.damping;
  std::vector<double> jacobian(n * r.size());  // [n][residuals]
  for (; result.iterations < options.most_iterations; ++result.iterations) {
    if (!(result.after > 0) || !std::isfinite(result.after)) break;
    for (size_t i = 0; i < n; ++i) {
      trial = x;
      trial[i] = x[i] + steps[i];
      residuals(std::span<const double>(trial), ahead);
      trial[i] = x[i] - steps[i];
      residuals(std::span<const double>(trial), behind);
      for (size_t k = 0; k < r.size(); ++k) {
        const double slope = (ahead[k] - behind[k]) / (2 * steps[i]);
        jacobian[i * r.size() + k] = std::isfinite(slope) ? slope : 0;
      }
    }
    std::vector<double> normal(n * n), down(n);
    for (size_t i = 0; i < n; ++i) {
      const double* const a = jacobian.data() + i * r.size();
      for (size_t k = 0; k < r.size(); ++k) down[i] -= a[k] * r[k];
      for (size_t j = 0; j <= i; ++j) {
        const double* const b = jacobian.data() + j * r.size();
        double sum = 0;
        for (size_t k = 0; k < r.size(); ++k) sum += a[k] * b[k];
        normal[i * n + j] = normal[j * n + i] = sum;
      }
    }
    const double sum = result.after;
    for (int tries = 0; tries < kMostTries && result.after == sum; ++tries) {
      std::vector<double> damped = normal, step = down;
      for (size_t i = 0; i < n; ++i) {
        // A parameter without effect: its row and column are zero, and so will be its step.
        double& d = damped[i * n + i];
        d = d > 0 ? d * (1 + damping) : 1;
      }
      trial = x;
      if (internal::solve_positive(damped, step)) {
        for (size_t i = 0; i < n; ++i) trial[i] += step[i];
        residuals(std::span<const double>(trial), ahead);
        const double now = sum_of(ahead);
        if (now < sum) {
          x = trial;
          r = ahead;
          result.after = now;
          damping = std::max(damping / 10, 1e-12);
          break;
        }
      }
      damping *= 10;
    }
    if (!(sum - result.after > options.tolerance * sum)) {
      ++result.iterations;
      break;
    }
  }
  return result;
}

}  // namespace nerf
