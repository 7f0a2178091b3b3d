// Cameras refined while a grid is trained: the gradient of a step's loss by them, the same bits
// however it runs, and cameras that were shaken come back.
#include "train/camera_refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "math/worst_error.h"
#include "support/synthetic_film.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/grid_trainer.h"

namespace nerf {
namespace {

using test::sphere_capture;

TrainOptions refining(int64_t steps) {
  TrainOptions o = test::tiny_options(steps);
  o.grid_recipe.cameras.refine = RefineCameras::kOn;
  o.grid_recipe.cameras.first_step = 8;
  return o;
}

GridTrainer& grid_of(Trainer& trainer) {
  return dynamic_cast<GridTrainer&>(internal::impl_of(trainer));
}

// The loss of a batch that is drawn already, its samples carried along by the cameras as they are
// now: same distances, same pixels.
class CarriedBatch {
 public:
  explicit CarriedBatch(GridTrainer& trainer) : t_(trainer) {
    t_.draw();
    const RayBatch& b = t_.batch;
    distances_.assign(b.lines->distance.begin(), b.lines->distance.end());
    for (int64_t c = 0; c < b.chunks; ++c)
      for (int r = 0; r < b.rays[static_cast<size_t>(c)]; ++r) {
        const size_t source = source_of(c, r);
        const double share = b.lines->share[static_cast<size_t>(c * kChunkRays + r)];
        const Camera& camera = t_.source.camera_of(source);
        const Pose pose = line_pose(camera, t_.source.pose_of(source), share);
        pixels_.push_back(
            *project(camera, pose.rotation.transposed() * direction(c, r).cast<double>()));
      }
  }

  double loss() {
    RayBatch& b = t_.batch;
    size_t ray = 0;
    for (int64_t c = 0; c < b.chunks; ++c) {
      const int32_t* const begin = b.ray_begin.data() + c * (kChunkRays + 1);
      for (int r = 0; r < b.rays[static_cast<size_t>(c)]; ++r) {
        const size_t source = source_of(c, r);
        const auto line =
            camera_ray(t_.source.camera_of(source), t_.source.pose_of(source), pixels_[ray++]);
        for (int64_t s = c * kChunkSamples + begin[r]; s < c * kChunkSamples + begin[r + 1]; ++s) {
          const size_t i = static_cast<size_t>(s);
          const Vec3d p = line->origin + line->direction * static_cast<double>(distances_[i]);
          // Contracted in Real, as samples are; of a bounded scene the box alone.
          const Vec3 g = t_.field.grid_position(p.cast<Real>());
          b.x[i] = g.x;
          b.y[i] = g.y;
          b.z[i] = g.z;
        }
      }
    }
    std::ranges::copy(distances_, b.lines->distance.begin());  // the last backward pass moved them
    t_.look_up();
    StepReport report;
    t_.head(report);
    return report.loss;
  }

 private:
  size_t source_of(int64_t c, int r) const {
    return static_cast<size_t>(t_.batch.lines->source[static_cast<size_t>(c * kChunkRays + r)]);
  }
  Vec3 direction(int64_t c, int r) const {
    const Real* const d = t_.batch.direction.data() + c * 3 * kChunkRays + r;
    return {d[0], d[kChunkRays], d[2 * kChunkRays]};
  }

  GridTrainer& t_;
  std::vector<Vec2d> pixels_;
  std::vector<Real> distances_;
};

// Of the whole chain: loss, networks, lookup, contraction, ray, pose, lens and, of a film, readout.
void compare_gradient(bool unbounded, bool filmed = false) {
  auto c = filmed ? test::film_capture(5, 24, 0.8) : sphere_capture(5, 24);
  c.scene.unbounded = unbounded;
  TrainOptions o = refining(1000);
  // Coarse cells, so that few samples cross a border within the differences' step; every sample of
  // a ray has its own colour and goes back.
  o.grid.levels = 2;
  o.grid.base_resolution = 4;
  o.grid.finest_resolution = 8;
  o.grid_recipe.shared_colour = 0;
  o.grid_recipe.stop_transmittance = 0;
  o.grid_recipe.gradient_roulette = 0;
  o.grid_recipe.distortion = 0;
  o.precision = Precision::kF32;
  o.grid_recipe.cameras.first_step = 1000;
  o.grid_recipe.cameras.centre = true;
  o.grid_recipe.cameras.rolling_shutter.learnt = filmed;
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, o, pool);
  for (int i = 0; i < 60; ++i) trainer.step();
  GridTrainer& t = grid_of(trainer);
  t.options.grid_recipe.cameras.first_step = 0;
  std::vector<double> values(t.cameras->parameters());
  for (size_t i = 0; i < values.size(); ++i)
    values[i] = 0.01 * std::sin(static_cast<double>(7 * i));
  t.cameras->set_values(values);
  CarriedBatch batch(t);
  batch.loss();
  t.find_position_gradient();
  t.find_camera_gradient();
  const std::vector<double> got = t.cameras->gradient();

  double norm = 0;
  for (const double g : got) norm += g * g;
  norm = std::sqrt(norm / static_cast<double>(got.size()));
  ASSERT_GT(norm, 1e-5);
  const bool is_float = std::is_same_v<Real, float>;
  // In float the loss is rounded, and a wide step crosses cells, whose slopes differ: with 1e-4 the
  // differences are further off, and with 3e-6 as well.
  const double h = is_float ? 1e-5 : 1e-7, tolerance = (is_float ? 3e-2 : 1e-5) * norm;
  WorstError worst(filmed      ? "camera_gradient_filmed"
                   : unbounded ? "camera_gradient_unbounded"
                               : "camera_gradient");
  for (size_t i = 0; i < values.size(); ++i) {
    const auto loss_at = [&](double x) {
      std::vector<double> moved = values;
      moved[i] += x;
      t.cameras->set_values(moved);
      double prior = 0;
      for (const double r : trainer.readouts()) prior += CameraRefinement::kReadoutPrior * r * r;
      return batch.loss() + prior;
    };
    worst.compare(got[i], (loss_at(h) - loss_at(-h)) / (2 * h), tolerance, "parameter", i);
  }
  worst.report();
}

TEST(CameraRefinement, GradientOfAStepByItsCameras) { compare_gradient(false); }
TEST(CameraRefinement, GradientThroughTheContraction) { compare_gradient(true); }
TEST(CameraRefinement, GradientOfAFilmsStep) {
  compare_gradient(false, true);
  compare_gradient(true, true);
}

TEST(CameraRefinement, IsTheSameForAnyNumberOfThreads) {
  const auto c = sphere_capture(6, 24);
  const auto bits = [&](int threads) {
    ThreadPool pool(threads);
    Trainer trainer(c.scene, c.photos, refining(60), pool);
    for (int step = 0; step < 30; ++step) trainer.step();
    return test::bits_of(trainer);
  };
  EXPECT_EQ(bits(1), bits(3));
}

TEST(CameraRefinement, GoesOnBitForBit) {
  const auto c = sphere_capture(6, 24);
  test::TempFolder folder;
  ThreadPool pool(2);
  TrainOptions o = refining(60);
  o.grid_recipe.cameras.steps = 4;  // saved between two steps of the cameras
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
  whole.restart(0, 1);
  for (const double x : grid_of(whole).cameras->values()) EXPECT_EQ(x, 0);
}

// By the photos that train: a small sphere seen all around says little of whether its cameras
// turned or moved, but what they show fits together.
TEST(CameraRefinement, ShakenCamerasFitTogetherAgain) {
  const auto truth = sphere_capture(16, 48);
  auto shaken = truth;
  for (size_t v = 0; v < shaken.scene.views.size(); ++v) {
    const double x = static_cast<double>(v);
    const Vec3d turn{std::sin(3 * x), std::sin(5 * x + 1), std::sin(7 * x + 2)};
    Pose& pose = shaken.scene.views[v].pose;
    pose = corrected(pose, {turn * 0.02, {}});
  }
  ThreadPool pool(2);
  const auto psnr = [&](const test::SyntheticCapture& c, RefineCameras refine) {
    constexpr int kSteps = 400, kLast = 40;
    TrainOptions o = refining(kSteps);
    o.grid_recipe.cameras.refine = refine;
    o.grid_recipe.cameras.first_step = 64;
    o.grid_recipe.cameras.first_levels = 2;
    o.grid_recipe.keep_transparent = true;  // the hull that shaken cameras see is too small
    Trainer trainer(c.scene, c.photos, o, pool);
    double sum = 0;
    for (int i = 0; i < kSteps; ++i) {
      const double now = trainer.step().psnr;
      if (i >= kSteps - kLast) sum += now / kLast;
    }
    return sum;
  };
  const double good = psnr(truth, RefineCameras::kOff);
  const double bad = psnr(shaken, RefineCameras::kOff);
  const double refined = psnr(shaken, RefineCameras::kOn);
  EXPECT_LT(bad, good - 3);
  EXPECT_GT(refined, good - 0.25 * (good - bad)) << good << " " << bad;
}

}  // namespace
}  // namespace nerf
