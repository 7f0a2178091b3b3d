// The grid method's distortion loss.
#include <gtest/gtest.h>

#include <cmath>

#include "nerf/math/reference/histogram_losses.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/trainer.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

TrainOptions with_distortion(double weight, int64_t steps) {
  TrainOptions options = test::tiny_options(steps);
  options.grid_recipe.distortion = weight;
  return options;
}

// Mean over rays through a view of equation 15 in double, by a quadrature of the field that knows
// nothing of the march: 200 intervals between the distances 2 and 4.
double distortion_of(const RadianceField& field, const Camera& camera, const Pose& pose,
                     ThreadPool& pool) {
  constexpr int kIntervals = 200;
  double sum = 0;
  int rays = 0;
  for (int y = 1; y < camera.height; y += 4)
    for (int x = 1; x < camera.width; x += 4) {
      const Vec3d d = normalized(pose.rotation * *unproject(camera, {x + 0.5, y + 0.5}));
      std::vector<Vec3d> points;
      std::vector<double> edges, weights;
      for (int i = 0; i <= kIntervals; ++i) edges.push_back(2 + 2.0 * i / kIntervals);
      for (int i = 0; i < kIntervals; ++i)
        points.push_back(pose.translation + d * (edges[static_cast<size_t>(i)] + 1.0 / kIntervals));
      const std::vector<Vec3d> directions(points.size(), d);
      std::vector<Real> density(points.size()), rgb(3 * points.size());
      field.query(points, directions, density, rgb, pool);
      double light = 1;
      for (const Real sigma : density) {
        const double alpha = -std::expm1(-static_cast<double>(sigma) * 2 / kIntervals);
        weights.push_back(light * alpha);
        light *= 1 - alpha;
      }
      for (double& e : edges) e = 1 - 1 / (1 + e);
      sum += reference::distortion_loss(edges, weights);
      ++rays;
    }
  return sum / rays;
}

TEST(GridDistortion, DrawsTheLightOfRaysTogether) {
  const auto c = test::sphere_capture(24, 32);
  ThreadPool pool(2);
  const auto trained = [&](double weight) {
    Trainer trainer(c.scene, c.photos, with_distortion(weight, 300), pool);
    trainer.run({});
    return trainer.snapshot();
  };
  const RadianceField without = trained(0), with = trained(0.1);
  const Pose& pose = c.scene.views[0].pose;
  const double loose = distortion_of(without, c.scene.cameras[0], pose, pool);
  const double tight = distortion_of(with, c.scene.cameras[0], pose, pool);
  RecordProperty("without", std::to_string(loose));
  RecordProperty("with", std::to_string(tight));
  EXPECT_LT(tight, 0.8 * loose);
  EXPECT_GT(evaluate(with, c.scene, c.photos, {}, pool).psnr,
            evaluate(without, c.scene, c.photos, {}, pool).psnr - 1);
}

TEST(GridDistortion, FollowsTheSceneUnlessItIsGiven) {
  Scene scene;
  TrainOptions options;
  EXPECT_EQ(distortion_weight(options, scene), 0);
  scene.unbounded = true;
  EXPECT_GT(distortion_weight(options, scene), 0);
  options.grid_recipe.distortion = 0;
  EXPECT_EQ(distortion_weight(options, scene), 0);
}

TEST(GridDistortion, ThreadsChangeNothing) {
  const auto c = test::sphere_capture();
  const auto bits = [&](double weight, int threads) {
    ThreadPool pool(threads);
    Trainer trainer(c.scene, c.photos, with_distortion(weight, 40), pool);
    for (int i = 0; i < 24; ++i) trainer.step();
    return test::learnt_by(trainer);
  };
  EXPECT_EQ(bits(0.1, 1), bits(0.1, 2));
  EXPECT_NE(bits(0.1, 2), bits(0, 2));
}

}  // namespace
}  // namespace nerf
