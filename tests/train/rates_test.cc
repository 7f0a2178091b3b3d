// Step sizes from next to nothing to the largest that is allowed, through whole training steps.
#include <gtest/gtest.h>

#include <cmath>

#include "nerf/model/renderer.h"
#include "nerf/train/methods.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"
#include "train/grid_trainer.h"

namespace nerf {
namespace {

class Rates : public ::testing::TestWithParam<std::string> {
 protected:
  static TrainOptions options(double rate) {
    TrainOptions o = test::tiny_options(GetParam(), 40);
    o.rate = rate;
    return o;
  }
};

// Adam moves a weight by about the rate, whatever the gradient is: after 40 steps of 1 the layers'
// outputs are huge and still finite, and so are losses, gradients (health.cc would throw) and
// pictures.
TEST_P(Rates, HugeStepsStayFinite) {
  const auto c = test::capture_of(GetParam());
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, options(1), pool);
  for (int i = 0; i < 40; ++i) ASSERT_TRUE(std::isfinite(trainer.step().loss)) << "step " << i;
  const Frame frame =
      render(trainer.snapshot(), c.scene.cameras[0], c.scene.views[0].pose, {}, pool);
  for (const Real v : frame.rgb) ASSERT_TRUE(v >= 0 && v <= 1) << v;
}

// Steps below the weights' last digits change no picture.
TEST_P(Rates, TinyStepsChangeNothing) {
  const auto c = test::capture_of(GetParam());
  ThreadPool pool(2);
  TrainOptions still = options(1e-25);
  // Frequencies that open with the steps would change it.
  still.recipe.window_steps = still.recipe.ambient_start = still.recipe.ambient_steps = 0;
  const auto picture_after = [&](int steps) {
    Trainer trainer(c.scene, c.photos, still, pool);
    for (int i = 0; i < steps; ++i) EXPECT_TRUE(std::isfinite(trainer.step().loss));
    return render(trainer.snapshot(), c.scene.cameras[0], c.scene.views[0].pose, {}, pool).rgb;
  };
  const auto one = picture_after(1), many = picture_after(12);
  for (size_t i = 0; i < one.size(); ++i) ASSERT_NEAR(one[i], many[i], 1e-6) << i;
}

// The step size rises, stands until a fifth of the steps and falls linearly; Adam's memory grows
// while it falls.
TEST(GridSchedule, StepSizeFallsAndMemoryGrows) {
  const auto c = test::sphere_capture(6, 16);
  ThreadPool pool(1);
  TrainOptions o = test::tiny_options(1000);
  o.rate = 0.5;
  o.warmup_steps = 10;
  o.hold = 0.2;
  o.final_rate = 0.1;
  o.grid_recipe.beta1 = 0.5;
  o.grid_recipe.final_beta1 = 0.9;
  o.grid_recipe.beta2 = 0.75;
  o.grid_recipe.final_beta2 = 0.25;
  const GridTrainer trainer(c.scene, c.photos, o, pool);
  const struct {
    int64_t step;
    double rate, beta1, beta2;
  } wanted[] = {{0, 0.05, 0.5, 0.75},   {9, 0.5, 0.5, 0.75},     {200, 0.5, 0.5, 0.75},
                {600, 0.275, 0.7, 0.5}, {1000, 0.05, 0.9, 0.25}, {2000, 0.05, 0.9, 0.25}};
  for (const auto& w : wanted) {
    const AdamStep adam = trainer.adam_at(w.step);
    EXPECT_FLOAT_EQ(adam.rate, static_cast<Real>(w.rate)) << w.step;
    EXPECT_FLOAT_EQ(adam.beta1, static_cast<Real>(w.beta1)) << w.step;
    EXPECT_FLOAT_EQ(adam.beta2, static_cast<Real>(w.beta2)) << w.step;
    EXPECT_EQ(adam.epsilon, AdamStep().epsilon);
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, Rates,
                         ::testing::Values("grid", "nerf", "mipnerf", "mipnerf360", "nerfw",
                                           "dnerf", "nerfies", "hypernerf"),
                         [](const auto& info) { return info.param; });

}  // namespace
}  // namespace nerf
