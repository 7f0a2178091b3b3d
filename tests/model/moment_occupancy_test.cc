// Which cells of a moving scene are in use at one moment.
#include "model/moment_occupancy.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "analytic_field.h"
#include "nerf/model/integrator.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"

namespace nerf {
namespace {

constexpr double kRadius = 0.5;
constexpr int64_t kManyRays = int64_t{1} << 40;

double distance_of(const Vec3d& p) { return length(p) - kRadius; }

// A ball that never moves in a scene that does, of which all cells are in use.
std::shared_ptr<GridField> ball() {
  MotionShape motion;
  motion.warp.kind = WarpKind::kTranslation;
  motion.warp.position_degrees = motion.warp.depth = 2;
  motion.warp.width = 16;
  motion.time_code = 4;
  motion.time_degrees = 2;
  motion.time_width = 16;
  const RadianceField field = test::surface_field({}, distance_of, motion);
  auto grid = std::make_shared<GridField>(field.grid());
  grid->occupancy.set_levels(std::vector<uint8_t>(grid->occupancy.levels().size(), 200));
  return grid;
}

TEST(MomentOccupancy, KeepsCellsNearMatterAndDropsTheOthers) {
  const auto grid = ball();
  ThreadPool pool(2);
  const auto found =
      internal::occupancy_at(*grid, Precision::kF32, 0.3_r, kManyRays, pool, nullptr);
  ASSERT_TRUE(found);
  const double width = static_cast<double>(found->cell_width(0));
  int64_t inside = 0, outside = 0;
  for (int64_t cell = 0; cell < found->cells(); ++cell) {
    const Vec3d middle =
        found->cell_corner(cell, 0).cast<double>() + Vec3d{1, 1, 1} * (0.5 * width);
    const uint8_t level = found->levels()[static_cast<size_t>(cell)];
    const double distance = distance_of(middle);
    // Half a cell's diagonal inside there is nothing but matter.
    if (distance < -0.87 * width) {
      ASSERT_EQ(level, 200) << cell;
      ++inside;
    }
    // A point of its block or the next is up to four cells away along each axis. Densities fall by
    // exp(2000 d), to a ten thousandth within a cell's width.
    if (distance > (4 * 1.7321 + 1) * width) {
      ASSERT_EQ(level, 0) << cell;
      ++outside;
    }
  }
  EXPECT_GT(inside, 100000);
  EXPECT_GT(outside, 1000000);
}

TEST(MomentOccupancy, IsNotLookedForWhereItCannotPay) {
  ThreadPool pool(1);
  const RadianceField still = test::surface_field({}, distance_of);
  EXPECT_FALSE(internal::occupancy_at(still.grid(), Precision::kF32, 0, kManyRays, pool, nullptr));
  EXPECT_FALSE(internal::occupancy_at(*ball(), Precision::kF32, 0, 1000, pool, nullptr));
}

TEST(MomentOccupancy, IsTheSameForAnyNumberOfThreads) {
  const auto grid = ball();
  ThreadPool one(1), three(3);
  const auto a = internal::occupancy_at(*grid, Precision::kF32, 0.3_r, kManyRays, one, nullptr);
  const auto b = internal::occupancy_at(*grid, Precision::kF32, 0.3_r, kManyRays, three, nullptr);
  ASSERT_TRUE(a && b);
  EXPECT_TRUE(std::ranges::equal(a->levels(), b->levels()));
}

TEST(MomentOccupancy, PicturesOfItAreThoseOfAllCells) {
  const RadianceField field(ModelInfo(), ball());
  ThreadPool pool(2);
  const Camera camera = test::pinhole(700, 600, 600);
  Pose pose;
  pose.translation = {0, 0, -1.5};
  RenderOptions options;
  options.precision = Precision::kF32;
  options.interpolated = 0;
  options.supersample = 1;
  const Frame frame = render(field, camera, pose, options, pool);
  std::vector<Ray> rays;
  for (int x = 0; x < camera.width; ++x) {
    Ray ray = *camera_ray(camera, pose, {x + 0.5, 300.5});
    ray.background = options.background;
    rays.push_back(ray);
  }
  const RayResults all = integrate(field, rays, {}, options, pool);
  double seen = 0;
  for (size_t x = 0; x < rays.size(); ++x) {
    const size_t pixel = 300 * rays.size() + x;
    EXPECT_NEAR(frame.alpha[pixel], all.opacity[x], 0.02) << x;
    seen += frame.alpha[pixel];
  }
  EXPECT_GT(seen, 300);
  EXPECT_LT(static_cast<double>(frame.statistics.density_evaluations) / 600,
            0.6 * static_cast<double>(all.statistics.density_evaluations));
}

}  // namespace
}  // namespace nerf
