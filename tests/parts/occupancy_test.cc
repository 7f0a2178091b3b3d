#include "nerf/parts/occupancy.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>
#include <vector>

#include "nerf/math/random.h"
#include "parts/occupancy_pattern.h"

namespace nerf {
namespace {

constexpr int kSide = OccupancyGrid::kDefaultSide;
constexpr int64_t kCells = int64_t{kSide} * kSide * kSide;

TEST(Occupancy, CellAndCornerAreInverse) {
  for (int side : {16, 48, 128, 256}) {
    const OccupancyGrid grid(1, side);
    ASSERT_EQ(grid.cells(), int64_t{side} * side * side);
    for (int c = 0; c < 4; ++c) {
      const Real w = grid.cell_width(c);
      EXPECT_EQ(w, std::ldexp(2.0_r / static_cast<Real>(side), c));
      for (int64_t cell = 0; cell < grid.cells(); ++cell) {
        const Vec3 corner = grid.cell_corner(cell, c);
        const Real in = 0.001_r * w, out = 0.999_r * w;  // corners of 48 cells are rounded
        ASSERT_EQ(grid.cell_of(corner + Vec3{in, in, in}, c), cell);
        ASSERT_EQ(grid.cell_of(corner + Vec3{out, out, out}, c), cell);
        if (side != 48) {
          ASSERT_EQ(grid.cell_of(corner, c), cell);
        }
      }
    }
  }
}

TEST(Occupancy, SidesAreMultiplesOfSixteen) {
  for (int side : {0, 8, 100, 528}) EXPECT_THROW(OccupancyGrid(1, side), std::logic_error);
}

TEST(Occupancy, CellsAreStoredBrickByBrick) {
  const OccupancyGrid grid;
  for (int64_t brick : {0, 1, 31, 32, 1024, 32767}) {
    const CellPlace first = place_of(grid, brick * 64, 0);
    EXPECT_EQ(first.x % 4 + first.y % 4 + first.z % 4, 0);
    std::set<std::array<int, 3>> seen;
    for (int64_t i = 0; i < 64; ++i) {
      const CellPlace p = place_of(grid, brick * 64 + i, 0);
      EXPECT_EQ(p.x / 4, first.x / 4);
      EXPECT_EQ(p.y / 4, first.y / 4);
      EXPECT_EQ(p.z / 4, first.z / 4);
      seen.insert({p.x, p.y, p.z});
    }
    EXPECT_EQ(seen.size(), 64u);
  }
}

TEST(Occupancy, PointsBeyondTheCascadeFallIntoItsOutermostCells) {
  const OccupancyGrid grid;
  const CellPlace p = place_of(grid, grid.cell_of({1.0_r, -1.001_r, 5.0_r}, 0), 0);
  EXPECT_EQ(p.x, kSide - 1);
  EXPECT_EQ(p.y, 0);
  EXPECT_EQ(p.z, kSide - 1);
}

TEST(Occupancy, CascadeOfAPoint) {
  const OccupancyGrid grid(3);
  const Real below = std::nextafter(1.0_r, 0.0_r);
  EXPECT_EQ(grid.cascade_of({0, 0, 0}), 0);
  EXPECT_EQ(grid.cascade_of({below, -below, 0}), 0);
  EXPECT_EQ(grid.cascade_of({0, 1, 0}), 1);
  EXPECT_EQ(grid.cascade_of({0, -1, 0}), 0) << "lower borders belong to it, as in cells";
  EXPECT_EQ(grid.cascade_of({std::nextafter(-1.0_r, -2.0_r), 0, 0}), 1);
  EXPECT_EQ(grid.cascade_of({0, 0, -2 * below}), 1);
  EXPECT_EQ(grid.cascade_of({2.5_r, 0, 0}), 2);
  EXPECT_EQ(grid.cascade_of({0, 4, 0}), 3) << "none: as many as there are";
  EXPECT_EQ(grid.cascade_of({1e30_r, 0, 0}), 3);
  for (int i = 0; i < 3; ++i) {
    Vec3 p{0, 0, 0};
    p[i] = Real{NAN};
    EXPECT_EQ(grid.cascade_of(p), 3);
  }
}

TEST(Occupancy, ObserveMovesPartOfTheWayToWhatIsSeen) {
  OccupancyGrid grid;
  const int64_t cell = 12345;
  const Real start = grid.opacity(0, cell);
  EXPECT_GT(start, 0) << "unknown cells count as occupied";
  grid.observe(0, cell, 0.8_r);
  const Real up = grid.opacity(0, cell);
  EXPECT_GT(up, start);
  EXPECT_LT(up, 0.8_r);
  grid.observe(0, cell, 0.0_r);
  const Real down = grid.opacity(0, cell);
  EXPECT_LT(down, up);
  EXPECT_GT(down, 0);
  grid.observe(0, cell, down);
  EXPECT_FLOAT_EQ(grid.opacity(0, cell), down) << "seeing what is known changes nothing";
  for (int i = 0; i < 200; ++i) grid.observe(0, cell, 0.37_r);
  EXPECT_NEAR(grid.opacity(0, cell), 0.37_r, 1e-5);
  EXPECT_EQ(grid.opacity(0, cell + 1), start) << "no other cell moves";

  for (Real bad : {Real{NAN}, -0.5_r, -std::numeric_limits<Real>::infinity()}) {
    grid.observe(0, cell, bad);
    EXPECT_NEAR(grid.opacity(0, cell), 0.37_r, 1e-5);
  }
}

TEST(Occupancy, OffStaysOff) {
  OccupancyGrid grid(2);
  grid.switch_off(1, 77);
  EXPECT_TRUE(grid.is_off(1, 77));
  EXPECT_FALSE(grid.is_off(0, 77));
  for (int i = 0; i < 100; ++i) grid.observe(1, 77, 1.0_r);
  EXPECT_TRUE(grid.is_off(1, 77));
  grid.rebuild(0);
  EXPECT_EQ(grid.levels()[static_cast<size_t>(kCells + 77)], 0);
  EXPECT_GT(grid.levels()[77], 0);
}

// Masks, thickness, fraction and box are those of the levels.
void expect_consistent(const OccupancyGrid& grid) {
  int64_t occupied = 0;
  Box3 box;
  for (int c = 0; c < grid.cascades(); ++c)
    for (int64_t brick = 0; brick < kCells / 64; ++brick) {
      const uint64_t mask = grid.brick_mask(c, brick);
      for (int64_t i = 0; i < 64; ++i) {
        const uint8_t level = grid.levels()[static_cast<size_t>(c * kCells + brick * 64 + i)];
        ASSERT_EQ(mask >> i & 1, level != 0) << "cascade " << c << " brick " << brick;
        const Real thickness = grid.thickness(c, brick * 64 + i);
        ASSERT_EQ(thickness > 0, level != 0);
        occupied += level != 0;
      }
      if (mask == 0) continue;
      const Vec3 corner = grid.cell_corner(brick * 64, c);
      const Real w = 4 * grid.cell_width(c);
      box.extend(corner.cast<double>());
      box.extend((corner + Vec3{w, w, w}).cast<double>());
    }
  EXPECT_DOUBLE_EQ(grid.occupied_fraction(),
                   static_cast<double>(occupied) / static_cast<double>(grid.levels().size()));
  EXPECT_EQ(grid.occupied_box().min, box.min);
  EXPECT_EQ(grid.occupied_box().max, box.max);
  EXPECT_EQ(grid.occupied_box().empty(), occupied == 0);
}

TEST(Occupancy, NewGridIsOccupiedEverywhere) {
  const OccupancyGrid grid(2);
  EXPECT_EQ(grid.occupied_fraction(), 1.0);
  expect_consistent(grid);
}

// Thickness is -log(1 - opacity) of the quantised opacity (level / 255)^2.
TEST(Occupancy, LevelsQuantiseOpacity) {
  OccupancyGrid grid;
  std::vector<Real> opacities;
  for (int i = 0; i <= 200; ++i) opacities.push_back(std::pow(static_cast<Real>(i) / 200, 2.0_r));
  for (size_t i = 0; i < grid.training_state().size(); ++i)
    grid.training_state()[i] = opacities[i % opacities.size()];
  grid.rebuild(1e-9_r);
  Real before = 0;
  for (size_t i = 1; i < opacities.size(); ++i) {
    const double level = grid.levels()[i];
    EXPECT_LE(std::fabs(level - 255 * std::sqrt(static_cast<double>(opacities[i]))), 0.501) << i;
    const double opacity = std::min(level * level / (255.0 * 255.0), 0.9999);
    const Real thickness = grid.thickness(0, static_cast<int64_t>(i));
    EXPECT_NEAR(thickness, -std::log1p(-opacity), 1e-3 * thickness) << i;
    EXPECT_GE(thickness, before);
    EXPECT_TRUE(std::isfinite(thickness));
    before = thickness;
  }
}

// Occupied is what reaches min(threshold, mean of the cells that are on), and whatever shares a
// face with a cell that is itself solid; brute force over all cells by their integer places.
TEST(Occupancy, RebuildAgainstBruteForce) {
  constexpr Real kSolid = 0.1_r;
  for (Real threshold : {0.01_r, 0.9_r}) {  // the second above the mean
    OccupancyGrid grid(2);
    Random random(8, static_cast<uint64_t>(1000 * threshold), 0);
    for (Real& a : grid.training_state()) {
      const Real kind = random.uniform();
      a = kind < 0.1_r ? -1.0_r : kind < 0.12_r ? random.uniform() : 0.03_r * random.uniform();
    }
    ThreadPool pool(2);
    OccupancyGrid pooled(2);
    std::copy(grid.training_state().begin(), grid.training_state().end(),
              pooled.training_state().begin());
    grid.rebuild(threshold);
    pooled.rebuild(threshold, &pool);
    EXPECT_TRUE(std::ranges::equal(grid.levels(), pooled.levels()));
    double sum = 0;
    int64_t on = 0;
    for (Real a : grid.training_state())
      if (a >= 0) sum += a, ++on;
    const Real limit = std::min(threshold, static_cast<Real>(sum / static_cast<double>(on)));
    int64_t kept = 0;
    for (int c = 0; c < 2; ++c) {
      std::vector<Real> by_place(static_cast<size_t>(kCells));
      const auto at = [&](int x, int y, int z) -> Real {
        if (std::min({x, y, z}) < 0 || std::max({x, y, z}) >= kSide) return 0;
        return by_place[static_cast<size_t>((z * kSide + y) * kSide + x)];
      };
      for (int64_t cell = 0; cell < kCells; ++cell) {
        const CellPlace p = place_of(grid, cell, c);
        by_place[static_cast<size_t>((p.z * kSide + p.y) * kSide + p.x)] = grid.opacity(c, cell);
      }
      for (int64_t cell = 0; cell < kCells; ++cell) {
        const CellPlace p = place_of(grid, cell, c);
        const Real a = grid.opacity(c, cell);
        const bool beside_solid =
            a >= kSolid || at(p.x - 1, p.y, p.z) >= kSolid || at(p.x + 1, p.y, p.z) >= kSolid ||
            at(p.x, p.y - 1, p.z) >= kSolid || at(p.x, p.y + 1, p.z) >= kSolid ||
            at(p.x, p.y, p.z - 1) >= kSolid || at(p.x, p.y, p.z + 1) >= kSolid;
        const bool want = a >= 0 && (a >= limit || beside_solid);
        ASSERT_EQ(grid.levels()[static_cast<size_t>(c * kCells + cell)] != 0, want)
            << "cascade " << c << " cell " << p.x << ' ' << p.y << ' ' << p.z << " opacity " << a;
        kept += want && a < limit;
      }
    }
    EXPECT_GT(kept, 0) << "some cells are occupied for their neighbour's sake";
    expect_consistent(grid);
  }
}

// The distance to the nearest brick with matter, or that a finer cascade answers for.
TEST(Occupancy, ClearanceAgainstBruteForce) {
  constexpr int kSide = 64, kCascades = 2;
  OccupancyGrid grid(kCascades, kSide);
  const int n = grid.bricks();
  std::vector<uint8_t> levels(grid.levels().size(), 0);
  const auto set = [&](int c, int x, int y, int z) {  // one cell of that brick
    const int64_t brick = (int64_t{z} * n + y) * n + x;
    levels[static_cast<size_t>(c * grid.cells() + brick * 64 + (x + y + z) % 64)] = 9;
  };
  set(0, 0, 0, 0);
  set(0, 15, 3, 1);
  set(0, 2, 9, 7);
  set(1, 1, 14, 3);
  grid.set_levels(levels);
  int farthest = 0;
  for (int c = 0; c < kCascades; ++c) {
    const auto keep_clear_of = [&](int x, int y, int z) {
      const auto inner = [&](int i) { return i >= n / 4 && i < n - n / 4; };
      return grid.brick_mask(c, (int64_t{z} * n + y) * n + x) != 0 ||
             (c > 0 && inner(x) && inner(y) && inner(z));
    };
    std::vector<std::array<int, 3>> places;
    for (int z = 0; z < n; ++z)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x)
          if (keep_clear_of(x, y, z)) places.push_back({x, y, z});
    for (int z = 0; z < n; ++z)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) {
          int nearest = OccupancyGrid::kMostClearance;
          for (const auto& p : places)
            nearest = std::min(
                nearest, std::max({std::abs(p[0] - x), std::abs(p[1] - y), std::abs(p[2] - z)}));
          EXPECT_EQ(grid.clearance(c, (int64_t{z} * n + y) * n + x), nearest)
              << c << ": " << x << ' ' << y << ' ' << z;
          farthest = std::max(farthest, nearest);
        }
  }
  EXPECT_EQ(farthest, OccupancyGrid::kMostClearance);
}

TEST(Occupancy, AllOffIsAllEmpty) {
  OccupancyGrid grid;
  for (int64_t i = 0; i < kCells; ++i) grid.switch_off(0, i);
  grid.rebuild(0.01_r);
  EXPECT_EQ(grid.occupied_fraction(), 0.0);
  expect_consistent(grid);
}

TEST(Occupancy, LevelsAndStateRoundTrip) {
  OccupancyGrid grid(2);
  Random random(9, 0, 0);
  for (Real& a : grid.training_state()) a = random.uniform() < 0.7_r ? -1.0_r : random.uniform();
  grid.rebuild(0.01_r);
  OccupancyGrid from_levels(2), from_state(2);
  from_levels.set_levels(grid.levels());
  std::copy(grid.training_state().begin(), grid.training_state().end(),
            from_state.training_state().begin());
  from_state.rebuild(0.01_r);
  for (const OccupancyGrid* other : {&from_levels, &from_state}) {
    EXPECT_TRUE(std::equal(grid.levels().begin(), grid.levels().end(), other->levels().begin()));
    EXPECT_EQ(other->occupied_fraction(), grid.occupied_fraction());
    EXPECT_EQ(other->brick_mask(1, 4711), grid.brick_mask(1, 4711));
    expect_consistent(*other);
  }
  EXPECT_THROW(from_levels.set_levels(grid.levels().first(100)), std::logic_error);
}

// Matter of one moment in twenty keeps a cell in use; what thins out soon does not.
TEST(Occupancy, RemembersTheMomentsOfAScene) {
  OccupancyGrid mean(1, 16), most(1, 16);
  most.remember_moments();
  for (OccupancyGrid* grid : {&mean, &most}) {
    for (int64_t cell = 0; cell < grid->cells(); ++cell)
      for (int i = 0; i < 8; ++i) grid->observe(0, cell, 0.0_r);
    grid->observe(0, 5, 0.8_r);
    for (int i = 0; i < 60; ++i) grid->observe(0, 5, 0.0_r);
    grid->rebuild(0.01_r);
  }
  EXPECT_EQ(mean.thickness(0, 5), 0);
  EXPECT_GT(most.thickness(0, 5), 0);
  EXPECT_EQ(most.thickness(0, 40), 0);
  // What rays see of a cell is its mean.
  EXPECT_EQ(mean.opacity(0, 5), most.opacity(0, 5));
  for (int i = 0; i < 100; ++i) most.observe(0, 5, 0.0_r);
  most.rebuild(0.01_r);
  EXPECT_EQ(most.thickness(0, 5), 0);
}

}  // namespace
}  // namespace nerf
