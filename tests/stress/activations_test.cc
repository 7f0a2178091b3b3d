// The elementwise functions over every magnitude that a float has, denormals and infinities among
// them, whether or not denormals are flushed.
#include "nerf/math/reference/activations.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/math/reference/volume_rendering.h"
#include "stress/magnitudes.h"

namespace nerf::stress {
namespace {

// Highway states 1 unit in the last place for Exp and 4 for Expm1; a unit is at most two roundoffs.
constexpr double kExpError = 2 * kRoundoff, kExpm1Error = 8 * kRoundoff;

TEST(StressActivation, SigmoidOfEveryMagnitude) {
  WorstError forward("forward"), backward("backward");
  const Matrix x = row_of(all_magnitudes(0x3fff1, true));
  Matrix y(1, x.n), dx(1, x.n), dy(1, x.n);
  for (Real gradient : {1.0_r, -1e-30_r, 1e38_r}) {
    for (int64_t i = 0; i < x.padded; ++i) dy.at(0, i) = gradient;
    for_each_mode(
        [&] {
          sigmoid_forward(x.n, x.data.data(), y.data.data());
          sigmoid_backward(x.n, y.data.data(), dy.data.data(), dx.data.data());
        },
        [&] {
          for (int64_t i = 0; i < x.n; ++i) {
            const double at = x.at(0, i), got = y.at(0, i), want = reference::sigmoid(at);
            ASSERT_TRUE(got >= 0 && got <= 1) << at;
            if (at == 0) {
              ASSERT_EQ(got, 0.5) << "at either zero";
            }
            if (at <= -1e4 || at >= 1e4) {
              ASSERT_NEAR(got, at > 0, kTiny) << at;
            }
            // exp(-x), 1 + exp(-x), the quotient.
            forward.compare(got, want, (kExpError + 2 * kRoundoff) * want + kTiny, "x", at);
            // y - y^2 in one rounding, the product in another.
            const double slope = reference::sigmoid_slope(got) * double{gradient};
            ASSERT_TRUE(std::isfinite(dx.at(0, i))) << at;
            backward.compare(
                dx.at(0, i), slope,
                2 * kRoundoff * std::fabs(slope) + kTiny * (1 + std::fabs(double{gradient})), "x",
                at, "gradient", gradient);
          }
        });
  }
  forward.report();
  backward.report();
}

TEST(StressActivation, TruncatedExpOfEveryMagnitude) {
  WorstError forward("forward"), backward("backward");
  const Matrix x = row_of(all_magnitudes(0x3fff1, true));
  Matrix y(1, x.n), dx(1, x.n), dy(1, x.n);
  for (Real gradient : {1.0_r, -1e-30_r, 1e31_r}) {
    for (int64_t i = 0; i < x.padded; ++i) dy.at(0, i) = gradient;
    for_each_mode(
        [&] {
          truncated_exp_forward(x.n, x.data.data(), y.data.data());
          truncated_exp_backward(x.n, x.data.data(), dy.data.data(), dx.data.data());
        },
        [&] {
          for (int64_t i = 0; i < x.n; ++i) {
            const double at = x.at(0, i);
            // Where x is infinite the template's slope times x - x is no number.
            const double want = std::exp(std::min(at, 30.0));
            ASSERT_TRUE(std::isfinite(y.at(0, i)) && y.at(0, i) >= 0) << at;
            if (at == 0) {
              ASSERT_EQ(y.at(0, i), 1) << "at either zero";
            }
            forward.compare(y.at(0, i), want, kExpError * want + kTiny, "x", at);
            const double slope = reference::truncated_exp_slope(at) * double{gradient};
            backward.compare(dx.at(0, i), slope, (kExpError + kRoundoff) * std::fabs(slope) + kTiny,
                             "x", at, "gradient", gradient);
          }
        });
  }
  forward.report();
  backward.report();
}

// The same errors as in tests/kernels/elementwise_test.cc: x + shift is rounded once, where
// softplus has a slope of at most 1; Exp and Log1p add theirs and the sum its own. Up to where a
// float holds it softplus is x itself, infinite where x is.
TEST(StressActivation, SoftplusOfEveryMagnitude) {
  WorstError forward("forward"), backward("backward");
  constexpr double kLog1pError = 4 * kRoundoff;  // Highway states 2 units in the last place
  const Matrix x = row_of(all_magnitudes(0x3fff1, true));
  Matrix y(1, x.n), dx(1, x.n), dy(1, x.n);
  for (Real shift : {0.0_r, -1.0_r, 1e10_r, -1e10_r})
    for (Real gradient : {1.0_r, -1e-30_r, 1e38_r, 1e-42_r}) {
      for (int64_t i = 0; i < x.padded; ++i) dy.at(0, i) = gradient;
      for_each_mode(
          [&] {
            softplus_forward(x.n, shift, x.data.data(), y.data.data());
            softplus_backward(x.n, shift, x.data.data(), dy.data.data(), dx.data.data());
          },
          [&] {
            for (int64_t i = 0; i < x.n; ++i) {
              const double at = double{x.at(0, i)} + double{shift};
              ASSERT_TRUE(y.at(0, i) >= 0) << at;
              ASSERT_TRUE(std::isfinite(dx.at(0, i))) << at;
              if (std::isinf(at)) {
                ASSERT_TRUE(at > 0 ? y.at(0, i) == kInf : y.at(0, i) <= kTiny) << at;
                ASSERT_NEAR(double{dx.at(0, i)}, at > 0 ? double{gradient} : 0,
                            kTiny * (1 + std::fabs(double{gradient})));
                continue;
              }
              const double want = reference::softplus(at), slope = reference::sigmoid(at);
              // The slope of the slope is at most itself, and it is flat beyond 100.
              const double moved = kRoundoff * std::fabs(at) * slope;
              forward.compare(y.at(0, i), want,
                              (kExpError + kLog1pError + kRoundoff) * want + moved + kTiny, "x",
                              x.at(0, i), "shift", shift);
              const double steep = at > 100 ? 0 : kRoundoff * std::fabs(at);
              const double g = std::fabs(double{gradient});
              backward.compare(dx.at(0, i), slope * double{gradient},
                               (kExpError + 3 * kRoundoff + steep) * slope * g + kTiny * (2 + g),
                               "x", x.at(0, i), "shift", shift, "gradient", gradient);
            }
          });
    }
  forward.report();
  backward.report();
}

// Nothing is rounded: x or 0, and the gradient or 0. A denormal may count as 0 where those are
// flushed.
TEST(StressActivation, ReluOfEveryMagnitude) {
  const Matrix x = row_of(all_magnitudes(0x3fff1, true));
  Matrix y(1, x.n), dx(1, x.n);
  for (Real gradient : {1.0_r, -1e-30_r, kMax, kInf, 1e-42_r})
    for_each_mode(
        [&] {
          for (int64_t i = 0; i < x.padded; ++i) dx.at(0, i) = gradient;
          relu_forward(x.n, x.data.data(), y.data.data());
          relu_backward(1, y.data.data(), dx.data.data(), x.ld, x.n);
        },
        [&] {
          for (int64_t i = 0; i < x.n; ++i) {
            const Real at = x.at(0, i), got = y.at(0, i);
            if (at >= kTiny || at <= 0) {
              ASSERT_EQ(got, std::max(at, 0.0_r)) << at;
              ASSERT_EQ(dx.at(0, i), at > 0 ? gradient : 0) << at;
            } else {
              ASSERT_TRUE(got == at || got == 0) << at;
              ASSERT_TRUE(dx.at(0, i) == gradient || dx.at(0, i) == 0) << at;
            }
          }
        });
}

// Every density with every length, products that overflow and vanish among them. A product that is
// below the smallest normal number, or has such a factor, may be 0: off by kTiny, or by that times
// the other factor.
TEST(StressActivation, OpacityOfEveryMagnitude) {
  WorstError worst("opacity");
  const std::vector<Real> densities = all_magnitudes(0x7fff11, false);
  for (Real density : densities) {
    if (density == kInf) continue;
    std::vector<Real> lengths = all_magnitudes(0x7fff11, false);
    const Matrix sigma = row_of(std::vector<Real>(lengths.size(), density));
    const Matrix delta = row_of(lengths);
    Matrix alpha(1, sigma.n);
    for_each_mode(
        [&] { opacity(sigma.n, sigma.data.data(), delta.data.data(), alpha.data.data()); },
        [&] {
          for (int64_t i = 0; i < sigma.n; ++i) {
            const double length = std::min(delta.at(0, i), kLongestInterval), got = alpha.at(0, i);
            const double want = reference::opacity<double>(density, length);
            ASSERT_TRUE(got >= 0 && got <= 1) << density << " over " << delta.at(0, i);
            if (density == 0 || length == 0) {
              ASSERT_EQ(got, 0) << density << " over " << delta.at(0, i);
            }
            double flushed = kTiny;
            if (density < kTiny) flushed += density * length;
            if (length < kTiny) flushed += density * length;
            worst.compare(got, want, (kExpm1Error + kRoundoff) * want + flushed, "density", density,
                          "length", delta.at(0, i));
          }
        });
  }
  worst.report();
}

}  // namespace
}  // namespace nerf::stress
