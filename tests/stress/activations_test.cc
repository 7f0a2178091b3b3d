// The elementwise functions over every magnitude that a float has, denormals and infinities among
// them, whether or not denormals are flushed.
#include "nerf/math/reference/activations.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/base/threads.h"
#include "nerf/kernels/elementwise.h"
#include "nerf/math/reference/volume_rendering.h"

namespace nerf::stress {
namespace {

constexpr Real kInf = std::numeric_limits<Real>::infinity();
constexpr Real kMax = std::numeric_limits<Real>::max();
constexpr Real kDenormal = std::numeric_limits<Real>::denorm_min();
constexpr double kTiny = std::numeric_limits<Real>::min();
// Highway states 1 unit in the last place for Exp and 4 for Expm1; a unit is at most two roundoffs.
constexpr double kExpError = 2 * kRoundoff, kExpm1Error = 8 * kRoundoff;

// Numbers at even distances of their bit patterns: each power of two gets as many. Then those whose
// names the header mentions.
std::vector<Real> all_magnitudes(uint32_t step, bool negative) {
  std::vector<Real> out = {0.0_r,  kDenormal, 1e-40_r, std::numeric_limits<Real>::min(),
                           kMax,   kInf,      15.0_r,  30.0_r,
                           80.0_r, 88.0_r,    1e4_r,   1e10_r};
  const uint32_t end = std::bit_cast<uint32_t>(std::numeric_limits<float>::infinity());
  for (uint32_t bits = 1; bits < end; bits += step) out.push_back(std::bit_cast<float>(bits));
  if (negative)
    for (size_t i = 0, n = out.size(); i < n; ++i) out.push_back(-out[i]);
  return out;
}

Matrix row_of(const std::vector<Real>& values) {
  Matrix m(1, static_cast<int64_t>(values.size()));
  for (int64_t i = 0; i < m.padded; ++i)
    m.at(0, i) = i < m.n ? values[static_cast<size_t>(i)] : 0.5_r;
  return m;
}

// On every target, with denormals as they are and flushed. Comparisons are made outside.
template <class Kernels, class Compare>
void for_each_mode(const Kernels& kernels, const Compare& compare) {
  for_each_target([&](const std::string&) {
    for (bool flush : {false, true}) {
      SCOPED_TRACE(flush ? "denormals flushed" : "denormals kept");
      {
        const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
        kernels();
      }
      compare();
    }
  });
}

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
