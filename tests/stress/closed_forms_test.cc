// Volume rendering of media whose colour is known in closed form, however the ray is cut.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

#include "kernels/kernel_test.h"
#include "stress/composite_run.h"

namespace nerf::stress {
namespace {

constexpr Colour kBlack{0, 0, 0};

// Lengths of n intervals from 0 to about `length`; their sum in double is what the ray passes.
// `spread`: the decades that the intervals differ by.
std::vector<Real> cut(double length, int n, double spread, Random& random) {
  std::vector<double> parts;
  double sum = 0;
  for (int i = 0; i < n; ++i) {
    parts.push_back(std::pow(10.0, -spread * static_cast<double>(random.uniform())));
    sum += parts.back();
  }
  std::vector<Real> out;
  for (double p : parts) out.push_back(static_cast<Real>(p / sum * length));
  return out;
}

double total(const std::vector<Real>& deltas) {
  double sum = 0;
  for (Real d : deltas) sum += d;
  return sum;
}

// Light of two layers in front of the background: colour, then opacity.
std::array<double, 4> two_layers(double depth1, const Colour& c1, double depth2, const Colour& c2,
                                 const Colour& background) {
  const double t1 = std::exp(-depth1), t2 = std::exp(-depth2);
  std::array<double, 4> out;
  for (size_t k = 0; k < 3; ++k)
    out[k] = c1[k] * (1 - t1) + t1 * (c2[k] * (1 - t2) + t2 * background[k]);
  out[3] = 1 - t1 * t2;
  return out;
}

// Two homogeneous layers, among them a single one and none, each cut at random: the sums telescope.
TEST(StressClosedForm, TwoLayersCutAtRandom) {
  WorstError worst("two_layers");
  const Colour red{0.9_r, 0.2_r, 0.1_r}, blue{0.1_r, 0.3_r, 0.8_r};
  for_each_target([&](const std::string&) {
    for (const auto& [d1, d2] : {std::pair{0.0_r, 0.0_r},
                                 {0.7_r, 0.0_r},
                                 {0.5_r, 3.0_r},
                                 {8.0_r, 1.0_r},
                                 {0.01_r, 1e4_r},
                                 {1e-6_r, 1e10_r},
                                 {1e10_r, 1.0_r}})
      for (int n : {1, 3, 100, 20000})
        for (double spread : {0.0, 7.0}) {
          Random random(21, static_cast<uint64_t>(n), 0);
          const auto first = cut(0.8, n, spread, random), second = cut(1.7, n, spread, random);
          Matter m;
          for (Real d : first) m.add(d1, d, red);
          for (Real d : second) m.add(d2, d, blue);
          const auto want =
              two_layers(d1 * total(first), red, d2 * total(second), blue, m.background);
          const Rendered got = run_composite(m);
          for (size_t k = 0; k < 4; ++k)
            worst.compare(got.pixel[k], want[k], kPixelError + summing_error(2.0 * n), "densities",
                          d1, d2, "samples", n, "spread", spread, "channel", k);
        }
  });
  worst.report();
}

// A slab with empty space before and behind it, of any length, is the slab: bit for bit.
TEST(StressClosedForm, EmptySpaceAroundASlabChangesNothing) {
  for_each_target([&](const std::string&) {
    Random random(22, 0, 0);
    const auto lengths = cut(1, 50, 2, random);
    Matter slab;
    for (Real d : lengths) slab.add(1.5_r, d, {0.3_r, 0.6_r, 0.2_r});
    const Rendered alone = run_composite(slab);
    const double left = std::exp(-1.5 * total(lengths));
    for (size_t k = 0; k < 3; ++k)
      EXPECT_NEAR(alone.pixel[k], (1 - left) * slab.colour[0][k] + left * slab.background[k],
                  kPixelError);
    for (Real empty : {1e-7_r, 1.0_r, 1e7_r}) {
      Matter m;
      for (int i = 0; i < 20; ++i) m.add(0, empty, {1, 1, 1});
      for (Real d : lengths) m.add(1.5_r, d, {0.3_r, 0.6_r, 0.2_r});
      for (int i = 0; i < 20; ++i) m.add(0, empty, {1, 1, 1});
      const Rendered got = run_composite(m);
      EXPECT_EQ(got.pixel, alone.pixel) << empty;
    }
  });
}

// Matter that only absorbs dims a surface behind it by its transmittance, and the transmittance of
// an interval is the product of its parts', wherever it is cut.
TEST(StressClosedForm, AbsorptionIsMultiplicativeOverAnySplit) {
  WorstError product("product_of_parts"), surface("surface_behind");
  const Colour wall{0.9_r, 0.5_r, 0.05_r};
  for_each_target([&](const std::string&) {
    for (uint64_t i = 0; i < 60; ++i) {
      Random random(23, 0, i);
      const int n = 2 + static_cast<int>(random.below(300));
      Matter all;
      double depth = 0;
      for (int s = 0; s < n; ++s) {
        all.add(static_cast<Real>(std::pow(10.0, uniform(random, -4, 1.5))),
                static_cast<Real>(std::pow(10.0, uniform(random, -4, -1))), kBlack);
        depth += double{all.density.back()} * double{all.delta.back()};
      }
      const double whole = 1 - run_composite(all).pixel[3];
      const size_t split = 1 + random.below(static_cast<uint64_t>(n - 1));
      Matter front, back;
      for (size_t s = 0; s < all.size(); ++s)
        (s < split ? front : back).add(all.density[s], all.delta[s], kBlack);
      const double parts = (1 - run_composite(front).pixel[3]) * (1 - run_composite(back).pixel[3]);
      // Three opacities, each within kPixelError, times factors of at most 1.
      product.compare(whole, parts, 3 * kPixelError, "ray", i, "split", split, "of", n);

      all.add(1e10_r, 1, wall);
      const Rendered behind = run_composite(all);
      for (size_t k = 0; k < 3; ++k)
        surface.compare(behind.pixel[k], std::exp(-depth) * wall[k], kPixelError, "ray", i,
                        "channel", k);
    }
  });
  product.report();
  surface.report();
}

// Light passes as much of a medium backwards as forwards; what is seen differs.
TEST(StressClosedForm, OpacityIsTheSameFromBothSides) {
  WorstError worst("reversed");
  for_each_target([&](const std::string&) {
    for (uint64_t i = 0; i < 40; ++i) {
      Random random(24, 0, i);
      Matter m, reversed;
      for (int s = 0; s < 200; ++s)
        m.add(static_cast<Real>(std::pow(10.0, uniform(random, -6, 2))),
              static_cast<Real>(std::pow(10.0, uniform(random, -6, -2))), {random.uniform(), 0, 1});
      for (size_t s = m.size(); s-- > 0;) reversed.add(m.density[s], m.delta[s], m.colour[s]);
      worst.compare(run_composite(m).pixel[3], run_composite(reversed).pixel[3], 2 * kPixelError,
                    "ray", i);
    }
  });
  worst.report();
}

// A medium of density d(x) on [0, length] cut into n equal intervals, asked at their middles.
Matter midpoints(const std::function<double(double)>& d, double length, int n) {
  Matter m;
  for (int i = 0; i < n; ++i)
    m.add(static_cast<Real>(d((i + 0.5) * length / n)), static_cast<Real>(length / n),
          {0.8_r, 0.3_r, 0.5_r});
  return m;
}

// The midpoint rule is off by at most length^3 / (24 n^2) max |d''| in optical depth, and each
// sample's density and length are rounded: 2 u of it. One colour everywhere: the pixel depends on
// depth alone, and moves by at most exp(-depth) <= 1 times its error.
template <class Density, class Depth>
void compare_medium(const char* name, const Density& d, const Depth& depth, double second_most) {
  WorstError worst(name);
  for_each_target([&](const std::string&) {
    for (double length : {1e-3, 1.0, 4.0, 30.0})
      for (int n : {1, 8, 64, 1000, 30000}) {
        const Matter m = midpoints(d, length, n);
        const double exact = depth(length), left = std::exp(-exact);
        const double rule = length * length * length / (24.0 * n * n) * second_most;
        // Past a depth of about 1 both are small; below it, exact - rule is what it may be.
        const double moved = std::exp(-std::max(0.0, exact - rule)) - std::exp(-exact - rule) +
                             2 * kRoundoff;  // 2 u depth exp(-depth) < 2 u
        const Rendered got = run_composite(m);
        worst.compare(got.pixel[3], 1 - left, moved + kPixelError, "length", length, "samples", n);
        for (size_t k = 0; k < 3; ++k)
          worst.compare(got.pixel[k], (1 - left) * m.colour[0][k] + left * m.background[k],
                        moved + kPixelError, "length", length, "samples", n, "channel", k);
      }
  });
  worst.report();
}

// Air above ground: density a exp(-x / h), depth a h (1 - exp(-x / h)), d'' = a / h^2 exp(-x / h).
TEST(StressClosedForm, ExponentialMedium) {
  for (const auto& [a, h] : {std::pair{2.0, 0.5}, {0.1, 3.0}, {40.0, 0.1}})
    compare_medium(("exponential_" + std::to_string(static_cast<int>(a * 10))).c_str(),
                   [a = a, h = h](double x) { return a * std::exp(-x / h); },
                   [a = a, h = h](double x) { return -a * h * std::expm1(-x / h); }, a / (h * h));
}

// A ball of mist: density a exp(-(x - 1)^2 / 2 s^2), |d''| <= a / s^2.
TEST(StressClosedForm, GaussianMedium) {
  const double a = 1.7, s = 0.6, root = s * std::sqrt(2.0), pi = std::acos(-1.0);
  compare_medium(
      "gaussian", [=](double x) { return a * std::exp(-0.5 * std::pow((x - 1) / s, 2)); },
      [=](double x) {
        return a * s * std::sqrt(pi / 2) * (std::erf((x - 1) / root) - std::erf(-1 / root));
      },
      a / (s * s));
}

// The rule's order: twice the samples, a quarter of the error, as far as float can tell.
TEST(StressClosedForm, ErrorFallsWithTheSquareOfTheSamples) {
  for_each_target([&](const std::string&) {
    const auto d = [](double x) { return 2 * std::exp(-x / 0.5); };
    const double exact = std::exp(-(1 - std::exp(-4.0)));
    const auto error = [&](int n) {
      return std::fabs(1 - run_composite(midpoints(d, 2, n)).pixel[3] - exact);
    };
    for (int n : {8, 16, 32}) {
      const double ratio = error(n) / error(2 * n);
      EXPECT_GT(ratio, 3.8) << n;
      EXPECT_LT(ratio, 4.2) << n;
    }
  });
}

}  // namespace
}  // namespace nerf::stress
