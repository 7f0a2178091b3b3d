// How samples are drawn from a ray's segments of matter.
#include "nerf/parts/ray_sampler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "math/worst_error.h"
#include "parts/occupancy_pattern.h"

namespace nerf {
namespace {

// Noise of all levels in two cascades.
const OccupancyGrid& noise() {
  static const OccupancyGrid grid = make_grid(2, [](const CellPlace& p) -> uint8_t {
    const uint64_t h =
        mix64(static_cast<uint64_t>(p.x + 128 * (p.y + 128 * p.z) + (p.cascade << 24)));
    return h % 4 == 0 ? static_cast<uint8_t>(1 + (h >> 8) % 120) : 0;
  });
  return grid;
}

// Matter only where x is in [lo, hi) (cells of cascade 0), of one level.
OccupancyGrid slab(int lo, int hi, uint8_t level) {
  return make_grid(
      1, [=](const CellPlace& p) -> uint8_t { return p.x >= lo && p.x < hi ? level : 0; });
}

Ray random_ray(uint64_t index) {
  Random random(71, 0, index);
  Ray ray;
  Vec3d aim;
  for (int i = 0; i < 3; ++i) {
    ray.origin[i] = 4 * static_cast<double>(random.uniform()) - 2;
    aim[i] = 1.6 * static_cast<double>(random.uniform()) - 0.8;
  }
  ray.direction = normalized(aim - ray.origin);
  return ray;
}

double matter_length(std::span<const Segment> segments) {
  double sum = 0;
  for (const Segment& s : segments) sum += static_cast<double>(s.t1) - static_cast<double>(s.t0);
  return sum;
}

// Length of matter in front of t.
double matter_before(std::span<const Segment> segments, double t) {
  double sum = 0;
  for (const Segment& s : segments)
    sum += std::clamp(t - static_cast<double>(s.t0), 0.0,
                      static_cast<double>(s.t1) - static_cast<double>(s.t0));
  return sum;
}

// Whatever the options: lengths add up, places are in order, each inside its interval and inside
// matter, numbers within their limits.
TEST(RaySampler, SamplesPartitionTheMatter) {
  WorstError sum("sum_of_deltas"), place("place_in_interval");
  SamplerOptions all, few, many, fixed;
  all.min_transmittance = few.min_transmittance = many.min_transmittance = 0;
  few.max_samples = 3, few.min_samples = 1, few.samples_per_cell = 0.3_r;
  many.max_samples = 240, many.min_samples = 7, many.samples_per_cell = 5,
  many.uniform_share = 0.5_r;
  fixed.min_samples = fixed.max_samples = 16;  // and a transmittance stop
  for (const SamplerOptions& options : {all, few, many, fixed}) {
    RaySampler sampler(noise(), options, kEverywhere);
    RaySamples out;
    int hits = 0;
    for (uint64_t i = 0; i < 300; ++i) {
      const Ray ray = random_ray(i);
      for (bool jitter : {false, true})
        for (bool follow : {false, true}) {
          Random random(72, 0, i);
          const int count = sampler.sample(ray, jitter ? &random : nullptr, follow, out);
          ASSERT_EQ(out.t.size(), static_cast<size_t>(count));
          ASSERT_EQ(out.delta.size(), out.t.size());
          const auto segments = sampler.segments();
          if (segments.empty()) {
            ASSERT_EQ(count, 0);
            continue;
          }
          ++hits;
          ASSERT_GE(count, options.min_samples);
          ASSERT_LE(count, options.max_samples);
          // Roundings: one per segment and per sample. The last border's share of its segment's
          // mass, at least uniform_share of its length's share, is what is left of a sum of all
          // masses.
          const double length = matter_length(segments);
          const double n = static_cast<double>(segments.size()) + count;
          const double tolerance =
              rounding_bound(4 * n) * length * (1 + 2.0 / options.uniform_share);
          double total = 0;
          for (size_t k = 0; k < out.t.size(); ++k) {
            ASSERT_GE(out.delta[k], 0);
            if (k > 0) {
              ASSERT_GE(out.t[k], out.t[k - 1]) << "ray " << i << " sample " << k;
            }
            const double t = out.t[k], ulp = 2 * kRoundoff * t;
            ASSERT_TRUE(std::any_of(segments.begin(), segments.end(),
                                    [&](const Segment& s) { return t >= s.t0 && t <= s.t1 + ulp; }))
                << "ray " << i << " sample " << k << " at " << t << " is in empty space";
            const double before = matter_before(segments, t);
            const double delta = out.delta[k];
            const double off = std::max({0.0, total - before, before - (total + delta)});
            place.compare(off, 0, tolerance, "ray", i, "sample", k);
            total += delta;
          }
          sum.compare(total, length, tolerance, "ray", i, "samples", count);
        }
    }
    EXPECT_GT(hits, 500);
  }
  sum.report();
  place.report();
}

TEST(RaySampler, SampleAllCutsEverySegmentEvenly) {
  RaySampler sampler(noise(), SamplerOptions(), kEverywhere);
  RaySamples out;
  for (uint64_t i = 0; i < 50; ++i)
    for (int per_cell : {1, 4}) {
      const size_t count = static_cast<size_t>(sampler.sample_all(random_ray(i), per_cell, out));
      const auto segments = sampler.segments();
      ASSERT_EQ(count, segments.size() * static_cast<size_t>(per_cell));
      for (size_t k = 0; k < count; ++k) {
        const Segment& s = segments[k / static_cast<size_t>(per_cell)];
        const double width = (static_cast<double>(s.t1) - s.t0) / per_cell;
        const double at =
            s.t0 + (static_cast<double>(k % static_cast<size_t>(per_cell)) + 0.5) * width;
        ASSERT_NEAR(out.delta[k], width, 4 * kRoundoff * s.t1);
        ASSERT_NEAR(out.t[k], at, 4 * kRoundoff * s.t1);
      }
    }
}

TEST(RaySampler, WithoutTheCacheAllMatterIsSampledAlike) {
  SamplerOptions options;
  options.samples_per_cell = 1.5_r;
  options.max_samples = 240;
  RaySampler sampler(noise(), options, kEverywhere);
  RaySamples out;
  for (uint64_t i = 0; i < 100; ++i) {
    const int count = sampler.sample(random_ray(i), nullptr, false, out);
    if (count == 0) continue;
    const double length = matter_length(sampler.segments());
    const double n = static_cast<double>(sampler.segments().size()) + count;
    for (Real delta : out.delta)
      ASSERT_NEAR(delta, length / count, rounding_bound(8 * n) * length) << "ray " << i;
  }
}

// A wall of opaque cells: the march goes on behind it only where it is told to ignore the cache.
TEST(RaySampler, StopsBehindOpaqueMatterUnlessToldNotTo) {
  const OccupancyGrid grid = make_grid(1, [](const CellPlace& p) -> uint8_t {
    return p.x == 40 || p.x == 41 ? 255 : p.x >= 60 && p.x < 70 ? 255 : 0;
  });
  Ray ray;
  ray.origin = {-2, 0.1, 0.1};
  ray.direction = {1, 0, 0};
  const double cell = 1.0 / 64;
  SamplerOptions options;
  RaySamples out;
  const auto length = [&](Real stop, bool follow) {
    options.min_transmittance = stop;
    RaySampler sampler(grid, options, kEverywhere);
    sampler.sample(ray, nullptr, follow, out);
    return matter_length(sampler.segments());
  };
  // One opaque cell lets 1e-4 through.
  EXPECT_NEAR(length(1e-3_r, true), cell, 1e-5);
  EXPECT_NEAR(length(1e-6_r, true), 2 * cell, 1e-5);
  EXPECT_NEAR(length(0, true), 12 * cell, 1e-5);
  EXPECT_NEAR(length(1e-3_r, false), 12 * cell, 1e-5);
}

// Where the cache knows a surface, most samples go there; and every cell keeps its uniform share.
// Over many draws a stratified sample falls into a cell as often as its share of the mass says.
TEST(RaySampler, FollowsTheCacheAndKeepsAUniformShare) {
  const OccupancyGrid grid = make_grid(1, [](const CellPlace& p) -> uint8_t {
    return p.x == 100 ? 250 : p.x >= 20 && p.x < 100 ? 1 : 0;  // mist, then a surface
  });
  SamplerOptions options;
  options.min_samples = options.max_samples = 20;
  options.uniform_share = 0.25_r;
  RaySampler sampler(grid, options, kEverywhere);
  Ray ray;
  ray.origin = {-2, 0.1, 0.1};
  ray.direction = {1, 0, 0};
  RaySamples out;
  constexpr int kDraws = 2000;
  std::vector<double> hits(128);
  for (uint64_t i = 0; i < kDraws; ++i) {
    Random random(73, 0, i);
    ASSERT_EQ(sampler.sample(ray, &random, true, out), 20);
    for (Real t : out.t) {
      const double x = static_cast<double>(sampler.entry().x) + t;
      ++hits[static_cast<size_t>(std::floor((x + 1) * 64))];
    }
  }
  const double all = 20.0 * kDraws;
  EXPECT_GT((hits[99] + hits[100]) / all, 0.6) << "the surface and what it is smeared over";
  double mist = 0;
  for (size_t x = 20; x < 99; ++x) mist += hits[x];
  // 79 of 81 cells hold almost nothing but their uniform share: 0.25 of a mass of at most 1.25.
  const double share = 0.25 / 1.25 * 79 / 81;
  EXPECT_GT(mist / all, 0.9 * share);
  for (size_t x = 20; x < 99; ++x) {
    const double expected = 0.25 / 1.25 / 81 * all;
    EXPECT_GT(hits[x], expected - 6 * std::sqrt(expected)) << "cell " << x;
  }
}

TEST(RaySampler, WithoutUniformShareLengthsStillAddUp) {
  const OccupancyGrid grid = slab(30, 90, 60);
  SamplerOptions options;
  options.uniform_share = 0;
  RaySampler sampler(grid, options, kEverywhere);
  Ray ray;
  ray.origin = {-2, 0.1, 0.1};
  ray.direction = {1, 0, 0};
  RaySamples out;
  ASSERT_GT(sampler.sample(ray, nullptr, true, out), 0);
  double sum = 0;
  for (Real d : out.delta) sum += d;
  EXPECT_NEAR(sum, matter_length(sampler.segments()), 1e-4);
}

// More matter of unknown kind takes more samples, one cell takes the fewest.
TEST(RaySampler, CountGrowsWithTheEffectiveNumberOfCells) {
  SamplerOptions options;
  options.min_samples = 2;
  options.max_samples = 64;
  options.samples_per_cell = 1.5_r;
  Ray ray;
  ray.origin = {-2, 0.1, 0.1};
  ray.direction = {1, 0, 0};
  RaySamples out;
  const auto count = [&](int cells, bool follow) {
    const OccupancyGrid grid = slab(20, 20 + cells, 2);
    RaySampler sampler(grid, options, kEverywhere);
    return sampler.sample(ray, nullptr, follow, out);
  };
  EXPECT_EQ(count(1, false), 2);
  // The effective number of equal cells is their number, up to rounding before it is rounded up.
  EXPECT_NEAR(count(10, false), 15, 1);
  EXPECT_NEAR(count(20, false), 30, 1);
  EXPECT_EQ(count(100, false), 64);
  EXPECT_LE(count(10, true), 16);
  EXPECT_GT(count(30, true), count(10, true));
}

TEST(RaySampler, TheKeyAloneDecides) {
  RaySampler a(noise(), SamplerOptions(), kEverywhere), b(noise(), SamplerOptions(), kEverywhere);
  RaySamples first, again, other;
  int different = 0;
  for (uint64_t i = 0; i < 100; ++i) {
    const Ray ray = random_ray(i);
    Random r1(74, 5, i), r2(74, 5, i), r3(74, 6, i);
    a.sample(ray, &r1, true, first);
    b.sample(random_ray(i + 1), nullptr, false, other);  // what came before does not matter
    b.sample(ray, &r2, true, again);
    ASSERT_EQ(first.t, again.t);
    ASSERT_EQ(first.delta, again.delta);
    b.sample(ray, &r3, true, other);
    different += first.t != other.t;
    ASSERT_EQ(first.delta, other.delta) << "jitter moves places, not intervals";
  }
  EXPECT_GT(different, 50);
}

}  // namespace
}  // namespace nerf
