// Motion interpolated on a lattice against motion that is found point by point.
#include "model/motion_lattice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <thread>
#include <vector>

#include "nerf/math/random.h"

namespace nerf {
namespace {

using internal::LatticeMotion;
using internal::MotionLattice;
using Points = std::vector<Vec3>;

// A scene whose points move by a tenth of its width or so.
GridField moving_field(int occupancy_side, int degrees, int depth) {
  GridOptions options;
  options.levels = 1;
  options.log2_entries = 10;
  options.base_resolution = options.finest_resolution = 8;
  options.occupancy_side = occupancy_side;
  MotionShape motion;
  motion.warp.kind = WarpKind::kTranslation;
  motion.warp.position_degrees = degrees;
  motion.warp.depth = depth;
  motion.warp.width = 16;
  motion.warp.last_bound = 0.3_r;
  motion.time_code = 4;
  motion.time_degrees = 2;
  motion.time_width = 16;
  GridField field(options, /*unbounded=*/false, 1, GridParts{.motion = motion});
  field.initialise(3);
  return field;
}

Points random_points(int n, uint64_t stream) {
  Points points;
  Random random(5, stream, 0);
  for (int i = 0; i < n; ++i) {
    const Real x = random.uniform(), y = random.uniform();
    points.push_back({x, y, random.uniform()});
  }
  return points;
}

// By chunks of `at_once` points.
template <class Motion, class Forward>
Points moved(Motion& motion, const Points& points, int at_once, const Forward& forward) {
  Points out;
  for (size_t first = 0; first < points.size(); first += static_cast<size_t>(at_once)) {
    const int n = static_cast<int>(std::min(points.size() - first, static_cast<size_t>(at_once)));
    alignas(64) Real x[3][kChunkSamples] = {};
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < 3; ++k) x[k][i] = points[first + static_cast<size_t>(i)][k];
    forward(motion, x, n);
    for (int i = 0; i < n; ++i)
      out.push_back({motion.canonical(0)[i], motion.canonical(1)[i], motion.canonical(2)[i]});
  }
  return out;
}

Points by_lattice(const GridField& field, MotionLattice& lattice, const Points& points,
                  int at_once = kChunkSamples) {
  LatticeMotion motion(lattice, field, nullptr);
  return moved(motion, points, at_once,
               [](auto& m, auto& x, int n) { m.forward(x[0], x[1], x[2], n); });
}

Points one_by_one(const GridField& field, Real time, const Points& points) {
  MotionChunk motion(field, nullptr);
  return moved(motion, points, kChunkSamples, [time](auto& m, auto& x, int n) {
    const int32_t ray_begin[] = {0, n};
    m.forward(x[0], x[1], x[2], n, 1, ray_begin, &time);
  });
}

double error(const Points& a, const Points& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i)
    sum += dot((a[i] - b[i]).cast<double>(), (a[i] - b[i]).cast<double>());
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(MotionLattice, AffineMotionIsExact) {
  GridField field = moving_field(64, /*degrees=*/0, /*depth=*/1);
  // So far above 0 that no ReLU cuts anything off.
  const LinearWeights& hidden = field.motion.warp.hidden[0];
  for (int row = 0; row < hidden.out; ++row)
    field.weights[hidden.bias_offset() + static_cast<size_t>(row)] = 4;
  const Points points = random_points(1000, 1);
  MotionLattice lattice(field, 0.4_r);
  const Points exact = one_by_one(field, 0.4_r, points);
  EXPECT_LT(error(by_lattice(field, lattice, points), exact), 1e-6);
  EXPECT_GT(error(exact, points), 0.05);
}

// With the step h, that of cubes with a kink of the network falls as h, their share as h: their
// root mean square as h^1.5. Elsewhere it falls as h^2.
TEST(MotionLattice, ErrorFallsWithTheStep) {
  const Points points = random_points(20000, 2);
  double errors[2];
  for (const int i : {0, 1}) {
    const GridField field = moving_field(64 << i, /*degrees=*/3, /*depth=*/2);
    MotionLattice lattice(field, 0.7_r);
    EXPECT_EQ(lattice.side(), (32 << i) + 1);
    errors[i] = error(by_lattice(field, lattice, points), one_by_one(field, 0.7_r, points));
  }
  EXPECT_GT(errors[0], 2.7 * errors[1]);
  EXPECT_LT(errors[0], 4 * errors[1]);
}

TEST(MotionLattice, OnlyCornersAroundSamplesAreFound) {
  const GridField field = moving_field(64, 2, 2);
  MotionLattice lattice(field, 0);
  EXPECT_EQ(lattice.found(), 0);
  by_lattice(field, lattice, {{0.01_r, 0.01_r, 0.01_r}});
  EXPECT_EQ(lattice.found(), 8);
  // A neighbour shares a side with it.
  by_lattice(field, lattice, {{0.01_r, 0.01_r, 0.01_r}, {0.04_r, 0.01_r, 0.01_r}});
  EXPECT_EQ(lattice.found(), 12);
  // The ends of space belong to its last cubes.
  const Points ends = {{0, 0, 0}, {1, 1, 1}};
  EXPECT_LT(error(by_lattice(field, lattice, ends), one_by_one(field, 0, ends)), 1e-6);
  EXPECT_EQ(lattice.found(), 20);
}

TEST(MotionLattice, ThreadsThatAskAtOnceGetTheSameBits) {
  const GridField field = moving_field(64, 3, 2);
  const Points points = random_points(3000, 3);
  MotionLattice alone(field, 0.2_r), shared(field, 0.2_r);
  const Points truth = by_lattice(field, alone, points);
  std::vector<Points> found(4);
  std::vector<std::thread> threads;
  for (size_t t = 0; t < found.size(); ++t)
    threads.emplace_back([&, t] {
      Points own = points;
      // Each begins elsewhere, by chunks of its own size.
      const auto shift = static_cast<std::ptrdiff_t>(t * 700);
      std::rotate(own.begin(), own.begin() + shift, own.end());
      found[t] = by_lattice(field, shared, own, kChunkSamples - 31 * static_cast<int>(t));
      std::rotate(found[t].begin(), found[t].end() - shift, found[t].end());
    });
  for (std::thread& t : threads) t.join();
  for (const Points& of_thread : found)
    for (size_t i = 0; i < points.size(); ++i)
      for (int k = 0; k < 3; ++k) ASSERT_EQ(of_thread[i][k], truth[i][k]) << i;
  EXPECT_EQ(shared.found(), alone.found());
}

}  // namespace
}  // namespace nerf
