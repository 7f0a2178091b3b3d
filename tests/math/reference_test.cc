// The reference templates against independent formulas, and their gradients against complex step.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "golden/golden.h"
#include "math/complex_step.h"
#include "math/template_error.h"
#include "math/worst_error.h"
#include "nerf/math/random.h"
#include "nerf/math/reference/activations.h"
#include "nerf/math/reference/adam.h"
#include "nerf/math/reference/contraction.h"
#include "nerf/math/reference/hash_grid.h"
#include "nerf/math/reference/huber.h"
#include "nerf/math/reference/linear.h"
#include "nerf/math/reference/pixel_losses.h"
#include "nerf/math/reference/spherical_harmonics.h"
#include "nerf/math/reference/volume_rendering.h"

namespace nerf {
namespace {

namespace ref = reference;
using test::kExact;
using test::tolerance;

std::vector<double> draw(size_t n, double low, double high, uint64_t key) {
  Random random(91, key, 0);
  std::vector<double> out(n);
  for (double& v : out) v = low + (high - low) * static_cast<double>(random.uniform());
  return out;
}

template <class T>
std::vector<std::array<T, 3>> triples(const std::vector<T>& flat, size_t at, size_t n) {
  std::vector<std::array<T, 3>> out(n);
  for (size_t i = 0; i < n; ++i)
    for (size_t k = 0; k < 3; ++k) out[i][k] = flat[at + 3 * i + k];
  return out;
}

TEST(Reference, TruncatedExpHasItsDocumentedSlope) {
  for (double x : {-1000.0, -15.0 - 1e-9, -15.0, -15.0 + 1e-9, -3.0, 0.0, 2.5, 15.0 - 1e-9, 15.0,
                   15.0 + 1e-9, 29.0, 30.0, 30.0 + 1e-9, 80.0}) {
    const double slope = std::exp(std::max(-15.0, std::min(15.0, x)));
    const auto y = ref::truncated_exp(Complex(x, kComplexStep));
    EXPECT_NEAR(y.imag() / kComplexStep, slope, kExact * slope) << x;
    EXPECT_DOUBLE_EQ(y.real(), std::exp(std::min(x, 30.0))) << x;
    EXPECT_DOUBLE_EQ(ref::truncated_exp_slope(x), slope) << x;
    EXPECT_DOUBLE_EQ(ref::truncated_exp(ref::Dual(x, 1)).derivative, slope) << x;
  }
}

TEST(Reference, SigmoidSlope) {
  for (double x : {-700.0, -40.0, -1.0, 0.0, 1e-3, 3.0, 40.0, 700.0}) {
    const auto y = ref::sigmoid(Complex(x, kComplexStep));
    EXPECT_NEAR(y.imag() / kComplexStep, ref::sigmoid_slope(y.real()), kExact) << x;
    EXPECT_NEAR(y.real() + ref::sigmoid(-x), 1.0, kExact) << x;
  }
  EXPECT_EQ(ref::sigmoid(-800.0), 0.0);
  EXPECT_EQ(ref::sigmoid(800.0), 1.0);
}

TEST(Reference, ReluPassesNothingAtAndBelowZero) {
  for (double x : {-1.0, -1e-300, 0.0}) {
    EXPECT_EQ(ref::relu(Complex(x, kComplexStep)), Complex(0)) << x;
  }
  EXPECT_EQ(ref::relu(Complex(1e-300, kComplexStep)), Complex(1e-300, kComplexStep));
}

TEST(Reference, HuberIsContinuousAndHasItsSlope) {
  const double delta = 0.1;
  for (double side : {-1.0, 1.0}) {
    EXPECT_NEAR(ref::huber(side * (delta - 1e-12), delta),
                ref::huber(side * (delta + 1e-12), delta), 1e-12);
    for (double a : {0.0, 0.05, delta - 1e-9, delta + 1e-9, 0.7, 30.0}) {
      const double e = side * a;
      const double slope = ref::huber(Complex(e, kComplexStep), delta).imag() / kComplexStep;
      EXPECT_NEAR(slope, ref::huber_slope(e, delta), kExact) << e;
    }
  }
  EXPECT_DOUBLE_EQ(ref::huber(0.03, delta), 0.0009);
  EXPECT_DOUBLE_EQ(ref::huber(-0.5, delta), 0.1 * (2 * 0.5 - 0.1));
}

// loss = sum_j c_j y_j of a layer of 5 inputs and 4 outputs.
TEST(Reference, PixelLossesHaveTheirSlopes) {
  for (const double e : {-3.0, -1e-4, 0.0, 1e-9, 0.2, 50.0}) {
    EXPECT_DOUBLE_EQ(ref::squared(Complex(e, kComplexStep)).imag() / kComplexStep,
                     ref::squared_slope(e));
    for (const double epsilon : {1e-3, 0.5}) {
      const Complex y = ref::charbonnier(Complex(e, kComplexStep), epsilon);
      EXPECT_DOUBLE_EQ(y.real(), std::hypot(e, epsilon));
      EXPECT_NEAR(y.imag() / kComplexStep, ref::charbonnier_slope(e, epsilon), kExact);
    }
  }
  EXPECT_EQ(ref::charbonnier_slope(0.0, 0.0), 0);
  const auto f = [](double e) { return ref::squared(e); };
  EXPECT_DOUBLE_EQ(ref::pixel_loss<double>({1, 2, 3, 9},
                                           {
                                               0,
                                               4,
                                               2,
                                           },
                                           0.5, f),
                   0.5 * (1 + 4 + 1));
}

// Both halves of compositing, and accumulation in two steps, are the whole.
TEST(Reference, AccumulationInStepsIsComposite) {
  const size_t n = 20;
  const auto density = draw(n, 0, 8, 21), delta = draw(n, 0.01, 0.3, 22);
  const auto colour = triples(draw(3 * n, 0, 1, 23), 0, n);
  const std::array<double, 3> background{0.2, 0.9, 0.4};
  const auto whole = ref::composite(density, colour, delta, background);
  const auto pixel =
      ref::accumulate(ref::render_weights(density, delta, false), colour, background);
  std::vector<std::vector<double>> columns;
  for (const auto& c : colour) columns.emplace_back(c.begin(), c.end());
  const auto sums = ref::sum_along_ray(whole.weights, columns, 3);
  ASSERT_EQ(sums.size(), 4u);
  const double a = sums[3];
  const auto over = ref::over({sums[0] / a, sums[1] / a, sums[2] / a}, a, background);
  for (size_t k = 0; k < 4; ++k) {
    EXPECT_NEAR(pixel[k], whole.pixel[k], kExact) << k;
    EXPECT_NEAR(over[k], whole.pixel[k], kExact) << k;
  }
}

TEST(Reference, LinearBackwardIsTheComplexStep) {
  const size_t in = 5, out = 4;
  const std::vector<double> all = draw(in * out + out + in, -1, 1, 1), c = draw(out, -1, 1, 2);
  for (bool relu : {false, true}) {
    const auto split = [&](const auto& v) {
      const auto at = v.begin();
      using V = std::decay_t<decltype(v)>;
      return std::array<V, 3>{V(at, at + in * out), V(at + in * out, at + in * out + out),
                              V(at + in * out + out, v.end())};
    };
    const auto loss = [&](const std::vector<Complex>& v) {
      const auto [w, b, x] = split(v);
      const auto y = ref::linear(w, b, x, out, relu);
      Complex sum = 0;
      for (size_t j = 0; j < out; ++j) sum += c[j] * y[j];
      return sum;
    };
    const auto [w, b, x] = split(all);
    const auto y = ref::linear(w, b, x, out, relu);
    std::vector<double> dx, dw(w.size()), db(out);
    ref::linear_backward(w, x, y, c, relu, dx, dw, db);
    std::vector<double> analytic = dw;
    analytic.insert(analytic.end(), db.begin(), db.end());
    analytic.insert(analytic.end(), dx.begin(), dx.end());
    const std::vector<double> truth = complex_step_gradient(loss, all);
    WorstError worst(relu ? "linear_relu" : "linear");
    for (size_t i = 0; i < all.size(); ++i)
      worst.compare(analytic[i], truth[i], tolerance(truth[i]), "parameter", i);
    worst.report();
  }
}

TEST(Reference, CompositeBackwardIsTheComplexStepAndTheDual) {
  const size_t n = 7;
  std::vector<double> x = draw(4 * n, 0, 1, 3);
  for (size_t i = 0; i < n; ++i) x[i] *= 8;  // densities
  x[2] = 1e-9;
  x[4] = 200;  // nearly opaque: what follows is dark
  const std::vector<double> delta = draw(n, 0.01, 0.4, 4);
  const std::array<double, 3> background{0.2, 0.9, 0.5};
  const std::array<double, 4> g{0.7, -1.3, 0.4, 0.8};
  const auto loss = [&]<class T>(const std::vector<T>& v) {
    const std::array<T, 3> b{background[0], background[1], background[2]};
    const auto ray = ref::composite(std::vector<T>(v.begin(), v.begin() + n), triples(v, n, n),
                                    std::vector<T>(delta.begin(), delta.end()), b);
    T sum(0);
    for (size_t k = 0; k < 4; ++k) sum += T(g[k]) * ray.pixel[k];
    return sum;
  };
  std::vector<double> d_density;
  std::vector<std::array<double, 3>> d_colour;
  ref::composite_backward(std::vector<double>(x.begin(), x.begin() + n), triples(x, n, n), delta,
                          background, g, d_density, d_colour);
  const std::vector<double> truth = complex_step_gradient(loss, x);
  WorstError worst("composite"), dual("composite_dual");
  for (size_t i = 0; i < x.size(); ++i) {
    const double analytic = i < n ? d_density[i] : d_colour[(i - n) / 3][(i - n) % 3];
    worst.compare(analytic, truth[i], tolerance(truth[i]), "input", i);
    std::vector<ref::Dual> d(x.begin(), x.end());
    d[i].derivative = 1;
    dual.compare(loss(d).derivative, truth[i], tolerance(truth[i]), "input", i);
  }
  worst.report();
  dual.report();
}

// Five samples by hand: alpha 1/2 each halves the light, so the weights are 1/2, 1/4, ..., 1/32.
TEST(Reference, CompositeByHand) {
  const std::vector<double> density(5, std::log(2.0)), delta(5, 1.0);
  const std::vector<std::array<double, 3>> colour(5, {1, 0.5, 0});
  const auto ray = ref::composite(density, colour, delta, {0, 0, 1});
  for (size_t i = 0; i < 5; ++i)
    EXPECT_NEAR(ray.weights[i], std::ldexp(1.0, -1 - static_cast<int>(i)), 1e-15);
  EXPECT_NEAR(ray.pixel[0], 31.0 / 32, 1e-15);
  EXPECT_NEAR(ray.pixel[1], 31.0 / 64, 1e-15);
  EXPECT_NEAR(ray.pixel[2], 1.0 / 32, 1e-15);
  EXPECT_NEAR(ray.pixel[3], 31.0 / 32, 1e-15);
}

TEST(Reference, GridBackwardIsTheComplexStep) {
  const ref::GridLevel dense{3.0, 5, 128, true}, hashed{40.0, 42, 64, false};
  for (const ref::GridLevel& level : {dense, hashed}) {
    const std::vector<double> table = draw(4 * level.entries, -1, 1, 5);
    const std::array<double, 3> p{0.37, 0.81, 0.12};
    const std::vector<double> g{0.3, -0.8, 1.1, 0.6};
    std::vector<double> analytic(table.size());
    ref::grid_interpolate_backward(level, p, g, analytic);
    const auto loss = [&](const std::vector<Complex>& t) {
      const std::array<Complex, 3> at{p[0], p[1], p[2]};
      const auto f = ref::grid_interpolate(level, t, at);
      return g[0] * f[0] + g[1] * f[1] + g[2] * f[2] + g[3] * f[3];
    };
    const std::vector<double> truth = complex_step_gradient(loss, table);
    WorstError worst(level.dense ? "dense" : "hashed");
    for (size_t i = 0; i < table.size(); ++i)
      worst.compare(analytic[i], truth[i], tolerance(truth[i]), "entry", i);
    worst.report();
  }
}

TEST(Reference, GridPositionBackwardIsTheComplexStep) {
  const ref::GridLevel dense{3.0, 5, 128, true}, hashed{40.0, 42, 64, false, 2};
  const std::vector<double> all = {0.8, -1.1, 0.3, 0.6};
  // In a cell, at a vertex of the dense level, and clamped or at the border along some axes.
  const std::vector<double> places[] = {
      {0.37, 0.81, 0.12}, {1.0 / 6, 0.5, 5.0 / 6}, {-0.2, 0.3, 1.7}, {0.0, 1.0, 0.4}};
  WorstError worst("slope");
  for (const ref::GridLevel& level : {dense, hashed}) {
    const std::vector<double> table = draw(level.features * level.entries, -1, 1, 7);
    const std::vector<double> g(all.begin(), all.begin() + static_cast<int>(level.features));
    for (const std::vector<double>& p : places) {
      const auto loss = [&](const std::vector<Complex>& at) {
        const auto f =
            ref::grid_interpolate<Complex>(level, to_complex(table), {at[0], at[1], at[2]});
        Complex sum = 0;
        for (size_t i = 0; i < g.size(); ++i) sum += g[i] * f[i];
        return sum;
      };
      const auto got = ref::grid_position_backward<double>(level, table, {p[0], p[1], p[2]}, g);
      const std::vector<double> want = complex_step_gradient(loss, p);
      for (size_t i = 0; i < 3; ++i) {
        worst.compare(got[i], want[i], tolerance(want[i]), "place", p[0], p[1], p[2], "axis", i);
        if (p[i] <= 0 || p[i] >= 1) {
          EXPECT_EQ(got[i], 0);
        } else {
          EXPECT_NE(got[i], 0);
        }
      }
    }
  }
  worst.report();
}

// A table that holds a linear function of its vertices' places is interpolated exactly, and its
// slope is that function's.
TEST(Reference, GridInterpolatesLinearFunctions) {
  const ref::GridLevel level{5.0, 7, 344, true};
  std::vector<double> table(4 * level.entries);
  for (uint32_t z = 0; z < 7; ++z)
    for (uint32_t y = 0; y < 7; ++y)
      for (uint32_t x = 0; x < 7; ++x)
        table[4 * ref::grid_row(level, x, y, z)] = 2.0 * x - 3.0 * y + 0.5 * z + 7;
  const std::vector<double> places = draw(60, 0, 1, 6);
  for (size_t i = 0; i + 2 < places.size(); i += 3) {
    const std::array<double, 3> p{places[i], places[i + 1], places[i + 2]};
    const double want = 7 + 2 * (5 * p[0] + 0.5) - 3 * (5 * p[1] + 0.5) + 0.5 * (5 * p[2] + 0.5);
    EXPECT_NEAR(ref::grid_interpolate(level, table, p)[0], want, 1e-12);
    const auto slope = ref::grid_position_backward<double>(level, table, p, {1, 0, 0, 0});
    EXPECT_NEAR(slope[0], 2 * 5, 1e-12);
    EXPECT_NEAR(slope[1], -3 * 5, 1e-12);
    EXPECT_NEAR(slope[2], 0.5 * 5, 1e-12);
  }
}

TEST(Reference, GridMatchesGoldenCorners) {
  for (const std::vector<double>& v : golden_lines("encodings.txt", "corners")) {
    ASSERT_EQ(v.size(), 7u + 16u);
    const ref::GridLevel level{v[0], static_cast<uint32_t>(v[1]), static_cast<uint32_t>(v[2]),
                               v[3] != 0};
    const auto corners = ref::grid_corners<double>(level, {v[4], v[5], v[6]});
    double sum = 0;
    for (size_t c = 0; c < 8; ++c) {
      EXPECT_EQ(corners[c].row, static_cast<uint32_t>(v[7 + c]));
      EXPECT_DOUBLE_EQ(corners[c].weight, v[15 + c]);
      EXPECT_LT(corners[c].row, level.entries);
      sum += corners[c].weight;
    }
    EXPECT_DOUBLE_EQ(sum, 1.0);
  }
}

TEST(Reference, SphericalHarmonicsMatchLegendreFunctions) {
  WorstError worst("harmonics"), single("harmonics_float");
  for (const std::vector<double>& v : golden_lines("encodings.txt", "harmonics")) {
    ASSERT_EQ(v.size(), 3u + 16u);
    const auto y = ref::spherical_harmonics(v[0], v[1], v[2]);
    const auto f = ref::spherical_harmonics(static_cast<float>(v[0]), static_cast<float>(v[1]),
                                            static_cast<float>(v[2]));
    for (size_t i = 0; i < 16; ++i) {
      worst.compare(y[i], v[3 + i], 1e-13, "direction", v[0], v[1], v[2], "value", i);
      single.compare(f[i], v[3 + i], 1e-6, "direction", v[0], v[1], v[2], "value", i);
    }
  }
  worst.report();
  single.report();
}

// The first step of Adam goes by the rate, whatever the gradient's size; m_hat = g, v_hat = g^2.
TEST(Reference, AdamByHand) {
  const ref::AdamOptions o{.rate = 0.01, .beta1 = 0.9, .beta2 = 0.99, .epsilon = 0, .l2 = 0};
  for (double g : {1e-8, -3.0, 1e6}) {
    double m = 0, v = 0, w = 2;
    ref::adam(o, 1, g, m, v, w);
    EXPECT_NEAR(w, 2 - 0.01 * (g > 0 ? 1 : -1), 1e-12);
  }
  // Second step, gradients 1 then 3: m_hat = (0.09 + 0.3) / 0.19, v_hat = (0.0099 + 0.09) / 0.0199.
  double m = 0, v = 0, w = 0;
  ref::adam(o, 1, 1.0, m, v, w);
  ref::adam(o, 2, 3.0, m, v, w);
  EXPECT_NEAR(w, -0.01 - 0.01 * (0.39 / 0.19) / std::sqrt(0.0999 / 0.0199), 1e-12);
  // Decay alone: g = l2 w.
  const ref::AdamOptions decay{.rate = 0.1, .beta1 = 0.9, .beta2 = 0.99, .epsilon = 1, .l2 = 0.5};
  m = v = 0, w = 4;
  ref::adam(decay, 1, 0.0, m, v, w);
  EXPECT_NEAR(w, 4 - 0.1 * 2 / (2 + 1), 1e-12);
  // An untouched row stands still.
  int64_t steps = 3;
  double g = 5, rm = 1, rv = 2, rw = 3;
  ref::adam_row(o, false, 1, &g, &rm, &rv, steps, &rw);
  EXPECT_EQ(steps, 3);
  EXPECT_EQ(rm, 1);
  EXPECT_EQ(rv, 2);
  EXPECT_EQ(rw, 3);
  ref::adam_row(o, true, 1, &g, &rm, &rv, steps, &rw);
  EXPECT_EQ(steps, 4);
  EXPECT_NE(rw, 3);
}

// The Jacobian of the contraction at radius r: 1/r^2 along the ray, (2 - 1/r)/r across it.
TEST(Reference, ContractionJacobian) {
  const std::vector<double> x{2.0, 1.0, -2.0};  // r = 3
  for (size_t k = 0; k < 3; ++k) {
    const auto f = [&](const std::vector<Complex>& v) {
      return ref::contract<Complex>({v[0], v[1], v[2]})[k];
    };
    for (size_t i = 0; i < 3; ++i) {
      const double along = x[k] * x[i] / 9, across = (k == i ? 1 : 0) - along;
      const double want = along / 9 + across * (2 - 1.0 / 3) / 3;
      EXPECT_NEAR(complex_step(f, x, i), want, kExact);
      std::array<ref::Dual, 3> d{x[0], x[1], x[2]};
      d[i].derivative = 1;
      EXPECT_NEAR(ref::contract(d)[k].derivative, want, kExact);
    }
  }
}

}  // namespace
}  // namespace nerf
