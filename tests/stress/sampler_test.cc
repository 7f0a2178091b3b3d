// Samples drawn from coarse distributions that are hard to draw from: one spike, nothing at all,
// slivers, and options at their limits.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "kernels/kernel_test.h"
#include "math/worst_error.h"
#include "nerf/parts/ray_sampler.h"
#include "parts/occupancy_pattern.h"

namespace nerf::stress {
namespace {

constexpr Real kInf = std::numeric_limits<Real>::infinity();

Ray ray_of(const Vec3d& origin, const Vec3d& direction, double near = 0, double far = 1e30) {
  return {origin, normalized(direction), near, far};
}

// Along cells, through their corners, and windows that hold a whole cell, a sliver and next to
// nothing.
std::vector<Ray> rays() {
  std::vector<Ray> out = {
      ray_of({-2, 0.1, 0.1}, {1, 0, 0}),         ray_of({-2, -2, -2}, {1, 1, 1}),
      ray_of({-2, -2, 0.1}, {1, 1, 1e-7}),       ray_of({-2, 0.25, 0.1}, {1, 0, 1e-3}),
      ray_of({1.5, 0.3, -1.2}, {-1, -0.2, 0.9}), ray_of({-1e5, 0.1, 0.1}, {1, 0, 0})};
  for (double length : {1.0 / 64, 1e-3, 1e-5, 3e-6})
    out.push_back(ray_of({-2, 0.1, 0.1}, {1, 0, 0}, 2.001, 2.001 + length));
  return out;
}

struct Histogram {
  std::string name;
  Pattern pattern;
};
std::vector<Histogram> histograms() {
  std::vector<Histogram> out;
  out.push_back({"flat", [](const CellPlace&) -> uint8_t { return 40; }});
  out.push_back({"nothing", [](const CellPlace&) -> uint8_t { return 1; }});
  out.push_back({"opaque", [](const CellPlace&) -> uint8_t { return 255; }});
  for (int at : {0, 1, 64, 127})
    out.push_back({"spike_at_" + std::to_string(at),
                   [at](const CellPlace& p) -> uint8_t { return p.x == at ? 255 : 1; }});
  out.push_back(
      {"spikes", [](const CellPlace& p) -> uint8_t { return p.x % 7 == 0 ? 250 : p.x % 2; }});
  out.push_back({"lone_cell", [](const CellPlace& p) -> uint8_t { return p.x == 70 ? 9 : 0; }});
  return out;
}

std::vector<SamplerOptions> all_options() {
  std::vector<SamplerOptions> out;
  for (Real share : {1.0_r, 10.0_r, 1e-3_r, 1e-6_r, 1e-20_r, 1e-38_r, 1e-44_r, 0.0_r})
    for (Real per_cell : {1e-30_r, 0.1_r, 3.0_r, 1e9_r, 1e30_r, kInf})
      for (const auto& [fewest, most] : {std::pair{1, 1}, {2, 32}, {240, 240}, {7, 240}}) {
        SamplerOptions o;
        o.max_samples = most;
        o.min_samples = fewest;
        o.samples_per_cell = per_cell;
        o.uniform_share = share;
        o.min_transmittance = 0;
        out.push_back(o);
      }
  return out;
}

// Length of matter in front of t.
double matter_before(std::span<const Segment> segments, double t) {
  double sum = 0;
  for (const Segment& s : segments)
    sum += std::clamp(t - double{s.t0}, 0.0, double{s.t1} - double{s.t0});
  return sum;
}

// Lengths add up to the matter, places ascend, each inside its interval. Each number is a sum of at
// most n lengths, or a difference of two.
TEST(StressSampler, EveryDistributionIsPartitioned) {
  WorstError sum("sum_of_lengths"), place("place");
  const std::vector<SamplerOptions> options = all_options();
  for_each_target([&](const std::string&) {
    for (const Histogram& h : histograms()) {
      const OccupancyGrid grid = make_grid(1, h.pattern);
      for (size_t o = 0; o < options.size(); ++o) {
        RaySampler sampler(grid, options[o], kEverywhere);
        const std::vector<Ray> all = rays();
        for (size_t r = 0; r < all.size(); ++r)
          for (int mode = 0; mode < 4; ++mode) {
            const bool flush = mode == 3;
            Random random(61, o, r);
            RaySamples out;
            int count = 0;
            {
              const auto guard = flush ? std::make_unique<FlushDenormals>() : nullptr;
              count = sampler.sample(all[r], mode % 2 ? &random : nullptr, mode != 2, out);
            }
            SCOPED_TRACE(h.name + " options " + std::to_string(o) + " ray " + std::to_string(r) +
                         " mode " + std::to_string(mode));
            const auto segments = sampler.segments();
            if (segments.empty()) {
              ASSERT_EQ(count, 0);
              continue;
            }
            ASSERT_GE(count, options[o].min_samples);
            ASSERT_LE(count, options[o].max_samples);
            const double length = matter_before(segments, segments.back().t1);
            const double n = static_cast<double>(segments.size()) + count;
            const double tolerance = rounding_bound(n + 4) * length;
            double total = 0, before = segments.front().t0;
            for (size_t k = 0; k < out.t.size(); ++k) {
              const double t = out.t[k], delta = out.delta[k];
              ASSERT_TRUE(std::isfinite(t) && std::isfinite(delta) && delta >= 0) << k;
              ASSERT_GE(t, before) << k;
              // f width is rounded, and so is its sum with t0.
              ASSERT_LE(t, segments.back().t1 + 2 * kRoundoff * segments.back().t1) << k;
              before = t;
              const double at = matter_before(segments, t);
              place.compare(std::max({0.0, total - at, at - (total + delta)}), 0,
                            tolerance + 2 * kRoundoff * t, h.name, "options", o, "ray", r, "sample",
                            k);
              total += delta;
            }
            sum.compare(total, length, tolerance, h.name, "options", o, "ray", r, "count", count);
          }
      }
    }
  });
  sum.report();
  place.report();
}

// The number of samples goes to its limits where what is asked for is more, or less, than any.
TEST(StressSampler, CountsAreAtTheirLimits) {
  for_each_target([&](const std::string&) {
    const OccupancyGrid grid = make_grid(1, [](const CellPlace&) -> uint8_t { return 1; });
    SamplerOptions options;
    options.min_samples = 3;
    options.max_samples = 77;
    RaySamples out;
    const auto count = [&](Real per_cell) {
      options.samples_per_cell = per_cell;
      RaySampler sampler(grid, options, kEverywhere);
      return sampler.sample(rays()[0], nullptr, true, out);
    };
    for (Real few : {0.0_r, 1e-45_r, 1e-30_r, 1e-3_r}) EXPECT_EQ(count(few), 3) << few;
    for (Real many : {10.0_r, 1e7_r, 3e7_r, 1e10_r, 1e30_r, std::numeric_limits<Real>::max(), kInf})
      EXPECT_EQ(count(many), 77) << many;
  });
}

// Passages so short that 1 less the light they let through is nothing in float: their light counts
// nevertheless, so that each interval holds its share of it.
TEST(StressSampler, ThinnestMatterHasMass) {
  for_each_target([&](const std::string&) {
    const OccupancyGrid grid = make_grid(1, [](const CellPlace&) -> uint8_t { return 1; });
    SamplerOptions options;
    options.uniform_share = 0;
    options.min_transmittance = 0;
    options.min_samples = options.max_samples = 7;
    RaySampler sampler(grid, options, kEverywhere);
    // Across a plane, 1/64 behind the border that the ray enters through.
    const Ray ray = ray_of({-2, 0.1, 0.1}, {1, 0, 0}, 1 + 1.0 / 64 - 3e-6, 1 + 1.0 / 64 + 3e-6);
    RaySamples out;
    ASSERT_EQ(sampler.sample(ray, nullptr, true, out), 7);
    const auto segments = sampler.segments();
    ASSERT_EQ(segments.size(), 2u);
    if (std::is_same_v<Real, float>) {
      ASSERT_EQ(1 - std::exp(-segments[0].thickness), 0);
    }
    // Light is thickness, to first order; a quarter of it counts for the neighbour.
    const double tau0 = segments[0].thickness, tau1 = segments[1].thickness;
    const double width = double{segments[0].t1} - double{segments[0].t0};
    const double first = 0.5 * tau0 + 0.25 * tau1, all = 0.75 * (tau0 + tau1);
    ASSERT_GT(first, all / 7);
    // A dozen roundings, each of its value, and the second order.
    const double want = all / 7 / first * width;
    EXPECT_NEAR(out.delta.front(), want, (rounding_bound(12) + tau0 + tau1) * want);
  });
}

// The distribution in double at the borders that were found in float: each interval holds one
// count-th of the mass. A mass of n segments, each made with a few roundings and with 1 - exp(-x)
// that is off by 2 u of 1, is off by no more than that times the largest total, and so is the
// border.
TEST(StressSampler, IntervalsHoldEqualMass) {
  WorstError worst("mass");
  for_each_target([&](const std::string&) {
    for (const Histogram& h : histograms()) {
      const OccupancyGrid grid = make_grid(1, h.pattern);
      for (Real uniform : {1.0_r, 10.0_r, 0.01_r})
        for (int most : {1, 8, 240}) {
          SamplerOptions options;
          options.min_samples = options.max_samples = most;
          options.uniform_share = uniform;
          options.min_transmittance = 0;
          RaySampler sampler(grid, options, kEverywhere);
          for (const Ray& ray : rays()) {
            RaySamples out;
            sampler.sample(ray, nullptr, true, out);
            const auto segments = sampler.segments();
            const size_t n = segments.size();
            if (n == 0) continue;
            const double length = matter_before(segments, segments.back().t1);
            std::vector<double> light(n + 2), mass(n);
            double transmittance = 1, total = 0;
            for (size_t i = 0; i < n; ++i) {
              light[i + 1] = transmittance * -std::expm1(-double{segments[i].thickness});
              transmittance *= std::exp(-double{segments[i].thickness});
            }
            for (size_t i = 0; i < n; ++i) {
              const double width = double{segments[i].t1} - double{segments[i].t0};
              mass[i] = 0.5 * light[i + 1] + 0.25 * (light[i] + light[i + 2]) +
                        double{uniform} * width / length;
              total += mass[i];
            }
            double border = 0;
            for (size_t k = 0; k < out.t.size(); ++k) {
              border += out.delta[k];
              double left = border, below = 0;
              double steepest = 0;
              for (size_t i = 0; i < n; ++i) {
                const double width = double{segments[i].t1} - double{segments[i].t0};
                below += mass[i] * std::clamp(left / width, 0.0, 1.0);
                left -= width;
                steepest = std::max(steepest, mass[i] / width);
              }
              const double roundings = static_cast<double>(n) + 8;
              worst.compare(below, total * static_cast<double>(k + 1) / most,
                            rounding_bound(4 * roundings) * (total + 1) +
                                rounding_bound(roundings + most) * length * steepest,
                            h.name, "uniform", uniform, "of", most, "border", k);
            }
          }
        }
    }
  });
  worst.report();
}

}  // namespace
}  // namespace nerf::stress
