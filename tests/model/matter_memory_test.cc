// Empty space that a training finds by itself, and what its rays leave out there.
#include "model/matter_memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "model/octahedron.h"
#include "nerf/model/network_levels.h"
#include "support/network_options.h"
#include "support/network_rays.h"

namespace nerf {
namespace {

using internal::MatterMemory;
using test::small_network;

constexpr Real kCell = 2.0_r / MatterMemory::kSide;

bool holds(const MatterMemory& memory, const Vec3& p) { return memory.cells().may_hold(p, true); }

TEST(MatterMemory, FindsEmptyWhatNothingWasFoundInForSoLong) {
  constexpr int kSteps = 40;  // looks every second step
  ThreadPool pool(2);
  MatterMemory memory(kSteps);
  const Vec3 matter{0.5_r * kCell, 0.5_r * kCell, 0.5_r * kCell}, other{0.5, 0.5, 0.5};
  for (int step = 1; step < kSteps; ++step) {
    if (step <= 10) memory.mark(MatterMemory::cell_of(matter));
    memory.advance(step, pool);
    EXPECT_TRUE(holds(memory, matter) && holds(memory, other)) << step;
  }
  memory.advance(kSteps, pool);
  EXPECT_FALSE(holds(memory, other));
  // The cell and its 26 neighbours, and nothing more of this grid; the coarser one is asked
  // outside it alone.
  int64_t held = 0;
  for (int z = -3; z <= 3; ++z)
    for (int y = -3; y <= 3; ++y)
      for (int x = -3; x <= 3; ++x) {
        const Vec3 p =
            matter + Vec3{static_cast<Real>(x), static_cast<Real>(y), static_cast<Real>(z)} * kCell;
        held += holds(memory, p);
        EXPECT_EQ(holds(memory, p), std::max({std::abs(x), std::abs(y), std::abs(z)}) <= 1);
      }
  EXPECT_EQ(held, 27);
  for (int step = kSteps + 1; step < 10 + kSteps; ++step) memory.advance(step, pool);
  EXPECT_TRUE(holds(memory, matter));
  memory.advance(10 + kSteps, pool);
  EXPECT_FALSE(holds(memory, matter));
  // Outside of all grids nobody looks.
  EXPECT_TRUE(holds(memory, {0, 0, 2.5}));
  EXPECT_FALSE(holds(memory, {0, 0, 1.5}));
  memory.forget();
  EXPECT_TRUE(holds(memory, matter) && holds(memory, {0, 0, 1.5}));
}

// Between two looks the marks since the last one are not yet what cells are told by.
TEST(MatterMemory, ItsStateContinues) {
  constexpr int kSteps = 32;
  ThreadPool pool(1);
  MatterMemory memory(kSteps), second(kSteps);
  const Vec3 a{0.1, 0.2, 0.3}, b{-0.5, 0.2, 0.1};
  for (int step = 1; step <= kSteps; ++step) {
    memory.mark(MatterMemory::cell_of(a));
    memory.advance(step, pool);
  }
  memory.mark(MatterMemory::cell_of(b));
  memory.advance(kSteps + 1, pool);
  std::ranges::copy(memory.state(), second.state().begin());
  second.look(pool);
  for (MatterMemory* m : {&memory, &second}) {
    EXPECT_TRUE(holds(*m, a));
    EXPECT_FALSE(holds(*m, b));
    m->advance(kSteps + 2, pool);
    EXPECT_TRUE(holds(*m, b));
  }
}

// Past the octahedron and through it.
std::vector<NetworkRay> rays_around(int count, uint64_t seed) {
  std::vector<NetworkRay> rays = test::some_rays(count, 2);
  for (size_t i = 0; i < rays.size(); ++i) {
    Random random(4, seed, i);
    for (int k = 0; k < 3; ++k) rays[i].origin[k] += 3 * random.uniform() - 1.5_r;
    rays[i].random = random;
  }
  return rays;
}

// A memory of the octahedron, from many rays.
void look_at(const NetworkField& field, MatterMemory& memory, int steps, ThreadPool& pool) {
  NetworkLosses losses;
  losses.negligible = 1e-4_r;
  NetworkLevels levels(field, 5, true, losses);
  levels.skip_empty(&memory);
  for (int step = 1; step <= steps; ++step) {
    for (int i = 0; i < 60; ++i) {
      auto rays = rays_around(5, static_cast<uint64_t>(60 * step + i));
      levels.forward(rays, 1, step % 2 == 0);
    }
    memory.advance(step, pool);
  }
}

// Where the samples of the last level stand at the same places, their colours do.
void expect_colours_in_place(const NetworkLevels& whole, const NetworkLevels& part, int rays) {
  const int last = whole.levels() - 1;
  int compared = 0;
  std::vector<Real> a, b;
  for (int r = 0; r < rays; ++r) {
    if (!std::ranges::equal(whole.posts(last, r), part.posts(last, r))) continue;
    whole.colours(r, a);
    part.colours(r, b);
    for (size_t i = 0; i < a.size(); ++i) {
      if (b[i] == 0) continue;
      EXPECT_EQ(a[i], b[i]) << r << " " << i;
      ++compared;
    }
  }
  EXPECT_GT(compared, 10);
}

class RaysOfATraining : public ::testing::TestWithParam<bool> {};

TEST_P(RaysOfATraining, LeaveOutEmptyCells) {
  const bool cones = GetParam();
  const auto field =
      test::octahedron(small_network(cones ? test::mipnerf_options() : test::nerf_options()));
  ThreadPool pool(2);
  constexpr int kSteps = 32;
  MatterMemory memory(kSteps);
  look_at(*field, memory, kSteps, pool);
  EXPECT_GT(memory.cells().occupied_fraction(), 0.002);
  EXPECT_LT(memory.cells().occupied_fraction(), 0.25);

  NetworkLosses losses;
  losses.negligible = 1e-4_r;
  losses.distortion = 1;
  for (const bool probed : {false, true}) {
    NetworkLevels whole(*field, 5, true, losses), part(*field, 5, true, losses);
    part.skip_empty(&memory);
    auto rays = test::some_rays(5, 2), again = rays, watching = rays;
    for (NetworkRay& r : watching) r.everywhere = true;
    whole.forward(rays, 1, probed);
    EXPECT_EQ(whole.unasked_samples(), 0);
    part.forward(again, 1, probed);
    const int64_t all = 5 * field->options.sampling.all_samples();
    EXPECT_GT(part.unasked_samples(), all / 3);
    double opaque = 0;
    for (int r = 0; r < 5; ++r) {
      Real a[3], b[3], oa, ob;
      whole.pixel(r, a, oa);
      part.pixel(r, b, ob);
      opaque = std::max(opaque, static_cast<double>(oa));
      // Samples of the fine level stand elsewhere where the coarse level's faint light is missing.
      EXPECT_NEAR(oa, ob, 0.02) << r;
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(a[k], b[k], 0.02) << r;
    }
    EXPECT_GT(opaque, 0.9);
    expect_colours_in_place(whole, part, 5);
    AlignedArray<Real> want(field->weights.size()), got(field->weights.size());
    const double loss = whole.backward(want.data());
    EXPECT_NEAR(part.backward(got.data()), loss, 0.02 * loss);
    double norm = 0, difference = 0;
    for (size_t i = 0; i < want.size(); ++i) {
      norm += std::pow(static_cast<double>(want[i]), 2);
      difference += std::pow(static_cast<double>(want[i]) - static_cast<double>(got[i]), 2);
    }
    EXPECT_LT(std::sqrt(difference / norm), 0.02);

    part.forward(watching, 1, probed);
    EXPECT_EQ(part.unasked_samples(), 0);
    for (int r = 0; r < 5; ++r)
      for (int l = 0; l < whole.levels(); ++l)
        EXPECT_TRUE(std::ranges::equal(whole.weights(l, r), part.weights(l, r)));
    AlignedArray<Real> same(field->weights.size());
    EXPECT_EQ(part.backward(same.data()), loss);
    EXPECT_TRUE(std::ranges::equal(want, same));
  }
}

INSTANTIATE_TEST_SUITE_P(PointsAndCones, RaysOfATraining, ::testing::Bool());

}  // namespace
}  // namespace nerf
