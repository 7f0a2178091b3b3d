// Encodings, forward and backward, where arguments have many turns or vanish, where variances leave
// nothing, and where a window is just shut or open.
#include "nerf/math/reference/encoding.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "autodiff/gradient_problem.h"
#include "kernels/kernel_test.h"
#include "math/complex_step.h"
#include "math/worst_error.h"
#include "nerf/kernels/encoding.h"
#include "nerf/math/reference/spherical_harmonics.h"
#include "nerf/math/vec.h"
#include "nerf/math/window.h"
#include "stress/magnitudes.h"

namespace nerf::stress {
namespace {

// As tests/kernels/encoding_test.cc: two units in the last place of a sine are at most four
// roundoffs; an exponent up to 100 is off by one of itself, its exponential by a unit, and the
// products of the weight, the damping and the sine are two more.
constexpr double kSineError = 4 * kRoundoff;
constexpr double kDampedError = kSineError + (1 + 2 + 100) * kRoundoff + 2 * kRoundoff;
// The kernel's exponents end at -100.
const double kLeftOver = kTiny + std::exp(-100);

constexpr Real kFrequencies[] = {1, 0x1p9_r, 0x1p15_r, 0x1p23_r};

TEST(StressEncoding, SineCosineOfEveryMagnitude) {
  WorstError worst("sine_cosine");
  for (const Real frequency : kFrequencies) {
    std::vector<Real> values = all_magnitudes(0xffff1, true);
    std::erase_if(values, [&](Real v) { return !(std::fabs(v) <= kMax / frequency); });
    const Matrix x = row_of(values);
    Matrix s(1, x.n), c(1, x.n);
    for (const Real weight : {1.0_r, 0.3_r, 1e-38_r, 0.0_r})
      for_each_mode(
          [&] {
            sine_cosine_forward(x.n, x.data.data(), nullptr, frequency, weight, s.data.data(),
                                c.data.data());
          },
          [&] {
            for (int64_t i = 0; i < x.n; ++i) {
              const long double y = static_cast<long double>(x.at(0, i)) * frequency;
              // What is below the normal numbers may be 0 before it is multiplied.
              const double tolerance =
                  double{weight} * (kSineError + kRoundoff + kTiny * double{frequency}) + kTiny;
              worst.compare(s.at(0, i), double{weight} * static_cast<double>(std::sin(y)),
                            tolerance, "sin", x.at(0, i), "frequency", frequency);
              worst.compare(c.at(0, i), double{weight} * static_cast<double>(std::cos(y)),
                            tolerance, "cos", x.at(0, i), "frequency", frequency);
            }
          });
  }
  worst.report();
}

// Of every size, and to either side of where the exponential leaves the normal numbers and where
// the kernel's exponents end.
std::vector<Real> variances(Real frequency) {
  std::vector<Real> out = all_magnitudes(0x1fff11, false);
  for (const Real exponent : {1.0_r, 80.0_r, 87.0_r, 87.5_r, 88.0_r, 99.9_r, 100.1_r, 104.0_r})
    out.push_back(2 * exponent / (frequency * frequency));
  return out;
}

TEST(StressEncoding, DampedByEveryVariance) {
  WorstError worst("damped");
  for (const Real frequency : kFrequencies)
    for (const Real at : {0.0_r, kDenormal, 1.5_r, -1e5_r, 1e10_r}) {
      const Matrix variance = row_of(variances(frequency));
      const Matrix x = row_of(std::vector<Real>(static_cast<size_t>(variance.n), at));
      Matrix s(1, x.n), c(1, x.n);
      for_each_mode(
          [&] {
            sine_cosine_forward(x.n, x.data.data(), variance.data.data(), frequency, 1,
                                s.data.data(), c.data.data());
          },
          [&] {
            for (int64_t i = 0; i < x.n; ++i) {
              const double v = variance.at(0, i), f = frequency;
              const auto want = reference::sine_cosine<double>(at, v, f, 1);
              const double tolerance =
                  (kDampedError + kTiny * f) * std::exp(-0.5 * f * f * v) + kLeftOver;
              worst.compare(s.at(0, i), want[0], tolerance, "sin", at, "variance", v, "frequency",
                            f);
              worst.compare(c.at(0, i), want[1], tolerance, "cos", at, "variance", v, "frequency",
                            f);
            }
          });
    }
  worst.report();
}

// Derivatives of d_sine sin + d_cosine cos, damped, by complex step. The kernel takes them from the
// features, whose error counts times the gradient and the frequency, or half its square; then come
// two products, a sum and the product with the frequency. A product below the normal numbers may
// be 0.
TEST(StressEncoding, GradientsOfEveryMagnitude) {
  WorstError of_mean("of_mean"), of_variance("of_variance");
  std::vector<Real> places = all_magnitudes(0x1fff11, true), spreads, means;
  std::erase_if(places, [](Real v) { return !(std::fabs(v) <= 1e15_r); });
  places.insert(places.end(), {1e5_r, -1e5_r, 1e6_r});
  for (const Real v : {0.0_r, kDenormal, 1e-10_r, 1e-3_r, 170.0_r, 1e30_r, kMax})
    for (const Real x : places) means.push_back(x), spreads.push_back(v);
  const Matrix x = row_of(means), variance = row_of(spreads);
  Matrix s(1, x.n), c(1, x.n), ds(1, x.n), dc(1, x.n), dx(1, x.n), dv(1, x.n);
  for (const Real frequency : {1.0_r, 0x1p9_r, 0x1p15_r})
    for (const Real size : {1.0_r, -1e-30_r, 1e20_r}) {
      for (int64_t i = 0; i < x.padded; ++i) ds.at(0, i) = size, dc.at(0, i) = -0.7_r * size;
      const double f = frequency, g = std::fabs(double{size});
      std::vector<double> want_dx, want_dv;
      for (int64_t i = 0; i < x.n; ++i) {
        const std::vector<double> derivatives = complex_step_gradient(
            [&](const std::vector<Complex>& at) {
              const auto features = reference::sine_cosine(at[0], at[1], f, 1);
              return double{ds.at(0, i)} * features[0] + double{dc.at(0, i)} * features[1];
            },
            {x.at(0, i), variance.at(0, i)});
        want_dx.push_back(derivatives[0]);
        want_dv.push_back(derivatives[1]);
      }
      for_each_mode(
          [&] {
            for (int64_t i = 0; i < x.padded; ++i) dx.at(0, i) = dv.at(0, i) = 0;
            sine_cosine_forward(x.n, x.data.data(), variance.data.data(), frequency, 1,
                                s.data.data(), c.data.data());
            sine_cosine_backward(x.n, s.data.data(), c.data.data(), ds.data.data(), dc.data.data(),
                                 frequency, dx.data.data(), dv.data.data());
          },
          [&] {
            for (int64_t i = 0; i < x.n; ++i) {
              const double v = variance.at(0, i), a = std::exp(-0.5 * f * f * v);
              const double off = (kDampedError + kTiny * f + rounding_bound(4)) * a + kLeftOver;
              const double tolerance = 1.7 * g * off + 2 * kTiny;
              const size_t at = static_cast<size_t>(i);
              ASSERT_TRUE(std::isfinite(dx.at(0, i)) && std::isfinite(dv.at(0, i)));
              of_mean.compare(dx.at(0, i), want_dx[at], f * tolerance + kTiny, "x", x.at(0, i),
                              "variance", v, "frequency", f, "gradient", size);
              of_variance.compare(dv.at(0, i), want_dv[at], 0.5 * f * f * tolerance + kTiny, "x",
                                  x.at(0, i), "variance", v, "frequency", f, "gradient", size);
            }
          });
    }
  of_mean.report();
  of_variance.report();
}

// A window that is shut, opens, ends exactly at a frequency, next to it, or is wide open, over
// arguments of up to 2^15 1e5. A feature is off by its weight's rounding, the product's and the
// sine's; a gradient is the sum of those of all features: each off as its feature is and by three
// roundings, and by as many more as there are terms.
TEST(StressEncoding, WindowsAtTheirEnds) {
  WorstError forward("forward"), backward("backward");
  constexpr int kCount = 16;
  const std::vector<Real> places = {0.0_r, -0.0_r, kDenormal, 1e-30_r,     1e-5_r,  0.3_r, -1.0_r,
                                    1e3_r, 1e5_r,  -1e5_r,    12345.678_r, 1.5e5_r, 1e6_r};
  const int n = static_cast<int>(places.size());
  for (const double alpha : {0.0, 1e-40, 1e-7, 0.5, std::nextafter(1.0, 0.0), 1.0,
                             std::nextafter(1.0, 2.0), 7.25, 16.0, 17.0, 1e30}) {
    std::vector<Real> weights(kCount);
    window_weights(alpha, weights);
    std::vector<double> exact;
    for (int k = 0; k < kCount; ++k) exact.push_back(reference::window_weight(alpha, k));
    for_each_target([&](const std::string&) {
      Tape tape(n, 1);
      const Value x = tape.input(1, Domain::kSamples, true);
      const Value y = frequency_encoding(tape, x, weights, /*identity=*/true);
      const Value end = tape.output(1, Domain::kRays, {&y, 1});
      tape.record(std::make_unique<Probe>(std::vector<Value>{y}, end));
      tape.plan();
      Chunk chunk(tape);
      const int32_t begin[] = {0, n};
      chunk.samples = n;
      chunk.rays = 1;
      chunk.ray_begin = begin;
      std::ranges::copy(places, chunk.data(x));
      tape.forward(chunk);
      tape.backward(chunk);
      for (int i = 0; i < n; ++i) {
        const double at = places[static_cast<size_t>(i)];
        const auto want = reference::frequency_encoding<double>({at}, exact, true);
        const auto coefficient = [&](size_t row) {
          return Probe::coefficient(0, static_cast<int64_t>(row), i);
        };
        double slope = coefficient(0), size = std::fabs(slope);
        for (size_t row = 0; row < want.size(); ++row) {
          const double w = row == 0 ? 0 : exact[(row - 1) / 2];
          forward.compare(chunk.data(y)[static_cast<int64_t>(row) * chunk.stride(y) + i], want[row],
                          w * (kSineError + 2 * kRoundoff) + kTiny, "window", alpha, "at", at,
                          "row", row);
        }
        for (size_t k = 0; k < kCount; ++k) {
          const double f = std::ldexp(1.0, static_cast<int>(k)), ds = coefficient(1 + 2 * k),
                       dc = coefficient(2 + 2 * k);
          slope += f * exact[k] * (std::cos(f * at) * ds - std::sin(f * at) * dc);
          size += f * exact[k] * (std::fabs(ds) + std::fabs(dc));
        }
        backward.compare(
            chunk.gradient(x)[i], slope,
            (kSineError + 2 * kRoundoff + rounding_bound(1 + 3 + kCount + 1)) * size + kTiny,
            "window", alpha, "at", at);
      }
    });
  }
  forward.report();
  backward.report();
}

// On axes and next to them, between them, and where a component is denormal or all are 0, which no
// direction is: polynomials of at most 5 products and 2 sums, whose terms stay under 3.
TEST(StressEncoding, HarmonicsOfEveryDirection) {
  WorstError worst("harmonics");
  std::vector<Vec3d> directions = {{0, 0, 0}};
  for (const double small : {0.0, 1e-45, 1e-40, 1e-38, 1e-20, 1e-7, 1e-3, 0.5, 1.0})
    for (const double other : {0.0, 1e-42, 1e-19, 1e-4, 1.0})
      for (int axis = 0; axis < 3; ++axis)
        for (const double sign : {-1.0, 1.0}) {
          Vec3d d;
          d[axis] = sign;
          d[(axis + 1) % 3] = -sign * small;
          d[(axis + 2) % 3] = other;
          directions.push_back(normalized(d));
        }
  const int64_t n = static_cast<int64_t>(directions.size());
  Matrix direction(3, n), code(kSphericalHarmonics, n);
  for (int64_t i = 0; i < direction.padded; ++i)
    for (int k = 0; k < 3; ++k)
      direction.at(k, i) = i < n ? static_cast<Real>(directions[static_cast<size_t>(i)][k]) : 0.0_r;
  for_each_mode(
      [&] {
        spherical_harmonics(n, direction.data.data(), direction.ld, code.data.data(), code.ld);
      },
      [&] {
        for (int64_t i = 0; i < n; ++i) {
          const std::vector<double> d = direction.column(i);
          const auto want = reference::spherical_harmonics<double>(d[0], d[1], d[2]);
          for (size_t k = 0; k < want.size(); ++k)
            worst.compare(code.at(static_cast<int>(k), i), want[k], rounding_bound(8) * 3, d[0],
                          d[1], d[2], "value", k);
        }
      });
  worst.report();
}

}  // namespace
}  // namespace nerf::stress
