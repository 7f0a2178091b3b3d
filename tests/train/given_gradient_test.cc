// A step around a loss of the caller's (Trainer::begin_step): with the method's own loss it is the
// method's own step, and with another it fits another.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "support/synthetic_scene.h"
#include "support/tiny_options.h"

namespace nerf {
namespace {

using test::sphere_capture;

class GivenGradient : public ::testing::TestWithParam<std::string> {
 protected:
  static bool grid() { return GetParam() == kGridMethod; }
  static TrainOptions options(int64_t steps) {
    TrainOptions o = test::tiny_options(GetParam(), steps);
    o.grid_recipe.huber_delta = 2;  // errors of colours are at most 1: all squares
    o.recipe.charbonnier = 0;
    return o;
  }
};

// The gradient of the sum of squared errors, as the method weighs its renderings.
std::vector<Real> squared_error_gradient(const RayPixels& p, Real coarse) {
  std::vector<Real> gradient(p.rgba.size(), 0.0_r);
  const size_t n = p.rays.size();
  for (size_t k = 0; k < static_cast<size_t>(p.renderings); ++k)
    for (size_t r = 0; r < n; ++r) {
      const bool last = k + 1 == static_cast<size_t>(p.renderings);
      const Real scale = p.scale[r] * (last ? 1.0_r : coarse);
      for (size_t c = 0; c < 3; ++c) {
        const size_t at = 4 * (k * n + r) + c;
        gradient[at] = 2 * (p.rgba[at] - p.target[3 * r + c]) * scale;
      }
    }
  return gradient;
}

TEST_P(GivenGradient, OfTheOwnLossIsTheOwnStepBitForBit) {
  const auto c = sphere_capture(6, 24);
  ThreadPool pool(2);
  Trainer own(c.scene, c.photos, options(20), pool), given(c.scene, c.photos, options(20), pool);
  for (int step = 0; step < 6; ++step) {
    const StepReport a = own.step();
    const RayPixels& pixels = given.begin_step();
    ASSERT_EQ(static_cast<int64_t>(pixels.rays.size()), a.rays);
    for (const Ray& ray : pixels.rays) ASSERT_NEAR(length(ray.direction), 1, 1e-12);
    const auto gradient = squared_error_gradient(pixels, given.options().recipe.coarse);
    const StepReport b = given.finish_step(gradient);
    EXPECT_EQ(a.step, b.step);
    EXPECT_EQ(a.psnr, b.psnr);
    EXPECT_EQ(a.samples, b.samples);
  }
  EXPECT_EQ(test::bits_of(own), test::bits_of(given));
}

// The reported PSNR is of all rays of the step, those that met no matter included.
TEST_P(GivenGradient, ReportsTheErrorOfEveryRay) {
  auto c = sphere_capture(6, 24);
  if (grid()) c.scene.near = 4.1;  // behind the sphere: many rays leave the region before
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, options(20), pool);
  const RayPixels& pixels = trainer.begin_step();
  const size_t n = pixels.rays.size();
  const Real* final_rgba = pixels.rgba.data() + 4 * n * static_cast<size_t>(pixels.renderings - 1);
  double all = 0, met_matter = 0;
  for (size_t r = 0; r < n; ++r)
    for (size_t k = 0; k < 3; ++k) {
      const double e = static_cast<double>(final_rgba[4 * r + k] - pixels.target[3 * r + k]);
      all += e * e;
      if (pixels.scale[r] != 0) met_matter += e * e;
    }
  if (grid()) {
    EXPECT_GT(all, 1.02 * met_matter);
  }
  const StepReport report = trainer.finish_step(std::vector<Real>(pixels.rgba.size(), 0.0_r));
  EXPECT_NEAR(report.psnr, -10 * std::log10(all / (3 * static_cast<double>(n))), 1e-4);
}

TEST_P(GivenGradient, IsTheSameForAnyNumberOfThreads) {
  const auto c = sphere_capture(6, 24);
  const auto bits = [&](int threads) {
    ThreadPool pool(threads);
    Trainer trainer(c.scene, c.photos, options(20), pool);
    for (int step = 0; step < 3; ++step) {
      const RayPixels& pixels = trainer.begin_step();
      trainer.finish_step(std::vector<Real>(pixels.rgba.size(), 1e-3_r));
    }
    return test::bits_of(trainer);
  };
  EXPECT_EQ(bits(1), bits(3));
}

// Along rays of the caller's, before a background of the caller's: light that is asked to be red.
TEST_P(GivenGradient, OfGivenRaysFitsWhatTheCallerWants) {
  const auto c = sphere_capture(6, 24);
  ThreadPool pool(2);
  constexpr int kSteps = 120;
  Trainer trainer(c.scene, c.photos, options(kSteps), pool);
  std::vector<Ray> rays;
  const int n = 12;
  for (const int v : c.scene.train)
    for (int i = 0; i < n; ++i) {
      const size_t view = static_cast<size_t>(v);
      const Camera& camera = c.photos.cameras[view];
      auto ray = camera_ray(camera, c.scene.to_engine.apply(c.scene.views[view].pose),
                            {camera.width * (0.4 + 0.2 * i / n), 0.5 * camera.height});
      ray->near = c.scene.near;
      ray->background = {0, 0, 1};
      rays.push_back(*ray);
    }
  double first = 0, last = 0;
  for (int step = 0; step < kSteps; ++step) {
    const RayPixels& pixels = trainer.begin_step(rays);
    ASSERT_EQ(pixels.rays.size(), rays.size());
    EXPECT_TRUE(pixels.target.empty());
    std::vector<Real> gradient(pixels.rgba.size(), 0.0_r);
    double loss = 0;
    for (size_t at = 0; at < gradient.size(); at += 4)
      for (size_t k = 0; k < 3; ++k) {
        const Real e = pixels.rgba[at + k] - (k == 0 ? 1.0_r : 0.0_r);
        loss += static_cast<double>(e * e) / static_cast<double>(rays.size());
        gradient[at + k] = 2 * e / static_cast<Real>(rays.size());
      }
    const StepReport report = trainer.finish_step(gradient, loss);
    EXPECT_GE(report.loss, loss);
    if (step == 0) first = loss;
    last = loss;
  }
  EXPECT_LT(last, 0.2 * first) << first;
}

// What is no number does not reach the weights, and the trainer can begin anew.
TEST_P(GivenGradient, ThatIsNoNumberEndsTheStep) {
  const auto c = sphere_capture(4, 16);
  ThreadPool pool(2);
  Trainer trainer(c.scene, c.photos, options(20), pool),
      fresh(c.scene, c.photos, options(20), pool);
  const RayPixels& pixels = trainer.begin_step();
  const std::vector<Real> gradient(pixels.rgba.size(), std::numeric_limits<Real>::quiet_NaN());
  EXPECT_THROW(trainer.finish_step(gradient), NonFiniteError);
  trainer.restart(0, 1);
  trainer.step();
  fresh.step();
  EXPECT_EQ(test::bits_of(trainer), test::bits_of(fresh));
}

INSTANTIATE_TEST_SUITE_P(Methods, GivenGradient,
                         ::testing::Values("grid", "nerf", "mipnerf", "mipnerf360"),
                         [](const auto& info) { return info.param; });

TEST(GivenRays, TooManyAreAnError) {
  const auto c = sphere_capture(4, 16);
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, test::tiny_options(4), pool);
  const std::vector<Ray> rays(static_cast<size_t>(trainer.most_rays()) + 1);
  EXPECT_TRUE(test::contains(test::error_of([&] { trainer.begin_step(rays); }), "at most"));
  trainer.step();  // nothing was begun
}

}  // namespace
}  // namespace nerf
