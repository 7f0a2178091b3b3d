// How far a beam of rays is clear of matter, against its rays' marches and a closed form.
#include "nerf/parts/beam.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "nerf/parts/ray_sampler.h"
#include "parts/march_scenes.h"

namespace nerf {
namespace {

using namespace march_check;

constexpr double kNever = std::numeric_limits<double>::infinity();

// A direction within the beam's spread.
Vec3d direction_within(const Beam& beam, Random& random) {
  for (double share = 1; share > 1e-3; share *= 0.9) {
    const Vec3d d = normalized(beam.axis + random_direction(random) * (beam.spread * share));
    if (length(d - beam.axis) <= beam.spread) return d;
  }
  return beam.axis;
}

bool same(const std::vector<Segment>& a, std::span<const Segment> b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Segment& s, const Segment& t) {
    return s.t0 == t.t0 && s.t1 == t.t1 && s.thickness == t.thickness;
  });
}

TEST(Beam, NoRayMeetsMatterBeforeItsEndAndNoneIsChangedByKnowing) {
  for (const Scene& scene : scenes()) {
    RaySampler sampler(scene.grid, endless(), kEverywhere);
    const double half = std::ldexp(1.0, scene.cascades - 1);
    int clear = 0, never = 0;
    for (uint64_t i = 0; i < 300; ++i) {
      Random random(61, 0, i);
      Beam beam;
      beam.origin = random_point(random, i % 3 == 0 ? half : i % 3 == 1 ? 3 * half : 1e3);
      beam.axis =
          i % 2 ? random_direction(random) : normalized(random_point(random, half) - beam.origin);
      beam.spread = i % 7 == 0 ? 0 : std::pow(10.0, -4 * static_cast<double>(random.uniform()));
      beam.near = i % 5 == 0 ? random.uniform() : 0;
      beam.width = i % 4 == 0 ? 0.1 * static_cast<double>(random.uniform()) : 0;
      const double until = clear_until(scene.grid, beam);
      ASSERT_GE(until, beam.near);
      clear += until > beam.near;
      never += until == kNever;
      for (int r = 0; r < 20; ++r) {
        Ray ray;
        ray.origin = beam.origin + random_direction(random) * beam.width;
        ray.direction = direction_within(beam, random);
        ray.near = beam.near;
        RaySamples samples;
        sampler.sample_all(ray, 1, samples);
        const std::vector<Segment> plain(sampler.segments().begin(), sampler.segments().end());
        if (!plain.empty()) {
          ASSERT_GE(sampler.start() + static_cast<double>(plain.front().t0), until)
              << scene.name << ", beam " << i;
        }
        ray.clear = until;
        sampler.sample_all(ray, 1, samples);
        ASSERT_TRUE(same(plain, sampler.segments())) << scene.name << ", beam " << i;
      }
    }
    // From outside at least the way to the grid is clear.
    EXPECT_GE(clear, 150) << scene.name;
    EXPECT_GE(never, 20) << scene.name;
  }
}

// Towards the only brick with matter the beam ends by less than a brick's width, a cell's and its
// own before it; beside it, never.
TEST(Beam, EndsBeforeALonelyBrick) {
  const OccupancyGrid grid = make_grid(1, [](const CellPlace& p) -> uint8_t {
    return p.x / 4 == 20 && p.y / 4 == 20 && p.z / 4 == 20 ? 200 : 0;
  });
  const double cell = grid.cell_width(0), brick = 4 * cell;
  const double face = 4 * brick;  // its lower x; the grid's 32 bricks begin at -1
  const Vec3d middle{face + brick / 2, face + brick / 2, face + brick / 2};
  for (double from : {-3.0, -1.0, -0.3, 0.0})
    for (double spread : {0.0, 1e-3, 0.02}) {
      const Beam beam{{from, middle.y, middle.z}, {1, 0, 0}, spread, 0};
      const double distance = face - from, until = clear_until(grid, beam);
      EXPECT_LE(until, distance);
      EXPECT_GE(until, distance - (brick + cell + distance * spread) * (1 + spread) - 1e-4)
          << from << ", " << spread;
      Beam beside = beam;
      beside.origin.y -= brick + 3 * spread * distance + 2 * cell;
      EXPECT_EQ(clear_until(grid, beside), kNever) << from << ", " << spread;
      Beam behind = beam;
      behind.near = 5;
      EXPECT_EQ(clear_until(grid, behind), kNever);
    }
}

TEST(Beam, MeetsNothingInAnEmptyGridAndStopsAtOnceInAFullOne) {
  const auto all = [](uint8_t level) {
    return make_grid(2, [level](const CellPlace&) -> uint8_t { return level; }, 16);
  };
  const Beam beam{{0.1, 0.2, 0.3}, {0, 0, 1}, 0.1, 0.25};
  EXPECT_EQ(clear_until(all(0), beam), kNever);
  EXPECT_EQ(clear_until(all(9), beam), 0.25);
  for (const double bad : {kNever, -kNever, std::nan("")}) {
    Beam broken = beam;
    broken.origin.x = bad;
    EXPECT_FALSE(clear_until(all(9), broken) < 0.25);  // comes to an end
    broken = beam;
    broken.spread = std::abs(bad);
    EXPECT_EQ(clear_until(all(9), broken), 0.25);
  }
}

}  // namespace
}  // namespace nerf
