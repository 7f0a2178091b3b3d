#include "nerf/math/cone_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "golden/golden.h"
#include "math/worst_error.h"

namespace nerf {
namespace {

// Means and variances of the points, along the ray and along two axes across it, against those of
// the frustum that tests/golden/sampling.py integrated in float64.
TEST(ConePoints, HaveTheMomentsOfTheFrustum) {
  // Sums of six and their squares, of numbers up to the distance: the variance along the ray is a
  // difference of squares of those.
  constexpr double kRoundings = 200 * 0x1p-53;
  WorstError worst("cone_points");
  int lines = 0;
  for (const auto& v : golden_lines("sampling.txt", "cone")) {
    const double middle = 0.5 * (v[0] + v[1]), half = 0.5 * (v[1] - v[0]), radius = v[2];
    if (!(middle > 0)) continue;
    ++lines;
    for (const bool reversed : {false, true})
      for (const double turn : {0.0, 0.3, 2.0}) {
        double along = 0, square = 0, across[2] = {0, 0}, squares[2] = {0, 0};
        const auto points =
            cone_points(middle, half, radius, reversed, std::cos(turn), std::sin(turn));
        for (const auto& p : points) {
          EXPECT_NEAR(p.cosine * p.cosine + p.sine * p.sine, 1, 1e-15);
          along += p.along / kConePoints;
          across[0] += p.across * p.cosine / kConePoints;
          across[1] += p.across * p.sine / kConePoints;
          squares[0] += p.across * p.cosine * p.across * p.cosine / kConePoints;
          squares[1] += p.across * p.sine * p.across * p.sine / kConePoints;
        }
        for (const auto& p : points) square += (p.along - along) * (p.along - along) / kConePoints;
        const double width = radius * v[1];
        worst.compare(middle + along, v[3], kRoundings * v[3], "t0", v[0], "t1", v[1], "mean", 0);
        worst.compare(square, v[4], kRoundings * (v[4] + half * half), "t0", v[0], "t1", v[1],
                      "variance", 0);
        for (int i = 0; i < 2; ++i) {
          worst.compare(across[i], 0, kRoundings * width, "t0", v[0], "t1", v[1], "across", i);
          // The sum over both axes is exact; which of them has more depends on the turn.
          worst.compare(squares[0] + squares[1], 2 * v[5], kRoundings * width * width, "t0", v[0],
                        "t1", v[1], "square", i);
        }
      }
  }
  EXPECT_GT(lines, 5);
  worst.report();
}

TEST(ConePoints, WindOneWayOrTheOther) {
  const auto one = cone_points(2.0, 0.5, 0.1, false, 1.0, 0.0);
  const auto other = cone_points(2.0, 0.5, 0.1, true, 1.0, 0.0);
  for (size_t j = 0; j < kConePoints; ++j) {
    EXPECT_EQ(one[j].along, other[j].along);
    EXPECT_EQ(one[j].cosine, other[kConePoints - 1 - j].cosine);
    EXPECT_EQ(one[j].sine, other[kConePoints - 1 - j].sine);
    if (j > 0) {
      EXPECT_GT(one[j].along, one[j - 1].along);
    }
  }
  // Six different directions.
  for (size_t i = 0; i < kConePoints; ++i)
    for (size_t j = 0; j < i; ++j)
      EXPECT_GT(std::fabs(one[i].cosine - one[j].cosine) + std::fabs(one[i].sine - one[j].sine),
                0.5);
}

// Far from the camera and without length nothing overflows.
TEST(ConePoints, StayFiniteAtTheEdges) {
  for (const float distance : {1e-20f, 1.0f, 1e18f})
    for (const float share : {0.0f, 1e-7f, 1.0f})
      for (const auto& p : cone_points(distance, share * distance, 1e-3f, false, 1.0f, 0.0f)) {
        EXPECT_TRUE(std::isfinite(p.along) && std::isfinite(p.across));
        EXPECT_LE(std::fabs(p.along), 1.5f * share * distance);
      }
}

}  // namespace
}  // namespace nerf
