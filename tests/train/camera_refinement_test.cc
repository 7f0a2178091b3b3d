// Cameras refined while a grid is trained: the gradient of a step's loss by them, the same bits
// however it runs, and cameras that were shaken come back.
#include "train/camera_refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "math/worst_error.h"
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
    for (int64_t c = 0; c < b.chunks; ++c)
      for (int r = 0; r < b.rays[static_cast<size_t>(c)]; ++r) {
        const size_t source = source_of(c, r);
        const Mat3d to_camera = t_.source.pose_of(source).rotation.transposed();
        pixels_.push_back(
            *project(t_.source.camera_of(source), to_camera * direction(c, r).cast<double>()));
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
          const Vec3d p =
              line->origin + line->direction * static_cast<double>(b.lines->distance[i]);
          // Contracted in Real, as samples are; of a bounded scene the box alone.
          const Vec3 g = t_.field.grid_position(p.cast<Real>());
          b.x[i] = g.x;
          b.y[i] = g.y;
          b.z[i] = g.z;
        }
      }
    }
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
};

// Of the whole chain: loss, networks, lookup, contraction, ray, pose and lens.
void compare_gradient(bool unbounded) {
  auto c = sphere_capture(5, 24);
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
  t.find_camera_gradient();
  const std::vector<double> got = t.cameras->gradient();

  double norm = 0;
  for (const double g : got) norm += g * g;
  norm = std::sqrt(norm / static_cast<double>(got.size()));
  ASSERT_GT(norm, 1e-5);
  const bool is_float = std::is_same_v<Real, float>;
  // In float the loss is rounded to about 1e-7 of itself for each ray, and a wide step crosses
  // cells, whose slopes differ.
  const double h = is_float ? 4e-4 : 1e-7, tolerance = (is_float ? 3e-2 : 1e-5) * norm;
  WorstError worst(unbounded ? "camera_gradient_unbounded" : "camera_gradient");
  for (size_t i = 0; i < values.size(); ++i) {
    const auto loss_at = [&](double x) {
      std::vector<double> moved = values;
      moved[i] += x;
      t.cameras->set_values(moved);
      return batch.loss();
    };
    worst.compare(got[i], (loss_at(h) - loss_at(-h)) / (2 * h), tolerance, "parameter", i);
  }
  worst.report();
}

TEST(CameraRefinement, GradientOfAStepByItsCameras) { compare_gradient(false); }
TEST(CameraRefinement, GradientThroughTheContraction) { compare_gradient(true); }

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

// Radians between two rotations.
double angle(const Mat3d& a, const Mat3d& b) {
  const Mat3d r = a.transposed() * b;
  const Vec3d twice_sine{r.m[2][1] - r.m[1][2], r.m[0][2] - r.m[2][0], r.m[1][0] - r.m[0][1]};
  return std::asin(std::min(1.0, 0.5 * length(twice_sine)));
}

// Rotations after the mean one between the two sets is taken out, to first order.
double mean_rotation_error(const std::vector<Mat3d>& truth, const std::vector<Mat3d>& got) {
  Vec3d mean;
  std::vector<Vec3d> errors;
  for (size_t i = 0; i < truth.size(); ++i) {
    const Mat3d r = got[i] * truth[i].transposed();
    errors.push_back(Vec3d{r.m[2][1] - r.m[1][2], r.m[0][2] - r.m[2][0], r.m[1][0] - r.m[0][1]} *
                     0.5);
    mean = mean + errors.back() / static_cast<double>(truth.size());
  }
  double sum = 0;
  for (const Vec3d& e : errors) sum += length(e - mean);
  return sum / static_cast<double>(errors.size());
}

TEST(CameraRefinement, ShakenCamerasComeBack) {
  auto c = sphere_capture(16, 48);
  std::vector<Mat3d> truth, shaken, refined;
  for (size_t v = 0; v < c.scene.views.size(); ++v) {
    Pose& pose = c.scene.views[v].pose;
    truth.push_back(pose.rotation);
    const double x = static_cast<double>(v);
    pose = corrected(pose,
                     {Vec3d{std::sin(3 * x), std::sin(5 * x + 1), std::sin(7 * x + 2)} * 0.02, {}});
    shaken.push_back(pose.rotation);
  }
  TrainOptions o = refining(600);
  o.grid_recipe.cameras.first_step = 64;
  o.grid_recipe.cameras.first_levels = 2;
  o.grid_recipe.cameras.rate = 2e-3;
  o.grid_recipe.cameras.lens = false;
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, o, pool);
  trainer.run({});
  const RadianceField model = trainer.snapshot();
  const ModelInfo& info = model.info();
  std::vector<Mat3d> of_truth, of_shaken;
  for (const int v : c.scene.train) {
    const size_t i = static_cast<size_t>(v);
    refined.push_back(info.views[i].pose.rotation);
    of_truth.push_back(truth[i]);
    of_shaken.push_back(shaken[i]);
  }
  const double before = mean_rotation_error(of_truth, of_shaken);
  const double after = mean_rotation_error(of_truth, refined);
  EXPECT_LT(after, 0.35 * before) << before;
  EXPECT_GT(angle(refined.front(), of_shaken.front()), 0);
}

}  // namespace
}  // namespace nerf
