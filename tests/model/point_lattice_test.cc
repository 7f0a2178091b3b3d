// Interpolation between the corners of a lattice around points.
#include "model/point_lattice.h"

#include <gtest/gtest.h>

#include <array>
#include <set>
#include <vector>

#include "math/worst_error.h"
#include "nerf/math/random.h"

namespace nerf {
namespace {

std::vector<Vec3d> points_in(const Vec3d& corner, double width, size_t n) {
  std::vector<Vec3d> points(n);
  for (size_t i = 0; i < n; ++i) {
    Random random(5, 0, i);
    for (int k = 0; k < 3; ++k)
      points[i][k] = corner[k] + width * static_cast<double>(random.uniform());
  }
  return points;
}

TEST(PointLattice, IsExactForWhatIsLinearAlongEachAxis) {
  const auto points = points_in({-0.3, -0.1, 0.2}, 0.5, 700);
  internal::PointLattice lattice;
  ASSERT_TRUE(lattice.surround(points, 0.125_r));
  const auto value = [](const Vec3d& p) {
    return Vec3{static_cast<Real>(1 + 2 * p.x - p.y), static_cast<Real>(p.x * p.y * p.z),
                static_cast<Real>(p.z * p.x - 3 * p.y)};
  };
  std::vector<Vec3> of_corners;
  for (const Vec3d& c : lattice.corners()) of_corners.push_back(value(c));
  for (size_t i = 0; i < points.size(); ++i) {
    const Vec3 found = lattice.at(i, of_corners), truth = value(points[i]);
    // Eight products whose weights are the points' places in units of 1/8, up to 6 of these away.
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(found[k], truth[k], 100 * kRoundoff) << i;
  }
}

TEST(PointLattice, SharesCornersAndHasNoneTwice) {
  internal::PointLattice lattice;
  // Four cubes in a row have 20 corners.
  ASSERT_TRUE(lattice.surround(points_in({0, 0, 0}, 0.25, 400), 0.25_r));
  EXPECT_EQ(lattice.corners().size(), 8u);
  std::vector<Vec3d> row;
  for (int i = 0; i < 64; ++i) row.push_back({-0.5 + (i + 0.5) / 64, 0.01, 0.02});
  ASSERT_TRUE(lattice.surround(row, 0.25_r));
  EXPECT_EQ(lattice.corners().size(), 20u);
  std::set<std::array<double, 3>> different;
  for (const Vec3d& c : lattice.corners()) different.insert({c.x, c.y, c.z});
  EXPECT_EQ(different.size(), 20u);
}

TEST(PointLattice, IsNoneWhereCornersAreNotFewerThanPoints) {
  internal::PointLattice lattice;
  EXPECT_FALSE(lattice.surround({}, 0.1_r));
  EXPECT_FALSE(lattice.surround(points_in({0, 0, 0}, 1, 8), 0.01_r));
  EXPECT_FALSE(lattice.surround(points_in({0, 0, 0}, 0.1, 8), 0.1_r));
  EXPECT_TRUE(lattice.surround(points_in({0, 0, 0}, 0.1, 9), 0.1_r));
}

}  // namespace
}  // namespace nerf
