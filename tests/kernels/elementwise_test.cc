#include "nerf/kernels/elementwise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/math/reference/activations.h"
#include "nerf/math/reference/volume_rendering.h"

namespace nerf {
namespace {

constexpr Real kInf = std::numeric_limits<Real>::infinity();
// Results under the smallest normal number may be rounded coarsely or flushed to 0.
constexpr double kTiny = std::numeric_limits<Real>::min();
// Highway states 1 unit in the last place for Exp and 4 for Expm1; a unit is at most two roundoffs.
constexpr double kExpError = 2 * kRoundoff, kExpm1Error = 8 * kRoundoff;

// Numbers over the whole range and at every place where a function changes its form.
std::vector<Real> kinks() {
  std::vector<Real> out = {0.0_r, -0.0_r, 1e-30_r, -1e-30_r, 1e-7_r, -1e-7_r};
  for (Real kink : {15.0_r, 30.0_r, 80.0_r, 88.0_r, 88.8_r, 104.0_r, 127.0_r, 178.0_r, 200.0_r,
                    1000.0_r, 1e30_r})
    for (Real sign : {-1.0_r, 1.0_r})
      for (Real at : {std::nextafter(kink, 0.0_r), kink, std::nextafter(kink, kInf)})
        out.push_back(sign * at);
  Random random(23, 0, 0);
  for (double width : {1e-3, 1.0, 20.0, 110.0})
    for (int i = 0; i < 400; ++i) out.push_back(uniform(random, -width, width));
  return out;
}

TEST(Elementwise, TruncatedExp) {
  WorstError forward("forward"), backward("backward");
  for_each_target([&](const std::string&) {
    std::vector<Real> values = kinks();
    values.insert(values.end(), {-kInf, kInf});
    const Matrix x = row_of(values);
    Random random(24, 0, 0);
    const Matrix dy(1, x.n, random, -2, 2, Matrix::Padding::kZero);
    Matrix y(1, x.n), dx(1, x.n);
    truncated_exp_forward(x.n, x.data.data(), y.data.data());
    truncated_exp_backward(x.n, x.data.data(), dy.data.data(), dx.data.data());
    for (int64_t i = 0; i < x.n; ++i) {
      const double at = x.at(0, i), g = dy.at(0, i);
      const double want = std::isfinite(at) ? reference::truncated_exp(at)
                          : at < 0          ? 0
                                            : std::exp(30);
      forward.compare(y.at(0, i), want, kExpError * want + kTiny, "x", at);
      const double slope = reference::truncated_exp_slope(at);
      backward.compare(dx.at(0, i), slope * g,
                       (kExpError + kRoundoff) * std::fabs(slope * g) + kTiny, "x", at);
    }
    y.expect_untouched_beyond_padding();
    dx.expect_untouched_beyond_padding();
  });
  forward.report();
  backward.report();
}

// exp(-x) has relative error e, 1 + exp(-x) one more roundoff and at most e, the quotient another.
TEST(Elementwise, Sigmoid) {
  WorstError forward("forward"), backward("backward");
  for_each_target([&](const std::string&) {
    std::vector<Real> values = kinks();
    values.insert(values.end(), {-kInf, kInf});
    const Matrix x = row_of(values);
    Random random(25, 0, 0);
    const Matrix dy(1, x.n, random, -2, 2, Matrix::Padding::kZero);
    Matrix y(1, x.n), dx(1, x.n);
    sigmoid_forward(x.n, x.data.data(), y.data.data());
    sigmoid_backward(x.n, y.data.data(), dy.data.data(), dx.data.data());
    for (int64_t i = 0; i < x.n; ++i) {
      const double at = x.at(0, i), g = dy.at(0, i);
      const double want = std::isfinite(at) ? reference::sigmoid(at) : at < 0 ? 0 : 1;
      forward.compare(y.at(0, i), want, (kExpError + 2 * kRoundoff) * want + kTiny, "x", at);
      const double slope = reference::sigmoid_slope(static_cast<double>(y.at(0, i)));
      backward.compare(dx.at(0, i), slope * g, 2 * kRoundoff * std::fabs(slope * g) + kTiny, "x",
                       at);
    }
    y.expect_untouched_beyond_padding();
    dx.expect_untouched_beyond_padding();
  });
  forward.report();
  backward.report();
}

// x + shift is rounded once, where softplus has a slope of at most 1; exp(-|x|) has relative error
// e that log(1 + exp) passes on damped, and the logarithm and the sum add theirs. Where x < 0 and
// the logarithm alone is left, all of that is relative to it; x's own rounding is not.
TEST(Elementwise, SoftplusAndRelu) {
  WorstError forward("softplus"), backward("softplus_backward");
  constexpr double kLog1pError = 4 * kRoundoff;  // Highway states 2 units in the last place
  for_each_target([&](const std::string&) {
    const Matrix x = row_of(kinks());
    Random random(28, 0, 0);
    const Matrix dy(1, x.n, random, -2, 2, Matrix::Padding::kZero);
    for (Real shift : {0.0_r, -1.0_r}) {
      Matrix y(1, x.n), dx(1, x.n), r(1, x.n);
      softplus_forward(x.n, shift, x.data.data(), y.data.data());
      softplus_backward(x.n, shift, x.data.data(), dy.data.data(), dx.data.data());
      relu_forward(x.n, x.data.data(), r.data.data());
      for (int64_t i = 0; i < x.n; ++i) {
        const double at = static_cast<double>(x.at(0, i)) + static_cast<double>(shift);
        const double want = reference::softplus(at), slope = reference::sigmoid(at);
        forward.compare(y.at(0, i), want,
                        (kExpError + kLog1pError + kRoundoff) * want +
                            kRoundoff * std::fabs(at) * slope + kTiny,
                        "x", x.at(0, i));
        const double g = dy.at(0, i);
        // The slope's own derivative is at most itself.
        backward.compare(
            dx.at(0, i), slope * g,
            (kExpError + 3 * kRoundoff + kRoundoff * std::fabs(at)) * std::fabs(slope * g) +
                2 * kTiny,
            "x", x.at(0, i));
        EXPECT_EQ(r.at(0, i), std::max(x.at(0, i), 0.0_r));
      }
      y.expect_untouched_beyond_padding();
      dx.expect_untouched_beyond_padding();
      r.expect_untouched_beyond_padding();
    }
  });
  forward.report();
  backward.report();
}

// The product's rounding reaches 1 - exp(-tau) damped by tau / (exp(tau) - 1) <= 1. Small arguments
// keep their relative accuracy.
TEST(Elementwise, Opacity) {
  WorstError worst("opacity");
  for_each_target([&](const std::string&) {
    Random random(26, 0, 0);
    std::vector<Real> densities, deltas;
    for (double exponent = -12; exponent <= 12; exponent += 0.05) {
      densities.push_back(static_cast<Real>(std::pow(10.0, exponent)));
      deltas.push_back(uniform(random, 1e-4, 2));
    }
    densities.insert(densities.end(),
                     {0.0_r, 3.0_r, 1e13_r, 1e38_r, 80.0_r, 79.9_r, 104.0_r, 1e4_r});
    deltas.insert(deltas.end(), {1.0_r, 0.0_r, 4.0_r, 0.5_r, 1.0_r, 1.0_r, 1.0_r, 1.0_r});
    const Matrix density = row_of(densities), delta = row_of(deltas);
    Matrix alpha(1, density.n);
    opacity(density.n, density.data.data(), delta.data.data(), alpha.data.data());
    for (int64_t i = 0; i < density.n; ++i) {
      const double want = reference::opacity<double>(density.at(0, i), delta.at(0, i));
      worst.compare(alpha.at(0, i), want, (kExpm1Error + kRoundoff) * want + kTiny, "density",
                    density.at(0, i), "delta", delta.at(0, i));
      EXPECT_LE(alpha.at(0, i), 1.0_r);
      EXPECT_GE(alpha.at(0, i), 0.0_r);
    }
    alpha.expect_untouched_beyond_padding();
  });
  worst.report();
}

// Every count: results for all n values, nothing beyond the padding, the same bits as for any
// other.
// Every number to its place, and none beyond.
TEST(Elementwise, Transpose) {
  for_each_target([&](const std::string&) {
    for (const int64_t n : {0, 1, 3, 4, 5, 16, 31, 240})
      for (const int64_t rows : {0, 1, 2, 4, 7, 16, 18}) {
        const int64_t ldx = n + 3, ldy = rows + 2;
        std::vector<Real> x(static_cast<size_t>(rows * ldx)), y(static_cast<size_t>(n * ldy), -1);
        for (size_t i = 0; i < x.size(); ++i) x[i] = static_cast<Real>(i);
        transpose(n, rows, x.data(), ldx, y.data(), ldy);
        for (int64_t s = 0; s < n; ++s)
          for (int64_t k = 0; k < ldy; ++k)
            ASSERT_EQ(y[static_cast<size_t>(s * ldy + k)],
                      k < rows ? static_cast<Real>(k * ldx + s) : -1.0_r)
                << n << " x " << rows << ": " << s << ", " << k;
      }
  });
}

TEST(Elementwise, EveryCount) {
  for_each_target([&](const std::string&) {
    Random random(27, 0, 0);
    const Matrix a(1, 256, random, -3, 3), b(1, 256, random, 0, 2);
    Matrix full[6] = {{1, 256}, {1, 256}, {1, 256}, {1, 256}, {1, 256}, b};
    const auto run = [&](int64_t n, Matrix out[6]) {
      truncated_exp_forward(n, a.data.data(), out[0].data.data());
      truncated_exp_backward(n, a.data.data(), b.data.data(), out[1].data.data());
      sigmoid_forward(n, a.data.data(), out[2].data.data());
      sigmoid_backward(n, out[2].data.data(), b.data.data(), out[3].data.data());
      opacity(n, b.data.data(), b.data.data(), out[4].data.data());
      add_to(n, a.data.data(), out[5].data.data());
    };
    run(256, full);
    for (int64_t i = 0; i < 256; ++i) EXPECT_EQ(full[5].at(0, i), a.at(0, i) + b.at(0, i)) << i;
    for (int64_t n : kCounts) {
      Matrix part[6] = {{1, n}, {1, n}, {1, n}, {1, n}, {1, n}, {1, n}};
      for (int64_t i = 0; i < part[5].padded; ++i) part[5].at(0, i) = b.at(0, i);
      run(n, part);
      for (int f = 0; f < 6; ++f) {
        for (int64_t i = 0; i < n; ++i)
          ASSERT_EQ(part[f].at(0, i), full[f].at(0, i)) << f << ' ' << i;
        part[f].expect_untouched_beyond_padding();
      }
    }
  });
}

}  // namespace
}  // namespace nerf
