// Places from the origin to the end of the number range: contraction, place on the hash grid, what
// a field answers there.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/math/contraction.h"
#include "nerf/math/random.h"
#include "nerf/math/reference/contraction.h"
#include "stress/stress_field.h"

namespace nerf::stress {
namespace {

std::vector<Vec3d> directions() {
  std::vector<Vec3d> out = {{1, 0, 0}, {0, -1, 0},  {0, 0, 1},
                            {1, 1, 1}, {-1, 1, -1}, {1, 1e-20, 0}};
  for (uint64_t i = 0; i < 50; ++i) {
    Random random(71, 0, i);
    out.push_back({random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5});
  }
  for (Vec3d& d : out) d = normalized(d);
  return out;
}

constexpr double kRadii[] = {0, 1e-45, 1e-38, 1e-20, 1e-5, 0.5,  1 - 1e-7, 1,    1 + 1e-7, 1 + 1e-3,
                             2, 1e3,   1e6,   1e9,   1e15, 1e18, 2e19,     1e25, 1.5e38};

// A norm (3 products, 2 sums, a root), two divisions, a difference, a product.
constexpr double kOps = 10;

TEST(StressPositions, ContractionAtEveryDistance) {
  WorstError worst("contraction");
  for (double radius : kRadii)
    for (const Vec3d& d : directions()) {
      const Vec3 x = (d * radius).cast<Real>();
      const Vec3 z = contract(x);
      const auto want = reference::contract<double>({x.x, x.y, x.z});
      for (int i = 0; i < 3; ++i) {
        const double w = want[static_cast<size_t>(i)];
        // At length 1 the branch may differ by a rounding; both agree there. A product below the
        // smallest normal number has lost digits.
        worst.compare(z[i], w, rounding_bound(kOps) * std::fabs(w) + 1e-38, "radius", radius,
                      "axis", i);
      }
      if (radius < 0.9) {
        EXPECT_EQ(z, x) << "inside nothing moves, radius " << radius;
      }
      EXPECT_LE(length(z.cast<double>()), 2 * (1 + rounding_bound(kOps))) << radius;
    }
  worst.report();
}

// In double too, where squares overflow at 1e154.
TEST(StressPositions, ContractionInDoubleKeepsDirections) {
  for (double radius : {1e6, 1e100, 1e160, 1e300})
    for (const Vec3d& d : directions()) {
      const Vec3d z = contract(d * radius);
      for (int i = 0; i < 3; ++i) EXPECT_NEAR(z[i], d[i] * (2 - 1 / radius), 1e-15) << radius;
    }
}

// On the grid's unit cube, and monotonic: farther out is never nearer to the middle.
TEST(StressPositions, PlaceOnTheGrid) {
  const auto unbounded = constant_grid({.unbounded = true}), bounded = constant_grid({});
  for (const Vec3d& d : directions()) {
    double before = 0;
    for (double radius : kRadii) {
      const Vec3 g = unbounded->grid_position((d * radius).cast<Real>());
      double from_middle = 0;
      for (int i = 0; i < 3; ++i) {
        ASSERT_TRUE(g[i] >= -4 * kRoundoff && g[i] <= 1 + 4 * kRoundoff) << radius << ' ' << g[i];
        from_middle = std::max(from_middle, std::fabs(g[i] - 0.5));
      }
      EXPECT_GE(from_middle, before - 4 * kRoundoff) << radius;
      before = from_middle;
    }
  }
  EXPECT_EQ(bounded->grid_position({0, 0, 0}), (Vec3{0.5_r, 0.5_r, 0.5_r}));
  EXPECT_EQ(bounded->grid_position({-1, 1, -1}), (Vec3{0, 1, 0}));
  EXPECT_EQ(unbounded->grid_position({0, 0, 0}), (Vec3{0.5_r, 0.5_r, 0.5_r}));
}

// Inside the outermost cascade the field's density and colour; outside no density, and a colour
// that is one, at any distance and in captures whose coordinates are large.
TEST(StressPositions, QueryAtEveryDistance) {
  for_each_target([&](const std::string&) {
    for (bool unbounded : {false, true})
      for (double offset : {0.0, 5e6}) {
        const int cascades = unbounded ? 12 : 1;
        const double half = std::ldexp(1.0, cascades - 1);
        Similarity to_engine;
        to_engine.center = {offset, -offset, 0.5 * offset};
        to_engine.scale = 0.5;
        const RadianceField field = constant_field(
            {.unbounded = unbounded, .cascades = cascades, .log_density = 1}, to_engine);
        std::vector<Vec3d> points, seen_along;
        std::vector<bool> inside;
        for (const Vec3d& d : directions())
          for (double radius : {0.0, 1e-30, 0.3, 0.999, 1.8, 1e2, 2e3, 1e6, 1e12, 1e30, 1e100}) {
            const Vec3d p = d * radius;
            points.push_back(to_engine.apply_inverse(p));
            seen_along.push_back(-d);
            const double most = std::max({std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
            inside.push_back(most < half);
          }
        std::vector<Real> density(points.size()), rgb(3 * points.size());
        ThreadPool pool(2);
        field.query(points, seen_along, density, rgb, pool);
        for (size_t i = 0; i < points.size(); ++i) {
          // exp(1) by Highway's Exp, then halved.
          EXPECT_NEAR(density[i], inside[i] ? 0.5 * std::exp(1.0) : 0.0, 8 * kRoundoff) << i;
          for (size_t k = 0; k < 3; ++k) EXPECT_EQ(rgb[3 * i + k], 0.5_r) << i;
        }
      }
  });
}

}  // namespace
}  // namespace nerf::stress
