// What the grid method's switches save or add, by the counters of a training's work. That every
// option changes something, every_option_test.cc asserts.
#include <gtest/gtest.h>

#include <functional>

#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

constexpr int kSteps = 80;

struct Work {
  int64_t rays = 0, samples = 0, colours = 0, learning = 0, rows = 0;
};

Work work_of(const test::SyntheticCapture& c, const std::function<void(TrainOptions&)>& change) {
  ThreadPool pool(2);
  TrainOptions options = test::tiny_options(kSteps);
  change(options);
  Trainer trainer(c.scene, c.photos, options, pool);
  Work work;
  trainer.run([&](const StepReport& r) {
    work.rays += r.rays;
    work.samples += r.samples;
    work.colours += r.colours;
    work.learning += r.learning;
    work.rows += r.rows;
    return true;
  });
  return work;
}

double samples_per_ray(const Work& w) {
  return static_cast<double>(w.samples) / static_cast<double>(w.rays);
}

TEST(GridSwitches, SaveSamplesOfARay) {
  const auto c = test::sphere_capture(8, 32);
  const double usual = samples_per_ray(work_of(c, [](TrainOptions&) {}));
  const auto of = [&](const std::function<void(TrainOptions&)>& change) {
    return samples_per_ray(work_of(c, change));
  };
  EXPECT_GT(of([](TrainOptions& o) { o.grid_recipe.early_samples = 1; }), usual);
  EXPECT_LT(of([](TrainOptions& o) { o.grid.sampler.samples_per_cell = 1; }), usual);
  EXPECT_LT(of([](TrainOptions& o) { o.grid.sampler.max_samples = 8; }), usual);
  EXPECT_GT(of([](TrainOptions& o) { o.grid.sampler.min_samples = 8; }), usual);
  const double emptier = of([](TrainOptions& o) { o.grid_recipe.occupancy_threshold = 0.2; });
  EXPECT_LT(emptier, usual);
  EXPECT_GT(of([](TrainOptions& o) { o.grid_recipe.occupancy_threshold = 0; }), emptier);
  EXPECT_GT(of([](TrainOptions& o) { o.grid_recipe.keep_transparent = true; }), usual);
}

// One camera sees a part of the region only, and behind the sphere's outline nothing transparent.
TEST(GridSwitches, KeepCellsThatCannotHoldMatter) {
  auto c = test::sphere_capture(8, 32);
  c.scene.train.resize(1);
  const auto occupied = [&](bool unseen, bool transparent) {
    ThreadPool pool(2);
    TrainOptions options = test::tiny_options(kSteps);
    options.grid_recipe.keep_unseen = unseen;
    options.grid_recipe.keep_transparent = transparent;
    return Trainer(c.scene, c.photos, options, pool)
        .snapshot()
        .grid()
        .occupancy.occupied_fraction();
  };
  const double usual = occupied(false, false);
  EXPECT_GT(usual, 0);
  EXPECT_GT(occupied(true, false), usual);
  EXPECT_GT(occupied(false, true), usual);
  EXPECT_LT(occupied(true, false), 1);
  EXPECT_LT(occupied(false, true), 1);
  EXPECT_EQ(occupied(true, true), 1);
}

TEST(GridSwitches, SaveColours) {
  const auto c = test::sphere_capture(8, 32);
  const Work usual = work_of(c, [](TrainOptions&) {});
  const auto colours_of = [&](const std::function<void(TrainOptions&)>& change) {
    const Work w = work_of(c, change);
    return static_cast<double>(w.colours) / static_cast<double>(w.samples);
  };
  const double share = static_cast<double>(usual.colours) / static_cast<double>(usual.samples);
  EXPECT_LT(share, 0.8);
  EXPECT_EQ(colours_of([](TrainOptions& o) { o.grid_recipe.shared_colour = 0; }), 1);
  EXPECT_GT(colours_of([](TrainOptions& o) { o.grid_recipe.shared_colour = 0.02; }), share);
  EXPECT_LT(colours_of([](TrainOptions& o) { o.grid_recipe.shared_colour = 0.5; }), share);
}

TEST(GridSwitches, SaveGradients) {
  const auto c = test::sphere_capture(8, 32);
  const auto learning = [&](const std::function<void(TrainOptions&)>& change) {
    const Work w = work_of(c, change);
    return static_cast<double>(w.learning) / static_cast<double>(w.samples);
  };
  const double usual = learning([](TrainOptions&) {});
  EXPECT_GT(usual, 0);
  const double all = learning([](TrainOptions& o) { o.grid_recipe.gradient_roulette = 0; });
  EXPECT_LE(all, 1);
  EXPECT_GT(all, 1.2 * usual);
  EXPECT_LT(learning([](TrainOptions& o) { o.grid_recipe.gradient_roulette = 4; }), 0.8 * usual);
  EXPECT_LT(learning([](TrainOptions& o) {
              o.grid_recipe.gradient_roulette = 0;
              o.grid_recipe.stop_transmittance = 0.3;
            }),
            all);
}

// Of all rows that Adam could move, it moves those that the step's samples touched.
TEST(GridSwitches, SaveRowsOfTheOptimiser) {
  const auto c = test::sphere_capture(8, 32);
  const Work usual = work_of(c, [](TrainOptions&) {});
  const uint64_t all = kSteps * hash_grid_shape(test::tiny_options(kSteps).grid).rows;
  EXPECT_GT(usual.rows, 0);
  EXPECT_LT(static_cast<uint64_t>(usual.rows), all);
}

}  // namespace
}  // namespace nerf
