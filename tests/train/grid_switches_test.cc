// A switch of the grid method that changes neither the work of a training nor its result would be a
// lie.
#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

constexpr int kSteps = 80;

struct Work {
  int64_t rays = 0, samples = 0, colours = 0, learning = 0, rows = 0;
  std::vector<Real> learnt;
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
  work.learnt = test::learnt_by(trainer);
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
  EXPECT_GT(of([](TrainOptions& o) { o.early_samples = 1; }), usual);
  EXPECT_LT(of([](TrainOptions& o) { o.grid.sampler.samples_per_cell = 1; }), usual);
  EXPECT_LT(of([](TrainOptions& o) { o.grid.sampler.max_samples = 8; }), usual);
  EXPECT_GT(of([](TrainOptions& o) { o.grid.sampler.min_samples = 8; }), usual);
  const double emptier = of([](TrainOptions& o) { o.occupancy_threshold = 0.2; });
  EXPECT_LT(emptier, usual);
  EXPECT_GT(of([](TrainOptions& o) { o.occupancy_threshold = 0; }), emptier);
  EXPECT_GT(of([](TrainOptions& o) { o.keep_transparent = true; }), usual);
}

// One camera sees a part of the region only, and behind the sphere's outline nothing transparent.
TEST(GridSwitches, KeepCellsThatCannotHoldMatter) {
  auto c = test::sphere_capture(8, 32);
  c.scene.train.resize(1);
  const auto occupied = [&](bool unseen, bool transparent) {
    ThreadPool pool(2);
    TrainOptions options = test::tiny_options(kSteps);
    options.keep_unseen = unseen;
    options.keep_transparent = transparent;
    return Trainer(c.scene, c.photos, options, pool).field().occupancy.occupied_fraction();
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
  EXPECT_EQ(colours_of([](TrainOptions& o) { o.shared_colour = 0; }), 1);
  EXPECT_GT(colours_of([](TrainOptions& o) { o.shared_colour = 0.02; }), share);
  EXPECT_LT(colours_of([](TrainOptions& o) { o.shared_colour = 0.5; }), share);
  EXPECT_LT(colours_of([](TrainOptions& o) { o.grid.colour_per_ray = true; }), share);
}

TEST(GridSwitches, SaveGradients) {
  const auto c = test::sphere_capture(8, 32);
  const auto learning = [&](const std::function<void(TrainOptions&)>& change) {
    const Work w = work_of(c, change);
    return static_cast<double>(w.learning) / static_cast<double>(w.samples);
  };
  const double usual = learning([](TrainOptions&) {});
  EXPECT_GT(usual, 0);
  const double all = learning([](TrainOptions& o) { o.gradient_roulette = 0; });
  EXPECT_LE(all, 1);
  EXPECT_GT(all, 1.2 * usual);
  EXPECT_LT(learning([](TrainOptions& o) { o.gradient_roulette = 4; }), 0.8 * usual);
  EXPECT_LT(learning([](TrainOptions& o) {
              o.gradient_roulette = 0;
              o.stop_transmittance = 0.3;
            }),
            all);
}

TEST(GridSwitches, SaveRowsOfTheOptimiser) {
  const auto c = test::sphere_capture(8, 32);
  const Work usual = work_of(c, [](TrainOptions&) {});
  const Work all = work_of(c, [](TrainOptions& o) { o.every_row = true; });
  EXPECT_GT(usual.rows, 0);
  EXPECT_LT(usual.rows, all.rows);
  EXPECT_EQ(all.rows % kSteps, 0);  // every step all of them
}

TEST(GridSwitches, ChangeWhatIsLearnt) {
  const auto c = test::sphere_capture(8, 32);
  const Work usual = work_of(c, [](TrainOptions&) {});
  const auto differs = [&](const std::function<void(TrainOptions&)>& change) {
    return work_of(c, change).learnt != usual.learnt;
  };
  EXPECT_FALSE(differs([](TrainOptions&) {}));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.seed = 2; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.error_guidance = 0; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.distortion = 0.01; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.huber_delta = 0.05; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.network_l2 = 1e-3; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.network_rate = 0.5; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.beta1 = 0.9; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.beta2 = 0.99; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.final_beta1 = 0.8; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.final_beta2 = 0.95; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.final_rate = 0.5; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.warmup_steps = 8; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.hold = 0.5; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.grid.sampler.uniform_share = 0.1_r; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.grid.sampler.min_transmittance = 0.5_r; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.grid.antialias = true; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.grid.cone_points = 6; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.grid.features = 2; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.grid.table_bits = 32; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.grid.finest_resolution = 0; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.grid.colour_per_ray = true; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.shared_colour = 0; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.stop_transmittance = 0.1; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.gradient_roulette = 0; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.every_row = true; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.late_levels = 0.5; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.coarse_photos = 0.5; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.early_samples = 1; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.occupancy_threshold = 0.2; }));
  EXPECT_TRUE(differs([](TrainOptions& o) { o.keep_transparent = true; }));
}

}  // namespace
}  // namespace nerf
