#include "math/polynomial.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace nerf::internal {
namespace {

Polynomial<8> make(std::initializer_list<double> coefficients) {
  Polynomial<8> p;
  for (double c : coefficients) p.c[p.size++] = c;
  return p;
}

double at(const Polynomial<8>& p, double x) {
  double y = 0;
  for (size_t i = p.size; i-- > 0;) y = y * x + p.c[i];
  return y;
}

TEST(Polynomial, PositiveOnAgreesWithDenseSampling) {
  // Coefficients from a fixed sequence of pseudo-random steps; a root that dense sampling cannot
  // tell from a near miss is skipped.
  unsigned state = 1;
  const auto next = [&] {
    state = state * 1664525u + 1013904223u;
    return static_cast<double>(state >> 8) / (1 << 24) * 2 - 1;
  };
  int positive = 0, negative = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    Polynomial<8> p = make({1});
    const int degree = 1 + trial % 7;
    for (int i = 1; i <= degree; ++i) p.c[p.size++] = 3 * next();
    const double end = 0.2 + 2 * std::abs(next());
    double lowest = 1e9;
    for (int i = 0; i <= 4000; ++i) lowest = std::min(lowest, at(p, end * i / 4000));
    if (std::abs(lowest) < 1e-4) continue;
    EXPECT_EQ(positive_on(p, end), lowest > 0) << "trial " << trial << " lowest " << lowest;
    ++(lowest > 0 ? positive : negative);
  }
  EXPECT_GT(positive, 500);
  EXPECT_GT(negative, 500);
}

TEST(Polynomial, PositiveOnHandlesItsBorders) {
  EXPECT_TRUE(positive_on(make({1}), 5));
  EXPECT_FALSE(positive_on(make({0}), 5));
  EXPECT_FALSE(positive_on(make({}), 5));
  EXPECT_TRUE(positive_on(make({1, -1}), 0.999));
  EXPECT_FALSE(positive_on(make({1, -1}), 1));
  EXPECT_TRUE(positive_on(make({1, -1}), 0));
  EXPECT_FALSE(positive_on(make({1, -2, 1}), 2));        // touches zero
  EXPECT_TRUE(positive_on(make({1.000001, -2, 1}), 2));  // just does not
  EXPECT_FALSE(positive_on(make({1, std::nan("")}), 1));
}

TEST(Polynomial, ProductAndDerivative) {
  const auto product = multiply<15>(make({1, 2}), make({3, 0, -1}));  // 3 + 6 x - x^2 - 2 x^3
  ASSERT_EQ(product.size, 4u);
  EXPECT_EQ(product.c[0], 3);
  EXPECT_EQ(product.c[1], 6);
  EXPECT_EQ(product.c[2], -1);
  EXPECT_EQ(product.c[3], -2);
  const auto slope = times_x_derivative(make({7, 2, 5}));
  EXPECT_EQ(slope.c[0], 0);
  EXPECT_EQ(slope.c[1], 2);
  EXPECT_EQ(slope.c[2], 10);
}

}  // namespace
}  // namespace nerf::internal
