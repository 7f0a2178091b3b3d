// Scenes that move, with a table: the gradient of a step's loss by the warp, the same bits however
// it runs, and a sphere that moves is sharp where a field that stands still sees a blur.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "math/worst_error.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "nerf/train/evaluation.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/grid_trainer.h"

namespace nerf {
namespace {

TrainOptions moving_options(int64_t steps, Deform deform = Deform::kTranslation) {
  TrainOptions o = test::tiny_options(steps);
  o.grid_recipe.motion.deform = deform;
  o.grid_recipe.motion.width = 32;
  o.grid_recipe.motion.rate = 0.15;
  return o;
}

// The sphere goes up and down once from the first photo to the last.
test::SyntheticCapture moving_sphere(int views, int size) {
  test::SyntheticCapture c = test::sphere_capture(views, size);
  for (int i = 0; i < views; ++i) {
    View& view = c.scene.views[static_cast<size_t>(i)];
    view.time = static_cast<double>(i) / (views - 1);
    const Vec3d up{0, 0, 0.25 * std::sin(2 * std::numbers::pi * view.time)};
    Pose pose = view.pose;
    pose.translation = pose.translation - up;  // a sphere that is up shows from further below
    c.photos.photos[static_cast<size_t>(i)] = test::sphere_photo(c.scene.cameras[0], pose);
  }
  return c;
}

GridTrainer& grid_of(Trainer& trainer) {
  return dynamic_cast<GridTrainer&>(internal::impl_of(trainer));
}

// The samples of a batch, which a step's backward pass moves, at their moments.
class DrawnBatch {
 public:
  explicit DrawnBatch(GridTrainer& trainer) : t_(trainer) {
    t_.draw();
    for (const auto* a : {&t_.batch.x, &t_.batch.y, &t_.batch.z})
      drawn_.emplace_back(a->begin(), a->end());
  }
  // Leaves gradients of dense parameters in the accumulators.
  double loss() {
    size_t i = 0;
    for (auto* a : {&t_.batch.x, &t_.batch.y, &t_.batch.z})
      std::ranges::copy(drawn_[i++], a->begin());
    t_.look_up();
    StepReport report;
    t_.head(report);
    t_.trace_positions();
    return report.loss;
  }

 private:
  GridTrainer& t_;
  std::vector<std::vector<Real>> drawn_;
};

// A moving sphere after some steps, in float32; every sample goes back that has a gradient.
struct TrainedSphere {
  TrainedSphere(TrainOptions options, int steps)
      : trainer(capture.scene, capture.photos, all_go_back(std::move(options)), pool) {
    for (int i = 0; i < steps; ++i) trainer.step();
  }
  static TrainOptions all_go_back(TrainOptions o) {
    o.grid_recipe.stop_transmittance = 0;
    o.grid_recipe.gradient_roulette = 0;
    o.precision = Precision::kF32;
    return o;
  }
  test::SyntheticCapture capture = moving_sphere(5, 24);
  ThreadPool pool{2};
  Trainer trainer;
};

// Of the whole chain: loss, networks, lookup, warp, code of the moment.
void compare_gradient(Deform deform) {
  TrainOptions o = moving_options(1000, deform);
  // Coarse cells, so that few samples cross a border within the differences' step; every sample of
  // a ray has its own colour.
  o.grid.levels = 2;
  o.grid.base_resolution = 4;
  o.grid.finest_resolution = 8;
  o.grid_recipe.shared_colour = 0;
  o.grid_recipe.motion.ambient = 1;
  TrainedSphere sphere(o, 40);
  GridTrainer& t = grid_of(sphere.trainer);
  DrawnBatch batch(t);
  batch.loss();
  t.dense->reduce(1, sphere.pool);
  MotionNetworks motion = t.field.motion;
  std::vector<size_t> tried;
  for (const LinearWeights* w : motion.layers()) {
    tried.push_back(w->offset);
    tried.push_back(w->offset + static_cast<size_t>((w->out - 1) * weight_stride(w->in)));
    tried.push_back(w->bias_offset() + static_cast<size_t>(w->out / 2));
  }
  std::vector<double> got;
  for (const size_t i : tried) got.push_back(static_cast<double>(t.dense->gradient[i]));

  double norm = 0;
  for (const double g : got) norm += g * g;
  norm = std::sqrt(norm / static_cast<double>(got.size()));
  ASSERT_GT(norm, 1e-6);
  // In float the loss is rounded, and a wide step crosses cells, whose slopes differ: between 2e-3
  // and 2.5e-4 the difference from the gradient falls with the step, below it grows again.
  const bool is_float = std::is_same_v<Real, float>;
  const double h = is_float ? 2.5e-4 : 1e-6, tolerance = (is_float ? 3e-2 : 1e-4) * norm;
  WorstError worst("motion_gradient");
  for (size_t k = 0; k < tried.size(); ++k) {
    Real& weight = t.field.weights[tried[k]];
    const Real before = weight;
    const auto loss_at = [&](double by) {
      weight = before + static_cast<Real>(by);
      return batch.loss();
    };
    const double above = loss_at(h), below = loss_at(-h);
    weight = before;
    worst.compare(got[k], (above - below) / (2 * h), tolerance, "weight", k);
  }
  worst.report();
}

TEST(Motion, GradientOfAStepByATranslation) { compare_gradient(Deform::kTranslation); }
TEST(Motion, GradientOfAStepByARigidMotion) { compare_gradient(Deform::kSe3); }

// How far what learns is moved, the light of each sample given: in float64 from the warp's places.
double moved_light(GridTrainer& t) {
  const double extent = static_cast<double>(t.field.extent());
  MotionChunk& motion = *t.moving->workers[0];
  double sum = 0;
  for (int c = 0; c < t.batch.chunks; ++c) {
    const int64_t at = int64_t{c} * kChunkSamples;
    const int kept = static_cast<int>(t.chunk_kept[static_cast<size_t>(c)]);
    const Real* const from[] = {t.batch.x.data() + at, t.batch.y.data() + at,
                                t.batch.z.data() + at};
    motion.forward(from[0], from[1], from[2], kept, t.batch.rays[static_cast<size_t>(c)],
                   t.moving->ray_begin.data() + int64_t{c} * (kChunkRays + 1),
                   t.batch.time.data() + int64_t{c} * kChunkRays);
    for (int s = 0; s < kept; ++s) {
      double square = 0;
      for (int k = 0; k < 3; ++k) {
        const double moved = 2 * extent * double{motion.canonical(k)[s] - from[k][s]};
        square += moved * moved;
      }
      sum +=
          double{t.moving->pull[static_cast<size_t>(at + s)]} * (std::sqrt(square + 1e-6) - 1e-3);
    }
  }
  return sum;
}

TEST(Motion, LossOnHowFarMatterIsMoved) {
  TrainOptions o = moving_options(1000, Deform::kSe3);
  o.grid_recipe.motion.offset = 0.5;
  TrainedSphere sphere(o, 20);
  GridTrainer& t = grid_of(sphere.trainer);
  DrawnBatch batch(t);
  const auto gradient = [&] {
    const double loss = batch.loss();
    t.dense->reduce(1, sphere.pool);
    return std::pair(loss, std::vector<Real>(t.dense->gradient.begin(), t.dense->gradient.end()));
  };
  const auto [pulled_loss, pulled] = gradient();
  const double moved = moved_light(t);
  t.offset_weight = 0;
  const auto [free_loss, free] = gradient();
  ASSERT_GT(moved, 1e-6);
  EXPECT_NEAR(pulled_loss - free_loss, moved, 1e-2 * moved);  // of all samples, and of what learns

  const bool is_float = std::is_same_v<Real, float>;
  // A tenth of where the loss bends: 0.2 % of bend, and 0.1 % for a float position's rounding.
  const double h = is_float ? 1e-4 : 1e-6;
  std::vector<size_t> tried;
  const LinearWeights& last = t.field.motion.warp.last;
  for (int k = 0; k < last.out; ++k) tried.push_back(last.bias_offset() + static_cast<size_t>(k));
  tried.push_back(t.field.motion.time_last.bias_offset());
  double norm = 0;
  for (const size_t i : tried) norm = std::max(norm, std::abs(double{pulled[i] - free[i]}));
  WorstError worst("offset_gradient");
  for (const size_t i : tried) {
    Real& weight = t.field.weights[i];
    const Real before = weight;
    weight = before + static_cast<Real>(h);
    const double above = moved_light(t);
    weight = before - static_cast<Real>(h);
    const double below = moved_light(t);
    weight = before;
    worst.compare(double{pulled[i] - free[i]}, (above - below) / (2 * h), 1e-2 * norm, "weight", i);
  }
  worst.report();
}

TEST(Motion, IsTheSameForAnyNumberOfThreads) {
  const auto c = moving_sphere(6, 24);
  const auto bits = [&](int threads) {
    ThreadPool pool(threads);
    Trainer trainer(c.scene, c.photos, moving_options(40, Deform::kSe3), pool);
    for (int step = 0; step < 20; ++step) trainer.step();
    return test::bits_of(trainer);
  };
  EXPECT_EQ(bits(1), bits(3));
}

TEST(Motion, GoesOnBitForBit) {
  const auto c = moving_sphere(6, 24);
  test::TempFolder folder;
  ThreadPool pool(2);
  TrainOptions o = moving_options(60);
  o.grid_recipe.motion.ambient = 2;
  Trainer whole(c.scene, c.photos, o, pool), second(c.scene, c.photos, o, pool);
  for (int step = 0; step < 18; ++step) whole.step();
  whole.save_checkpoint(folder / "c");
  second.step();
  second.load_checkpoint(folder / "c");
  for (int step = 0; step < 18; ++step) {
    whole.step();
    second.step();
  }
  EXPECT_EQ(test::bits_of(whole), test::bits_of(second));
}

// Refined cameras get their gradient through the warp as well.
TEST(Motion, CamerasAreRefinedBesideIt) {
  const auto c = moving_sphere(6, 24);
  ThreadPool pool(2);
  TrainOptions o = moving_options(60);
  o.grid_recipe.cameras.refine = RefineCameras::kOn;
  o.grid_recipe.cameras.first_step = 4;
  Trainer trainer(c.scene, c.photos, o, pool);
  for (int step = 0; step < 30; ++step) trainer.step();
  EXPECT_TRUE(
      std::ranges::any_of(grid_of(trainer).cameras->values(), [](double x) { return x != 0; }));
}

TEST(Motion, IsChosenWhereACaptureHasSeveralMoments) {
  auto c = moving_sphere(6, 16);
  MotionRecipe recipe;
  resolve_motion(c.scene, recipe);
  EXPECT_EQ(recipe.deform, Deform::kTranslation);
  EXPECT_EQ(count_moments(c.scene), static_cast<int>(c.scene.train.size()));
  for (View& view : c.scene.views) view.time = 0;
  recipe.deform = Deform::kAuto;
  resolve_motion(c.scene, recipe);
  EXPECT_EQ(recipe.deform, Deform::kNone);
  EXPECT_FALSE(recipe.shape().any());
  recipe.deform = Deform::kSe3;
  EXPECT_THROW(resolve_motion(c.scene, recipe), Error);
}

TEST(Motion, MatterIsHeldInPlaceWhereOneCameraFilmedOnItsWay) {
  auto c = moving_sphere(24, 16);
  MotionRecipe recipe;
  recipe.deform = Deform::kTranslation;
  const auto place = [&](auto x_of) {
    for (size_t i = 0; i < c.scene.views.size(); ++i)
      c.scene.views[i].pose.translation = {x_of(static_cast<double>(i)), 0, 0};
  };
  place([](double i) { return 0.1 * i; });
  EXPECT_EQ(offset_weight(recipe, c.scene), 0.1);
  recipe.deform = Deform::kNone;
  EXPECT_EQ(offset_weight(recipe, c.scene), 0);
  recipe.deform = Deform::kSe3;
  recipe.offset = 0;
  EXPECT_EQ(offset_weight(recipe, c.scene), 0);
  recipe.offset = {};
  place([](double i) { return std::fmod(7 * i, 24); });  // here and there
  EXPECT_EQ(offset_weight(recipe, c.scene), 0);
  // Two cameras side by side, of which one took every other of the training photos.
  const auto turn = [&](double i) {
    const auto at = std::ranges::find(c.scene.train, static_cast<int>(i));
    return static_cast<double>((at - c.scene.train.begin()) % 2);
  };
  place([&](double i) { return 0.1 * i + 0.2 * turn(i); });
  EXPECT_EQ(offset_weight(recipe, c.scene), 0);
  place([](double i) { return 0.1 * i; });
  const auto& train = c.scene.train;  // two photos of a moment
  c.scene.views[static_cast<size_t>(train[0])].time =
      c.scene.views[static_cast<size_t>(train[1])].time;
  EXPECT_EQ(offset_weight(recipe, c.scene), 0);
  c.scene.train.resize(4);
  EXPECT_FALSE(filmed_on_the_way(c.scene));
}

// Held-out photos are of moments between the others.
TEST(Motion, AMovingSphereIsSharp) {
  const auto c = moving_sphere(24, 32);
  ThreadPool pool(2);
  const auto psnr = [&](Deform deform) {
    Trainer trainer(c.scene, c.photos, moving_options(240, deform), pool);
    for (int step = 0; step < 240; ++step) trainer.step();
    const RadianceField field = trainer.snapshot();
    EvaluationOptions options;
    return evaluate(field, c.scene, c.photos, options, pool).psnr;
  };
  const double still = psnr(Deform::kNone), moving = psnr(Deform::kTranslation);
  EXPECT_GT(moving, still + 3) << still;
}

// Saved and loaded, a picture of each moment is the same.
TEST(Motion, IsSavedWithTheModel) {
  const auto c = moving_sphere(6, 24);
  ThreadPool pool(2);
  TrainOptions o = moving_options(60, Deform::kSe3);
  o.grid_recipe.motion.ambient = 1;
  Trainer trainer(c.scene, c.photos, o, pool);
  for (int step = 0; step < 60; ++step) trainer.step();
  test::TempFolder folder;
  const RadianceField field = trainer.snapshot();
  field.save(folder / "m.nerf");
  const RadianceField loaded = RadianceField::load(folder / "m.nerf");
  std::vector<Real> first;
  for (const Real time : {0.0_r, 0.5_r}) {
    RenderOptions options;
    options.time = time;
    const View& view = c.scene.views[1];
    const auto picture = [&](const RadianceField& f) {
      return render(f, c.scene.cameras[0], view.pose, options, pool).rgb;
    };
    const std::vector<Real> seen = picture(field);
    EXPECT_EQ(picture(loaded), seen);
    if (first.empty())
      first = seen;
    else
      EXPECT_NE(first, seen);
  }
}

}  // namespace
}  // namespace nerf
