#include "nerf/math/frustum.h"

#include <gtest/gtest.h>

#include <cmath>

#include "golden/golden.h"
#include "math/worst_error.h"
#include "nerf/math/contraction.h"
#include "nerf/math/random.h"
#include "nerf/math/reference/encoding.h"

namespace nerf {
namespace {

// Sums of positive terms but for one difference in each variance, whose terms are at most 5 times
// the result: fewer than 16 roundings, times 6.
constexpr double kRoundings = 16 * 6;

TEST(Frustum, ConeMatchesExactMoments) {
  WorstError in_double("cone"), in_float("cone_float");
  for (const auto& v : golden_lines("sampling.txt", "cone")) {
    const auto d = cone_gaussian<double>(v[0], v[1], v[2]);
    const auto f = cone_gaussian<float>(static_cast<float>(v[0]), static_cast<float>(v[1]),
                                        static_cast<float>(v[2]));
    const double got[3] = {d.t_mean, d.t_variance, d.r_variance};
    const double got_f[3] = {f.t_mean, f.t_variance, f.r_variance};
    for (int i = 0; i < 3; ++i) {
      in_double.compare(got[i], v[static_cast<size_t>(3 + i)],
                        kRoundings * 0x1p-53 * v[static_cast<size_t>(3 + i)], "t0", v[0], "t1",
                        v[1], "moment", i);
      in_float.compare(got_f[i], v[static_cast<size_t>(3 + i)],
                       kRoundings * kFloatRoundoff * v[static_cast<size_t>(3 + i)], "t0", v[0],
                       "t1", v[1], "moment", i);
    }
  }
  in_double.report();
  in_float.report();
}

TEST(Frustum, ConeWithoutLength) {
  for (float t : {0.0f, 1e-20f, 3.0f, 1e18f}) {
    const auto g = cone_gaussian(t, t, 0.01f);
    EXPECT_FLOAT_EQ(g.t_mean, t);
    EXPECT_EQ(g.t_variance, 0);
    EXPECT_NEAR(g.r_variance, 0.0001f * t * t / 4, 1e-6f * 0.0001f * t * t / 4);
  }
}

// Uniform in the cylinder: a length's variance is d^2 / 12, a disc's across one axis r^2 / 4.
TEST(Frustum, Cylinder) {
  const auto g = cylinder_gaussian(2.0, 2.5, 0.1);
  EXPECT_NEAR(g.t_mean, 2.25, 1e-15);
  EXPECT_NEAR(g.t_variance, 0.25 / 12, 1e-16);
  EXPECT_NEAR(g.r_variance, 0.01 / 4, 1e-16);
}

// Points drawn in the frustum itself: the Gaussian's moments are those of the drawn ones.
TEST(Frustum, MomentsByDrawing) {
  const double t0 = 1, t1 = 1.8, radius = 0.3;
  const auto g = cone_gaussian(t0, t1, radius);
  constexpr int kDraws = 200000;
  double sum = 0, square = 0, across = 0, across2 = 0;
  for (int i = 0; i < kDraws; ++i) {
    Random random(3, 1, static_cast<uint64_t>(i));
    const double u = random.uniform();
    const double t = std::cbrt(t0 * t0 * t0 + u * (t1 * t1 * t1 - t0 * t0 * t0));
    const double r = radius * t * std::sqrt(static_cast<double>(random.uniform()));
    const double x = r * std::cos(6.283185307179586 * static_cast<double>(random.uniform()));
    sum += t;
    square += t * t;
    across += x * x;
    across2 += x * x * x * x;
  }
  const double n = kDraws, mean = sum / n, variance = square / n - mean * mean;
  EXPECT_NEAR(mean, g.t_mean, 3 * std::sqrt(variance / n));
  // The fourth moment of t is at most that of its range.
  EXPECT_NEAR(variance, g.t_variance, 3 * (t1 - t0) * (t1 - t0) / 4 / std::sqrt(n));
  EXPECT_NEAR(across / n, g.r_variance, 3 * std::sqrt((across2 / n - std::pow(across / n, 2)) / n));
}

// The closed form of the expected sine and cosine of a Gaussian, against the mean over draws.
TEST(Frustum, ExpectedSinesByDrawing) {
  constexpr int kDraws = 100000;
  for (const double frequency : {1.0, 4.0})
    for (const double variance : {0.01, 0.4}) {
      const double mean = 0.7;
      double sum[2] = {0, 0}, square[2] = {0, 0};
      for (int i = 0; i < kDraws; ++i) {
        Random random(4, 2, static_cast<uint64_t>(i));
        const double a = 1 - static_cast<double>(random.uniform()), b = random.uniform();
        const double x = mean + std::sqrt(variance) * std::sqrt(-2 * std::log(a)) *
                                    std::cos(6.283185307179586 * b);
        const double f[2] = {std::sin(frequency * x), std::cos(frequency * x)};
        for (int k = 0; k < 2; ++k) {
          sum[k] += f[k];
          square[k] += f[k] * f[k];
        }
      }
      const auto want = reference::sine_cosine(mean, variance, frequency, 1.0);
      for (size_t k = 0; k < 2; ++k) {
        const double got = sum[k] / kDraws;
        const double error = std::sqrt((square[k] / kDraws - got * got) / kDraws);
        EXPECT_NEAR(got, want[k], 3 * error) << frequency << ' ' << variance << ' ' << k;
      }
    }
}

// A Gaussian through the contraction, seen along a direction (network_levels.cc).
template <class T>
std::pair<double, double> warped(const std::vector<double>& v) {
  const auto vec = [&](size_t at) {
    return TVec3<T>{static_cast<T>(v[at]), static_cast<T>(v[at + 1]), static_cast<T>(v[at + 2])};
  };
  const TVec3<T> x = vec(0), d = vec(3), p = vec(8);
  const TVec3<T> q = contraction_jacobian(x)(p);
  const T along = dot(q, d), across = dot(q, q) - along * along;
  return {
      static_cast<double>(dot(p, contract(x))),
      static_cast<double>(static_cast<T>(v[6]) * along * along + static_cast<T>(v[7]) * across)};
}

TEST(Frustum, GaussiansThroughTheContraction) {
  WorstError mean("warp_mean"), variance("warp_variance"), in_float("warp_float");
  for (const auto& v : golden_lines("sampling.txt", "warp")) {
    const auto d = warped<double>(v);
    const auto f = warped<float>(v);
    mean.compare(d.first, v[11], 1e-14, "x", v[0], v[1], v[2]);
    // Directions are unit only to a float's rounding, which both variances feel once.
    const double r = std::max(1.0, std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]));
    const double slope = 2 / r;  // of the contraction across, its largest
    const double size = (v[6] + v[7]) * slope * slope;
    variance.compare(d.second, v[12], 4 * kFloatRoundoff * size, "x", v[0], v[1], v[2]);
    in_float.compare(f.first, v[11], rounding_bound(12, kFloatRoundoff) * 2, "x", v[0], v[1], v[2]);
    in_float.compare(f.second, v[12], rounding_bound(24, kFloatRoundoff) * size, "x", v[0], v[1],
                     v[2]);
  }
  mean.report();
  variance.report();
  in_float.report();
}

}  // namespace
}  // namespace nerf
