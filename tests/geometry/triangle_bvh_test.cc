// Rays and triangles against every triangle tried one by one.
#include "nerf/geometry/triangle_bvh.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "nerf/math/random.h"

namespace nerf {
namespace {

Vec3d drawn(Random& random, double scale) {
  return Vec3d{double(random.uniform()) - 0.5, double(random.uniform()) - 0.5,
               double(random.uniform()) - 0.5} *
         scale;
}

TriangleMesh soup(size_t triangles, double size) {
  TriangleMesh mesh;
  for (size_t t = 0; t < triangles; ++t) {
    Random random(3, 0, t);
    const Vec3d at = drawn(random, 2);
    for (uint32_t k = 0; k < 3; ++k)
      mesh.positions.push_back((at + drawn(random, size)).cast<Real>());
    const auto first = static_cast<uint32_t>(3 * t);
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

// As an area of three half-planes, in doubles.
std::optional<double> meets(const TriangleMesh& mesh, size_t t, const Vec3d& o, const Vec3d& d) {
  const Vec3d a = mesh.corner(t, 0).cast<double>(), b = mesh.corner(t, 1).cast<double>(),
              c = mesh.corner(t, 2).cast<double>();
  const Vec3d n = cross(b - a, c - a);
  const double along = dot(n, d);
  if (along == 0) return std::nullopt;
  const double distance = dot(n, a - o) / along;
  const Vec3d p = o + d * distance;
  for (const auto& [from, to] : {std::pair{a, b}, std::pair{b, c}, std::pair{c, a}})
    if (dot(n, cross(to - from, p - from)) < 0) return std::nullopt;
  return distance;
}

TEST(TriangleBvh, FindsWhatTryingAllFinds) {
  for (const size_t triangles : {size_t{1}, size_t{5}, size_t{700}}) {
    const TriangleMesh mesh = soup(triangles, triangles > 100 ? 0.3 : 2);
    const TriangleBvh bvh(mesh.positions, mesh.triangles);
    int hits = 0;
    for (uint64_t r = 0; r < 500; ++r) {
      Random random(4, 0, r);
      const Vec3d o = drawn(random, 4), d = normalized(drawn(random, 1));
      const double near = 0.1, far = 3;
      std::optional<double> nearest;
      int all = 0;
      for (size_t t = 0; t < triangles; ++t) {
        const auto distance = meets(mesh, t, o, d);
        if (!distance || *distance <= near || *distance >= far) continue;
        ++all;
        if (!nearest || *distance < *nearest) nearest = distance;
      }
      TriangleHit hit;
      const bool found = bvh.nearest(o, d, near, far, hit, [](const TriangleHit&) { return true; });
      ASSERT_EQ(found, nearest.has_value());
      if (found) {
        EXPECT_NEAR(hit.t, *nearest, 1e-9);
      }
      int visited = 0;
      bvh.each(o, d, near, far, [&](const TriangleHit&) { return ++visited > 0; });
      EXPECT_EQ(visited, all);
      hits += found;
    }
    EXPECT_GT(hits, 0);
  }
}

TEST(TriangleBvh, PassesWhatIsNotAccepted) {
  TriangleMesh mesh;
  for (const Real z : {0.0_r, 1.0_r})
    for (const Vec3& p : {Vec3{-1, -1, z}, Vec3{1, -1, z}, Vec3{0, 1, z}})
      mesh.positions.push_back(p);
  mesh.triangles = {{0, 1, 2}, {3, 4, 5}, {0, 0, 1}};  // the last one has no area
  const TriangleBvh bvh(mesh.positions, mesh.triangles);
  TriangleHit hit;
  ASSERT_TRUE(bvh.nearest({0, 0, -1}, {0, 0, 1}, 0, 9, hit,
                          [](const TriangleHit& h) { return h.triangle != 0; }));
  EXPECT_EQ(hit.triangle, 1u);
  EXPECT_EQ(hit.t, 2);
  EXPECT_NEAR(hit.u, 0.25, 1e-12);  // (0, 0) of corners (-1, -1), (1, -1), (0, 1)
  EXPECT_NEAR(hit.v, 0.5, 1e-12);
  EXPECT_FALSE(TriangleBvh().nearest({}, {0, 0, 1}, 0, 9, hit, [](auto&) { return true; }));
}

// A ray in the plane of a box's face.
TEST(TriangleBvh, TakesRaysAlongAxes) {
  const TriangleMesh mesh = soup(300, 0.4);
  const TriangleBvh bvh(mesh.positions, mesh.triangles);
  for (int axis = 0; axis < 3; ++axis)
    for (size_t t = 0; t < mesh.triangles.size(); ++t) {
      const Vec3d middle =
          (mesh.corner(t, 0) + mesh.corner(t, 1) + mesh.corner(t, 2)).cast<double>() / 3;
      Vec3d d, o = middle;
      d[axis] = 1;
      o[axis] = -5;
      TriangleHit hit;
      EXPECT_TRUE(bvh.nearest(o, d, 0, 20, hit, [](auto&) { return true; }));
    }
}

}  // namespace
}  // namespace nerf
