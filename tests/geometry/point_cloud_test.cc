#include "nerf/geometry/point_cloud.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/shapes.h"

namespace nerf {
namespace {

PointOptions options_of(int64_t points) {
  PointOptions o;
  o.points = points;
  o.box = {{-1, -1, -1}, {1, 1, 1}};
  return o;
}

TEST(PointsFromDepths, StandOnASphereWithItsNormals) {
  ThreadPool pool(2);
  const TriangleMesh cloud = points_from_depths(test::sphere_views(), options_of(8000), pool);
  EXPECT_GT(cloud.positions.size(), 5000u);
  EXPECT_LT(cloud.positions.size(), 12000u);
  double off = 0, turned = 0;
  for (size_t i = 0; i < cloud.positions.size(); ++i) {
    const Vec3d p = cloud.positions[i].cast<double>();
    off += std::fabs(length(p) - test::kShapeRadius);
    turned += std::acos(std::min(1.0, dot(normalized(p), cloud.normals[i].cast<double>())));
  }
  const double n = static_cast<double>(cloud.positions.size());
  EXPECT_LT(off / n, 0.001);
  EXPECT_LT(turned / n, 0.02);  // radians
}

TEST(PointsFromDepths, LeaveOutWhatOneViewSees) {
  ThreadPool pool(1);
  auto views = test::sphere_views();
  const size_t all = points_from_depths(views, options_of(8000), pool).positions.size();
  // A floater before one camera.
  DepthView& view = views.front();
  for (int y = 50; y < 60; ++y)
    for (int x = 50; x < 60; ++x) view.depth[static_cast<size_t>(y * view.width + x)] = 1.65f;
  const TriangleMesh cloud = points_from_depths(views, options_of(8000), pool);
  EXPECT_GT(cloud.positions.size(), all / 2);
  for (const Vec3& p : cloud.positions) EXPECT_LT(length(p), 0.75_r);
  EXPECT_TRUE(points_from_depths({}, options_of(10), pool).positions.empty());
}

TEST(PointsFromDepths, HaveTheSameBitsForAnyThreads) {
  const auto views = test::sphere_views();
  ThreadPool one(1), two(2);
  const TriangleMesh a = points_from_depths(views, options_of(3000), one);
  const TriangleMesh b = points_from_depths(views, options_of(3000), two);
  EXPECT_EQ(a.positions, b.positions);
  EXPECT_EQ(a.normals, b.normals);
}

}  // namespace
}  // namespace nerf
