// The march through the occupancy grid against brute force in double.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "nerf/math/random.h"
#include "parts/march_check.h"
#include "parts/march_scenes.h"

namespace nerf {
namespace {

using namespace march_check;

TEST(RayMarch, RandomRays) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    const double half = std::ldexp(1.0, scene.cascades - 1);
    for (uint64_t i = 0; i < 400; ++i) {
      Random random(51, 0, i);
      Ray ray;
      ray.direction = random_direction(random);
      ray.origin = random_point(random, i % 2 ? half : 3 * half);
      if (i % 4 == 0) {  // towards the scene
        const Vec3d aim = random_point(random, half);
        ray.direction = normalized(aim - ray.origin);
      }
      march_and_compare(scene, sampler, ray, "random ray " + std::to_string(i));
    }
  }
}

// A few bricks in wide empty space, which is crossed in jumps.
TEST(RayMarch, AcrossEmptySpace) {
  const Scene& scene = *std::ranges::find(scenes(), "lonely", &Scene::name);
  RaySampler sampler(scene.grid, endless(), kEverywhere);
  int hits = 0;
  uint64_t rays = 0;
  for (int c = 0; c < 3; ++c)
    for (int64_t brick = 0; brick < scene.grid.cells() / 64; ++brick) {
      if (scene.grid.brick_mask(c, brick) == 0) continue;
      const Vec3d corner = scene.grid.cell_corner(brick * 64, c).cast<double>();
      const double width = 4 * static_cast<double>(scene.grid.cell_width(c));
      for (int i = 0; i < 40; ++i, ++rays) {
        Random random(53, 0, rays);
        const Vec3d aim =
            corner + random_point(random, width / 2) + Vec3d{width / 2, width / 2, width / 2};
        Ray ray;
        ray.origin = random_point(random, i % 2 ? 4 : 12);
        ray.direction = normalized(aim - ray.origin);
        march_and_compare(scene, sampler, ray, "lonely ray " + std::to_string(rays));
        hits += !sampler.segments().empty();
      }
    }
  EXPECT_GT(rays, 1000u);
  EXPECT_GT(hits, static_cast<int>(rays / 2));
}

TEST(RayMarch, FromFarAway) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    int hits = 0;
    for (uint64_t i = 0; i < 100; ++i) {
      Random random(52, 0, i);
      Ray ray;
      const Vec3d aim = random_point(random, 0.9);
      ray.origin = aim + random_direction(random) * (i % 2 ? 1e5 : 1e3);
      ray.direction = normalized(aim - ray.origin);
      march_and_compare(scene, sampler, ray, "far ray " + std::to_string(i));
      hits += !sampler.segments().empty();
    }
    if (scene.name != "lonely") {
      EXPECT_GE(hits, 90) << scene.name;
    }
  }
}

TEST(RayMarch, ParallelToAxes) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    const double half = std::ldexp(1.0, scene.cascades - 1);
    for (int axis = 0; axis < 3; ++axis)
      for (double sign : {-1.0, 1.0})
        // Inside cells; exactly along the planes between them, those between cascades among them.
        for (double offset : {0.0078, -0.3333, 0.0, 0.25, -0.5, 0.015625, 0.984375, -1.0, 1.0}) {
          if (std::fabs(offset) >= half) continue;
          for (double from : {-5.0, 0.0, 0.1, -1.0}) {
            Ray ray;
            ray.origin = {offset, offset, offset};
            ray.origin[axis] = from * sign;
            ray.origin[(axis + 1) % 3] = 0.7 * offset;
            ray.direction = {0, 0, 0};
            ray.direction[axis] = sign;
            march_and_compare(scene, sampler, ray, "along an axis at " + std::to_string(offset));
          }
        }
  }
}

// Through vertices and edges of the grid: several planes are crossed at the same t.
TEST(RayMarch, ThroughCornersAndEdges) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    for (const Vec3d& d : {Vec3d{1, 1, 1}, Vec3d{1, -1, 1}, Vec3d{-1, -1, -1}, Vec3d{1, 1, 0},
                           Vec3d{0, -1, 1}, Vec3d{2, 1, 1}, Vec3d{1, 2, -1}})
      for (const Vec3d& through : {Vec3d{0, 0, 0}, Vec3d{0.25, 0.25, 0.25}, Vec3d{0.5, -0.25, 0.75},
                                   Vec3d{0.015625, 0, 0}})
        for (double back : {0.0, 0.125, 0.5, 2.0, 8.0}) {
          Ray ray;
          ray.origin = through - d * back;
          ray.direction = normalized(d);
          march_and_compare(scene, sampler, ray, "through corners");
        }
  }
}

// Nearly parallel to planes, from a plane or from the border of the whole grid.
TEST(RayMarch, Grazing) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    const double half = std::ldexp(1.0, scene.cascades - 1);
    for (int axis = 0; axis < 3; ++axis)
      for (double slope : {0.1, 0.02, 3e-3, 1e-4, 1e-6, 1e-9, 1e-13})
        for (double sign : {-1.0, 1.0})
          for (double height : {-half, -1.0, -0.5, 0.0, 0.015625, 1.0, half}) {
            if (std::fabs(height) > half) continue;
            Ray ray;
            ray.origin = {-0.3, -0.3, -0.3};
            ray.origin[axis] = height;
            ray.direction = {0.6, 0.6, 0.6};
            ray.direction[axis] = sign * slope;
            ray.direction = normalized(ray.direction);
            march_and_compare(
                scene, sampler, ray,
                "grazing by " + std::to_string(sign * slope) + " at " + std::to_string(height));
            // The same, met from outside.
            ray.origin = ray.origin - ray.direction * (0.5 * half);
            march_and_compare(scene, sampler, ray, "grazing from before");
          }
  }
}

TEST(RayMarch, NearFarAndBehind) {
  const Scene& scene = scenes()[1];
  RaySampler sampler(scene.grid, endless(), kEverywhere);
  RaySamples samples;
  for (uint64_t i = 0; i < 100; ++i) {
    Random random(53, 0, i);
    Ray ray;
    ray.origin = random_point(random, 0.9);
    ray.direction = random_direction(random);
    for (const auto& [near, far] :
         {std::pair{1e-9, 1e30}, {0.1, 0.2}, {0.3, 0.300001}, {0.0, 0.5}, {2.5, 1e30}}) {
      ray.near = near;
      ray.far = far;
      march_and_compare(scene, sampler, ray, "near " + std::to_string(near));
      sampler.sample_all(ray, 2, samples);
      for (Real t : samples.t) {
        ASSERT_GE(sampler.start() + t, near);
        ASSERT_LE(sampler.start() + t, far * (1 + 1e-6));
      }
    }
  }
  // Matter behind the camera only, and a far border before the near one.
  Ray away;
  away.origin = {3, 0.1, 0.1};
  away.direction = {1, 0, 0};
  EXPECT_EQ(sampler.sample_all(away, 1, samples), 0);
  EXPECT_TRUE(samples.t.empty() && sampler.segments().empty());
  away.direction = {-1, 0, 0};
  EXPECT_GT(sampler.sample_all(away, 1, samples), 0);
  away.near = 3, away.far = 2;
  EXPECT_EQ(sampler.sample_all(away, 1, samples), 0);
}

TEST(RayMarch, ClipBox) {
  for (const Scene& scene : scenes()) {
    const Box3 box{{-0.4, -0.71, 0.03}, {0.9, 0.2, 0.6}};
    RaySampler sampler(scene.grid, endless(), box);
    for (uint64_t i = 0; i < 100; ++i) {
      Random random(54, 0, i);
      Ray ray;
      ray.origin = random_point(random, 2);
      const Vec3d aim = random_point(random, 0.7);
      ray.direction = normalized(aim - ray.origin);
      march_and_compare(scene, sampler, ray, "clipped ray " + std::to_string(i), box);
    }
  }
}

// A box without volume, one beyond the grid, and two that do not meet.
TEST(RayMarch, EmptyClipBoxesHoldNothing) {
  const Scene& scene = scenes()[0];
  RaySamples samples;
  for (const Box3& box : {Box3{}, Box3{{0.8, -1, -1}, {0.5, 1, 1}}, Box3{{2, -9, -9}, {3, 9, 9}},
                          Box3{{0.2, 0.2, 0.2}, {0.2, 0.2, 0.2}}}) {
    RaySampler sampler(scene.grid, endless(), box);
    for (uint64_t i = 0; i < 100; ++i) {
      Random random(55, 0, i);
      Ray ray;
      ray.origin = random_point(random, 2);
      ray.direction = normalized(random_point(random, 0.7) - ray.origin);
      EXPECT_EQ(sampler.sample_all(ray, 1, samples), 0) << box.min.x << " ray " << i;
    }
  }
}

TEST(RayMarch, EmptyGridHoldsNothing) {
  const OccupancyGrid grid = make_grid(2, [](const CellPlace&) -> uint8_t { return 0; });
  RaySampler sampler(grid, endless(), kEverywhere);
  RaySamples samples;
  Ray ray;
  ray.direction = {0, 0, 1};
  EXPECT_EQ(sampler.sample_all(ray, 1, samples), 0);
  EXPECT_EQ(sampler.sample(ray, nullptr, true, samples), 0);
  EXPECT_EQ(sampler.sample(ray, nullptr, false, samples), 0);
}

// Broken rays give nothing or something finite, in finite time.
TEST(RayMarch, RaysThatAreNoNumbers) {
  const double nan = std::nan("");
  const Scene& scene = scenes()[3];
  RaySampler sampler(scene.grid, endless(), kEverywhere);
  RaySamples samples;
  for (int i = 0; i < 12; ++i) {
    Ray ray;
    ray.origin = {0.1, 0.2, 0.3};
    ray.direction = normalized(Vec3d{1, 2, 3});
    if (i < 3)
      ray.origin[i] = nan;
    else if (i < 6)
      ray.direction[i - 3] = nan;
    else if (i < 9)
      ray.origin[i - 6] = 1e300;
    else
      ray.direction = {0, 0, i == 9 ? 0 : i == 10 ? 1e-310 : 1e30};
    sampler.sample_all(ray, 1, samples);
    for (Real delta : samples.delta) EXPECT_TRUE(std::isfinite(delta) && delta >= 0) << i;
    sampler.sample(ray, nullptr, true, samples);
  }
}

}  // namespace
}  // namespace nerf
