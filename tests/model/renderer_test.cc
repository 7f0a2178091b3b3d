// Pictures of a medium of known density against closed forms.
#include "nerf/model/renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "model/homogeneous_field.h"
#include "support/boxed_view.h"
#include "support/cameras.h"

namespace nerf {
namespace {

using test::homogeneous_field;
using test::tilted;

std::pair<Camera, Pose> looking_at_the_medium() {
  Pose pose;
  pose.translation = {0.1, -0.2, -3};
  return {test::pinhole(40, 40, 30), pose};
}

// Opacity 1 - exp(-density * length) of the part of each ray inside the box, whose axes are the
// input's although the engine's are turned against them: nothing is drawn outside it.
TEST(Render, BoxOfTheOptionsKeepsTheInputsAxes) {
  const Similarity to_engine = tilted();
  const RadianceField field = homogeneous_field(to_engine);
  // The box is small enough to lie inside the engine's cube at any angle: half its sides are 4
  // units.
  const test::BoxedView view = test::boxed_view(to_engine);
  RenderOptions options;
  options.interpolated = 0;
  options.bbox = view.box;
  ThreadPool pool(2);
  test::expect_opacity_inside(view, to_engine,
                              render(field, view.camera, view.pose, options, pool));
}

// What is left without colour is missing from a pixel, never more of it than the option says.
TEST(Render, LightLeftWithoutColourIsBounded) {
  const RadianceField field = homogeneous_field(Similarity());
  const auto [camera, pose] = looking_at_the_medium();
  ThreadPool pool(2);
  RenderOptions whole;
  whole.background = {0, 0, 0};
  whole.unshaded = whole.interpolated = 0;
  RenderOptions part = whole;
  part.unshaded = 0.125_r;
  const Frame a = render(field, camera, pose, whole, pool);
  const Frame b = render(field, camera, pose, part, pool);
  EXPECT_EQ(a.alpha, b.alpha);
  EXPECT_EQ(a.depth_z, b.depth_z);
  Real most = 0;
  for (size_t i = 0; i < a.rgb.size(); ++i) {
    EXPECT_NEAR(a.rgb[i], 0.5_r * a.alpha[i / 3], 1e-6_r);  // the colour is a half everywhere
    const Real missing = a.rgb[i] - b.rgb[i];
    EXPECT_GE(missing, -1e-6_r);
    EXPECT_LE(missing, 0.5_r * part.unshaded + 1e-6_r);
    most = std::max(most, missing);
  }
  EXPECT_GT(most, 0.02_r);  // something was left out
}

// Light goes on until less than the option says is left, and no farther than without it.
TEST(Render, TheStopLeavesNoMoreLightThanItSays) {
  const RadianceField field = homogeneous_field(Similarity());
  const auto [camera, pose] = looking_at_the_medium();
  ThreadPool pool(2);
  RenderOptions whole;
  whole.skip_nothing();
  RenderOptions part = whole;
  part.stop_transmittance = 0.25_r;
  const Frame a = render(field, camera, pose, whole, pool);
  const Frame b = render(field, camera, pose, part, pool);
  EXPECT_EQ(a.depth_z, b.depth_z);  // where half of the light is stopped
  // Matter of density 1 in intervals of at most a quarter of a cell's diagonal: one sample's.
  const Real opacity = 1 - std::exp(-0.25_r * std::sqrt(3.0_r) * 2 / 32);
  int stopped = 0;
  for (size_t i = 0; i < a.alpha.size(); ++i) {
    EXPECT_LE(b.alpha[i], a.alpha[i]);
    EXPECT_GE(b.alpha[i], std::min(a.alpha[i], 1 - part.stop_transmittance));
    for (size_t k = 0; k < 3; ++k)  // a half, over the white behind it
      EXPECT_NEAR(b.rgb[3 * i + k], 1 - 0.5_r * b.alpha[i], 1e-6_r);
    if (b.alpha[i] == a.alpha[i]) continue;
    EXPECT_LE(b.alpha[i], 1 - part.stop_transmittance * (1 - opacity) + 1e-6_r);
    ++stopped;
  }
  EXPECT_GT(stopped, 100);
}

// Each switch saves work of the kind that it is for, and the counts do not depend on threads.
TEST(Render, CountsTheWorkThatEachSwitchSaves) {
  // The cache says that a cell stops 0.6 of the light: the stop is reached within the box.
  const RadianceField field = homogeneous_field(Similarity(), /*half_empty=*/false, 200);
  const auto [camera, pose] = looking_at_the_medium();
  ThreadPool one(1), two(2);
  const auto work = [&, &camera = camera, &pose = pose](const RenderOptions& o) {
    const RenderStatistics a = render(field, camera, pose, o, one).statistics;
    const RenderStatistics b = render(field, camera, pose, o, two).statistics;
    EXPECT_EQ(a.rays, b.rays);
    EXPECT_EQ(a.segments, b.segments);
    EXPECT_EQ(a.density_evaluations, b.density_evaluations);
    EXPECT_EQ(a.colour_evaluations, b.colour_evaluations);
    EXPECT_EQ(a.rays, camera.width * camera.height);
    return a;
  };
  RenderOptions off;
  off.skip_nothing();
  const RenderStatistics all = work(off);
  EXPECT_EQ(all.density_evaluations, 4 * all.segments);
  EXPECT_EQ(all.colour_evaluations, all.density_evaluations);

  RenderOptions unshaded = off;
  unshaded.unshaded = 0.125_r;
  EXPECT_EQ(work(unshaded).density_evaluations, all.density_evaluations);
  EXPECT_LT(work(unshaded).colour_evaluations, all.colour_evaluations);

  RenderOptions shared = off;
  shared.shared_colour = 0.125_r;
  EXPECT_EQ(work(shared).density_evaluations, all.density_evaluations);
  EXPECT_LT(work(shared).colour_evaluations, all.colour_evaluations / 2);

  RenderOptions opaque = off;
  opaque.stop_transmittance = 0.5_r;
  EXPECT_EQ(work(opaque).segments, all.segments);
  const int64_t to_half = work(opaque).density_evaluations;
  EXPECT_LT(to_half, all.density_evaluations);
  opaque.stop_transmittance = 0.25_r;
  EXPECT_GT(work(opaque).density_evaluations, to_half);

  RenderOptions cache = off;
  cache.unclipped = false;
  const RenderStatistics cached = work(cache);
  EXPECT_EQ(cached.segments, all.segments);
  EXPECT_LT(cached.density_evaluations, all.density_evaluations);
  EXPECT_EQ(cached.colour_evaluations, cached.density_evaluations);

  RenderOptions stop = cache;
  stop.min_transmittance = 1e-6_r;
  const int64_t stopped = work(stop).segments;
  EXPECT_LT(stopped, cached.segments);
  stop.min_transmittance = 1e-4_r;
  EXPECT_LT(work(stop).segments, stopped);

  RenderOptions few = cache;
  few.sample_factor = 0.5_r;
  EXPECT_LT(work(few).density_evaluations, cached.density_evaluations);

  // Light comes from the first cells of a ray alone: samples spread over all of them are more.
  RenderOptions many = cache;
  many.sample_factor = 100;
  const int64_t capped = work(many).density_evaluations;
  many.max_samples = 2 * many.max_samples;
  EXPECT_GT(work(many).density_evaluations, capped);
  RenderOptions spread = cache;
  spread.uniform_share = 0;
  EXPECT_LT(work(spread).density_evaluations, cached.density_evaluations);
}

// Whatever the march stopped at in training.
TEST(Render, TheCachesStopIsTheOptionsAlone) {
  const RadianceField field = homogeneous_field(Similarity(), /*half_empty=*/false, 200);
  const auto [camera, pose] = looking_at_the_medium();
  ThreadPool pool(2);
  std::vector<int64_t> segments;  // of each stop
  for (const Real trained : {1e-4_r, 0.0_r, 0.5_r}) {
    auto grid = std::make_shared<GridField>(field.grid());
    grid->options.sampler.min_transmittance = trained;
    const RadianceField same(field.info(), grid);
    std::vector<int64_t> now;
    for (const Real stop : {0.0_r, 1e-6_r, 1e-4_r, 1e-2_r}) {
      RenderOptions options;
      options.interpolated = 0;
      options.min_transmittance = stop;
      now.push_back(render(same, camera, pose, options, pool).statistics.segments);
      if (now.size() > 1) {
        EXPECT_LT(now.back(), now[now.size() - 2]) << trained << ' ' << stop;
      }
    }
    if (segments.empty()) segments = now;
    EXPECT_EQ(now, segments) << trained;
  }
}

// Density 1 per engine unit is `scale` per input unit, whatever the direction; sigmoid(0) is a
// half.
TEST(Query, GivesDensityPerInputUnitAndNoneOutside) {
  const Similarity to_engine = tilted();
  ASSERT_EQ(to_engine.scale, 0.25);
  const RadianceField field = homogeneous_field(to_engine);
  // More points than fit into one chunk, alternately inside [-1, 1]^3 and outside.
  std::vector<Vec3d> points, directions;
  for (int i = 0; i < 2 * kChunkSamples + 3; ++i) {
    const double a = 0.1 * i, at = i % 2 == 0 ? 0.99 : 1.01;
    points.push_back(to_engine.apply_inverse(Vec3d{at * std::cos(a), i % 3 == 0 ? at : -at, at}));
    directions.push_back(normalized(Vec3d{std::sin(a), std::cos(a), 0.3}));
  }
  std::vector<Real> density(points.size()), rgb(3 * points.size());
  ThreadPool pool(2);
  field.query(points, directions, density, rgb, pool);
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(density[i], i % 2 == 0 ? 0.25_r : 0.0_r) << i;
    for (size_t k = 0; k < 3; ++k) EXPECT_EQ(rgb[3 * i + k], 0.5_r) << i;
  }
}

TEST(Query, IsEmptyInCellsThatAreKnownToBe) {
  const RadianceField field = homogeneous_field(Similarity(), /*half_empty=*/true);
  std::vector<Vec3d> points;
  for (int i = 0; i < 40; ++i) points.push_back({(i + 0.5) / 20 - 1, 0.3, 0.01 * i});
  const std::vector<Vec3d> directions(points.size(), Vec3d{0, 0, 1});
  std::vector<Real> density(points.size()), rgb(3 * points.size());
  ThreadPool pool(1);
  field.query(points, directions, density, rgb, pool);
  for (size_t i = 0; i < points.size(); ++i) EXPECT_EQ(density[i], points[i].x > 0 ? 1 : 0) << i;
}

}  // namespace
}  // namespace nerf
