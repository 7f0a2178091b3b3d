#include "nerf/kernels/encoding.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "golden/golden.h"
#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/math/reference/encoding.h"
#include "nerf/math/reference/spherical_harmonics.h"

namespace nerf {
namespace {

// Two units in the last place are at most four roundoffs; the product with the weight is one more.
constexpr double kSineError = 4 * kRoundoff;
// An exponent up to 100 in size has an error of one roundoff of itself, Exp itself one unit.
constexpr double kDampingError = (1 + 2 + 100) * kRoundoff;

// Dense around zero and multiples of a quarter turn, where one of the two results is tiny, and over
// all sizes up to far beyond what the reduction's constants reach.
std::vector<Real> quarter_turns() {
  std::vector<Real> out = {0.0_r,   -0.0_r,   1e-30_r,
                           1e-10_r, 0x1p20_r, std::nextafter(0x1p20_r, 1e9_r)};
  for (int quarter = -600; quarter <= 600; ++quarter) {
    const Real at = static_cast<Real>(quarter * 1.5707963267948966);
    for (Real x : {std::nextafter(at, -1e9_r), at, std::nextafter(at, 1e9_r)}) out.push_back(x);
  }
  Random random(31, 0, 0);
  for (double width : {1e-3, 1.0, 100.0, 1e5, 1e6, 1e9, 1e15})
    for (int i = 0; i < 1500; ++i) out.push_back(uniform(random, -width, width));
  return out;
}

TEST(SineCosine, EveryArgument) {
  WorstError worst("sine_cosine");
  for_each_target([&](const std::string&) {
    const Matrix x = row_of(quarter_turns());
    for (Real frequency : {1.0_r, 0.25_r, 0x1p15_r}) {
      Matrix s(1, x.n), c(1, x.n);
      sine_cosine_forward(x.n, x.data.data(), nullptr, frequency, 1, s.data.data(), c.data.data());
      for (int64_t i = 0; i < x.n; ++i) {
        // In double the argument's own reduction is exact to 1e15 2^15 2^-53 at worst; where that
        // is more than the tolerance, long double has eleven more digits.
        const long double y = static_cast<long double>(x.at(0, i)) * frequency;
        worst.compare(s.at(0, i), static_cast<double>(std::sin(y)), kSineError, "sin", x.at(0, i),
                      "frequency", frequency);
        worst.compare(c.at(0, i), static_cast<double>(std::cos(y)), kSineError, "cos", x.at(0, i),
                      "frequency", frequency);
      }
      s.expect_untouched_beyond_padding();
      c.expect_untouched_beyond_padding();
    }
  });
  worst.report();
}

// Near a zero of the sine the result keeps its relative accuracy.
TEST(SineCosine, SmallResultsKeepTheirDigits) {
  WorstError worst("small_results");
  for_each_target([&](const std::string&) {
    std::vector<Real> values;
    for (int half = -2000; half <= 2000; ++half)
      values.push_back(static_cast<Real>(half * 3.14159265358979323846));
    const Matrix x = row_of(values);
    Matrix s(1, x.n), c(1, x.n);
    sine_cosine_forward(x.n, x.data.data(), nullptr, 1, 1, s.data.data(), c.data.data());
    for (int64_t i = 0; i < x.n; ++i) {
      const double want = std::sin(static_cast<double>(x.at(0, i)));
      // The last two steps of the reduction round once each, then the polynomial twice.
      worst.compare(s.at(0, i), want, 2 * kSineError * std::fabs(want), "x", x.at(0, i));
    }
  });
  worst.report();
}

TEST(SineCosine, DampedByVarianceAndWeight) {
  WorstError worst("damped");
  for_each_target([&](const std::string&) {
    Random random(32, 0, 0);
    for (double spread : {1e-9, 1e-3, 1.0, 1e6, 1e30}) {
      const Matrix x(1, 240, random, -3, 3), variance(1, 240, random, 0, spread);
      for (Real frequency : {1.0_r, 64.0_r, 0x1p15_r})
        for (Real weight : {1.0_r, 0.3_r, 0.0_r}) {
          Matrix s(1, x.n), c(1, x.n);
          sine_cosine_forward(x.n, x.data.data(), variance.data.data(), frequency, weight,
                              s.data.data(), c.data.data());
          for (int64_t i = 0; i < x.n; ++i) {
            const double v = variance.at(0, i);
            const auto want = reference::sine_cosine<double>(x.at(0, i), v, frequency, weight);
            const double a = weight * std::exp(-0.5 * frequency * frequency * v);
            const double bound = (kSineError + kDampingError + 2 * kRoundoff) * a + 1e-38;
            worst.compare(s.at(0, i), want[0], bound, "sin", x.at(0, i), "variance", v);
            worst.compare(c.at(0, i), want[1], bound, "cos", x.at(0, i), "variance", v);
          }
        }
    }
  });
  worst.report();
}

TEST(SineCosine, BackwardAddsWhatTheFeaturesSay) {
  WorstError worst("backward");
  for_each_target([&](const std::string&) {
    Random random(33, 0, 0);
    for (int64_t n : kCounts)
      for (Real frequency : {1.0_r, 512.0_r}) {
        const Matrix s(1, n, random, -1, 1), c(1, n, random, -1, 1);
        const Matrix ds(1, n, random, -1, 1, Matrix::Padding::kZero);
        const Matrix dc(1, n, random, -1, 1, Matrix::Padding::kZero);
        const Matrix before(1, n, random, -1, 1, Matrix::Padding::kZero);
        Matrix dx = before, dv = before, dx_alone = before;
        sine_cosine_backward(n, s.data.data(), c.data.data(), ds.data.data(), dc.data.data(),
                             frequency, dx.data.data(), dv.data.data());
        sine_cosine_backward(n, s.data.data(), c.data.data(), ds.data.data(), dc.data.data(),
                             frequency, dx_alone.data.data(), nullptr);
        const double f = frequency;
        for (int64_t i = 0; i < n; ++i) {
          const double a = static_cast<double>(c.at(0, i)) * ds.at(0, i);
          const double b = static_cast<double>(s.at(0, i)) * dc.at(0, i);
          const double e = static_cast<double>(s.at(0, i)) * ds.at(0, i);
          const double g = static_cast<double>(c.at(0, i)) * dc.at(0, i);
          const double start = before.at(0, i);
          worst.compare(dx.at(0, i), start + f * (a - b),
                        rounding_bound(3) * (std::fabs(start) + f * (std::fabs(a) + std::fabs(b))),
                        i);
          worst.compare(
              dv.at(0, i), start - 0.5 * f * f * (e + g),
              rounding_bound(3) * (std::fabs(start) + 0.5 * f * f * (std::fabs(e) + std::fabs(g))),
              i);
          EXPECT_EQ(dx.at(0, i), dx_alone.at(0, i));
        }
        for (int64_t i = n; i < dx.padded; ++i) ASSERT_EQ(dx.at(0, i), 0) << "padding";
        dx.expect_untouched_beyond_padding();
        dv.expect_untouched_beyond_padding();
      }
  });
  worst.report();
}

// Polynomials of at most 5 products and 2 sums whose terms stay under 3 on the unit sphere.
TEST(SphericalHarmonics, MatchTemplateAndGolden) {
  WorstError worst("template"), golden("golden");
  const std::vector<std::vector<double>> lines = golden_lines("encodings.txt", "harmonics");
  for_each_target([&](const std::string&) {
    for (int64_t n : {int64_t{0}, int64_t{1}, int64_t{17}, static_cast<int64_t>(lines.size())}) {
      Matrix direction(3, n), code(kSphericalHarmonics, n);
      for (int64_t i = 0; i < direction.padded; ++i)
        for (int k = 0; k < 3; ++k)
          direction.at(k, i) =
              i < n ? static_cast<Real>(lines[static_cast<size_t>(i)][static_cast<size_t>(k)]) : 0;
      spherical_harmonics(n, direction.data.data(), direction.ld, code.data.data(), code.ld);
      for (int64_t i = 0; i < n; ++i) {
        const std::vector<double> d = direction.column(i);
        const auto want = reference::spherical_harmonics<double>(d[0], d[1], d[2]);
        for (size_t k = 0; k < want.size(); ++k) {
          const double got = code.at(static_cast<int>(k), i);
          worst.compare(got, want[k], rounding_bound(8) * 3, d[0], d[1], d[2], "value", k);
          // The direction itself was rounded: slopes up to 9 in each of three coordinates.
          golden.compare(got, lines[static_cast<size_t>(i)][3 + k],
                         rounding_bound(8) * 3 + 27 * kRoundoff, d[0], d[1], d[2], "value", k);
        }
      }
      code.expect_untouched_beyond_padding();
    }
  });
  worst.report();
  golden.report();
}

}  // namespace
}  // namespace nerf
