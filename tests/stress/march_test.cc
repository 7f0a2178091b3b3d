// Rays that meet the occupancy grid along its planes and through its corners, from a hundred
// thousand times its size away, and through many cascades.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "parts/march_check.h"

namespace nerf::stress {
namespace {

using march_check::march_and_compare;
using march_check::Scene;

SamplerOptions endless() {
  SamplerOptions options;
  options.min_transmittance = 0;
  return options;
}

uint64_t hash_of(const CellPlace& p) {
  return mix64(mix64(static_cast<uint64_t>(p.x + 512 * (p.y + 512 * p.z))) ^
               static_cast<uint64_t>(p.cascade));
}

const std::vector<Scene>& scenes() {
  static const std::vector<Scene> all = [] {
    const auto noise = [](const CellPlace& p) -> uint8_t { return hash_of(p) & 1 ? 100 : 0; };
    const auto full = [](const CellPlace&) -> uint8_t { return 30; };
    std::vector<Scene> out;
    out.emplace_back("full", 1, full, 32);
    out.emplace_back("noise", 1, noise, 64);
    out.emplace_back("full_cascades", 8, full, 32);
    out.emplace_back("noisy_cascades", 6, noise, 32);
    return out;
  }();
  return all;
}

// Towards `through` along `d` from a distance.
Ray towards(const Vec3d& through, const Vec3d& d, double distance) {
  Ray ray;
  ray.direction = normalized(d);
  ray.origin = through - ray.direction * distance;
  return ray;
}

constexpr double kDistances[] = {1e5, 1e7};

// Along axes: inside cells, on faces, on edges, on the grid's own borders.
TEST(StressMarch, AlongAxesFromFarAway) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    const double half = std::ldexp(1.0, scene.cascades - 1);
    for (int axis = 0; axis < 3; ++axis)
      for (double sign : {-1.0, 1.0})
        for (double distance : kDistances)
          for (double a : {0.013, 0.0, 0.0625, -0.5, -half, half})
            for (double b : {-0.31, 0.25, -1.0, 1.0}) {
              if (std::fabs(a) > half || std::fabs(b) > half) continue;
              Vec3d through{0, 0, 0}, d{0, 0, 0};
              through[(axis + 1) % 3] = a;
              through[(axis + 2) % 3] = b;
              d[axis] = sign;
              march_and_compare(scene, sampler, towards(through, d, distance),
                                "along axis " + std::to_string(axis) + " from " +
                                    std::to_string(distance) + " at " + std::to_string(a));
            }
  }
}

// Diagonals through vertices and edges: several planes at once, from far away. The point where the
// march begins is rounded to float, so the ray may miss the vertex by that, on either side, and
// pass a cell that has only the vertex in common with it.
TEST(StressMarch, ThroughCornersFromFarAway) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    int met = 0;
    for (const Vec3d& d : {Vec3d{1, 1, 1}, Vec3d{-1, 1, -1}, Vec3d{1, 1, 0}, Vec3d{0, -1, 1},
                           Vec3d{2, -1, 1}, Vec3d{1, 3, 2}})
      for (const Vec3d& through : {Vec3d{0, 0, 0}, Vec3d{0.25, 0.25, 0.25}, Vec3d{0.5, -0.25, 0.75},
                                   Vec3d{0.0625, 0, 0}, Vec3d{-1, -1, -1}, Vec3d{1, 1, -1}})
        for (double distance : kDistances) {
          const Ray ray = towards(through, d, distance);
          double slowest = 1;
          for (int i = 0; i < 3; ++i)
            if (ray.direction[i] != 0) slowest = std::min(slowest, std::fabs(ray.direction[i]));
          const double unseen =
              4 * kRoundoff * std::ldexp(1.0, scene.cascades - 1) + 4 * kDoubleRoundoff * distance;
          march_and_compare(scene, sampler, ray, "through corners", kEverywhere,
                            2 * unseen / slowest);
          met += !sampler.segments().empty();
        }
    EXPECT_GT(met, 30) << scene.name;
  }
}

// Nearly along planes, from far away: the ray stays next to a plane for the whole grid.
TEST(StressMarch, GrazingFromFarAway) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    for (int axis = 0; axis < 3; ++axis)
      for (double slope : {0.02, -1e-4, 1e-6, -1e-9, 1e-13, 1e-310, -0.0})
        for (double height : {-1.0, -0.5, 0.0, 0.0625, 0.3})
          for (double distance : kDistances) {
            Vec3d through{-0.3, -0.3, -0.3}, d{0.6, 0.7, 0.5};
            through[axis] = height;
            d[axis] = slope;
            march_and_compare(scene, sampler, towards(through, d, distance),
                              "grazing by " + std::to_string(slope));
          }
  }
}

// Away from the grid, past it, and beyond `far`: nothing, however far away.
TEST(StressMarch, WhatIsBehindOrBesideIsNotMet) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    RaySamples out;
    const double half = std::ldexp(1.0, scene.cascades - 1);
    for (int axis = 0; axis < 3; ++axis)
      for (double sign : {-1.0, 1.0})
        for (double distance : {0.0, 3 * half, 1e5}) {
          Vec3d through{0.1, 0.1, 0.1}, d{0, 0, 0};
          through[(axis + 1) % 3] = sign * half * (1 + 1e-9);
          d[axis] = sign;
          EXPECT_EQ(sampler.sample_all(towards(through, d, distance), 1, out), 0)
              << "along a face, outside, " << distance;
        }
    for (uint64_t i = 0; i < 200; ++i) {
      Random random(66, 0, i);
      const Vec3d d = normalized(Vec3d{random.uniform() - 0.5, random.uniform() - 0.5, 0.6});
      for (double distance : {3 * half, 1e5, 1e12}) {
        Ray ray = towards({0, 0, 0}, d, distance);
        ray.direction = -ray.direction;
        EXPECT_EQ(sampler.sample_all(ray, 1, out), 0) << "behind, " << distance;
        ray.direction = -ray.direction;
        ray.far = distance - 2 * half;
        EXPECT_EQ(sampler.sample_all(ray, 1, out), 0) << "beyond the far border, " << distance;
        ray.far = 1e30;
        ray.origin = ray.origin + cross(d, normalized(Vec3d{0.3, 0.7, -0.2})) * (8 * half);
        EXPECT_EQ(sampler.sample_all(ray, 1, out), 0) << "beside, " << distance;
      }
    }
  }
}

}  // namespace
}  // namespace nerf::stress
