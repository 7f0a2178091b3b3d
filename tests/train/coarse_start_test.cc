// What a training of the grid method begins with: fewer samples of a ray
// (GridRecipe::early_samples).
#include <gtest/gtest.h>

#include <cmath>

#include "math/worst_error.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"
#include "train/grid_trainer.h"

namespace nerf {
namespace {

// From the early share to all of them, with the square of the progress: to the end of a short run,
// or to 200 million samples of a long one, where the scene is bounded.
TEST(SamplesPerCell, AreExactOnceTheFieldIsSharp) {
  auto c = test::sphere_capture(4, 16);
  ThreadPool pool(1);
  TrainOptions options = test::tiny_options(1000);
  options.grid_recipe.early_samples = 0.2;
  options.hold = 0;
  options.grid_recipe.batch_samples = 1920;
  const double all = options.grid.sampler.samples_per_cell;
  const auto share = [&](int64_t step) {
    const GridTrainer trainer(c.scene, c.photos, options, pool);
    return static_cast<double>(trainer.samples_per_cell_at(step)) / all;
  };
  const double bound = 4 * kRoundoff;
  EXPECT_NEAR(share(0), 0.2, bound);
  EXPECT_NEAR(share(500), 0.2 + 0.8 * 0.25, bound);
  EXPECT_NEAR(share(1000), 1, bound);
  options.steps = 1000000;
  const int64_t sharp = static_cast<int64_t>(2e8 / 1920);
  EXPECT_NEAR(share(sharp / 2), 0.2 + 0.8 * 0.25, 1e-4);
  EXPECT_NEAR(share(sharp + 1), 1, bound);
  // A ray of all samples is drawn for a fifth of the cost: what is saved on the way.
  const auto saved = [&](int64_t steps) {
    return GridTrainer(c.scene, c.photos, options, pool).late_saving_share(steps);
  };
  // Of (1 - 1 / (1 + 4 p^2)) 5 / 4 over p in [0, 1].
  const double mean = 1.25 * (1 - std::atan(2.0) / 2);
  EXPECT_NEAR(saved(1000), mean, 1e-3);
  EXPECT_NEAR(saved(sharp), mean, 1e-3);
  EXPECT_NEAR(saved(4 * sharp), 0.75 + 0.25 * mean, 1e-2);
  c.scene.unbounded = true;
  EXPECT_LT(share(sharp + 1), 0.22);
  EXPECT_NEAR(share(1000000), 1, bound);
}

// Of the time of the chunks by the networks' multiply-adds, where fewer rays need fewer colours.
TEST(SamplesPerCell, SharedColoursTakeTheirShareOfTheChunks) {
  const auto c = test::sphere_capture(4, 16);
  ThreadPool pool(1);
  TrainOptions options = test::tiny_options(1000);
  options.grid.hidden = 32;
  options.grid.geometry_features = 16;
  options.grid.colour_layers = 2;
  const auto colours = [&] {
    GridTrainer trainer(c.scene, c.photos, options, pool);
    trainer.chunk_seconds = 0.03;
    trainer.colours_per_sample = 0.5;
    return trainer.colour_seconds();
  };
  options.grid_recipe.shared_colour = 0;
  EXPECT_EQ(colours(), 0);
  options.grid_recipe.shared_colour = 0.1;
  const double features = options.grid.levels * options.grid.features;
  const double density = features * 32 + 32 * 16, colour = 0.5 * (32 * 32 + 32 * 32 + 32 * 3);
  EXPECT_NEAR(colours(), 0.03 * colour / (density + colour), 1e-12);
}

}  // namespace
}  // namespace nerf
