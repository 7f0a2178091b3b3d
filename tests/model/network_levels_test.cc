#include "nerf/model/network_levels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "model/baked_occupancy.h"
#include "model/octahedron.h"
#include "nerf/base/threads.h"
#include "nerf/math/camera.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"
#include "support/network_options.h"
#include "support/network_rays.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::mipnerf360_options;
using test::mipnerf_options;
using test::nerf_options;
using test::small_network;
using test::some_rays;

std::vector<NetworkOptions> all_methods() {
  return {small_network(nerf_options()), small_network(mipnerf_options()),
          small_network(mipnerf360_options())};
}

// A network whose only weights are the biases of its heads: the same matter everywhere.
NetworkField homogeneous(NetworkOptions o, Real raw_density, double near, double far) {
  NetworkField field(o, near, far);
  for (const RadianceNetwork& n : field.networks)
    field.weights[n.density.bias_offset()] = raw_density;
  return field;
}

// Light through homogeneous matter between near and far: 1 - exp(-density (far - near)), whatever
// the samples are (Max 1995); its colour is that of sigmoid(0).
TEST(NetworkLevels, HomogeneousMatter) {
  for (NetworkOptions o : all_methods()) {
    o.opaque_end = false;
    o.colour_padding = 0;
    if (o.sampling.resampling == Resampling::kCoarseFine) continue;  // its end is endless, below
    const NetworkField field = homogeneous(o, 0.5_r, 1, 3);
    const double density = std::log1p(std::exp(0.5 + static_cast<double>(o.density_bias)));
    NetworkLevels levels(field, 4);
    auto rays = some_rays(4, 2);
    levels.forward(rays, 1);
    for (int r = 0; r < 4; ++r) {
      Real rgb[3], opacity;
      levels.pixel(r, rgb, opacity);
      // mip-NeRF draws the outermost posts a little inside.
      const auto posts = levels.posts(levels.levels() - 1, r);
      const double way = static_cast<double>(levels.sampler().distance(posts.back())) -
                         static_cast<double>(levels.sampler().distance(posts.front()));
      EXPECT_GT(way, 1.5);
      const double want = 1 - std::exp(-density * way);
      EXPECT_NEAR(opacity, want, 1e-5);
      for (const Real channel : rgb) EXPECT_NEAR(channel, 1 - 0.5 * want, 1e-5);
    }
  }
}

// NeRF's last interval has no end: any matter there is opaque.
TEST(NetworkLevels, NerfIsOpaqueAtTheEnd) {
  const NetworkField field = homogeneous(small_network(nerf_options()), 1e-4_r, 1, 3);
  NetworkLevels levels(field, 2);
  auto rays = some_rays(2, 2);
  levels.forward(rays, 1);
  Real rgb[3], opacity;
  levels.pixel(1, rgb, opacity);
  EXPECT_NEAR(opacity, 1, 1e-6);
  EXPECT_NEAR(levels.median_distance(1), 3, 0.2);
}

// From any camera, whatever the weights: finite, weights at least 0 with a sum of at most 1.
TEST(NetworkLevels, NothingIsLostFarAway) {
  for (const NetworkOptions& o : all_methods())
    for (Real distance : {0.0_r, 3.0_r, 1e5_r}) {
      NetworkField field(o, 0.1, 1e6);
      field.initialise(3);
      for (Real& w : field.weights) w *= 3;
      NetworkLevels levels(field, 3, true, {1, 1, 0.01_r, PixelLoss::charbonnier(0.001_r), 1});
      auto rays = some_rays(3, distance);
      levels.forward(rays, 0.5_r);
      AlignedArray<Real> gradient(field.weights.size());
      EXPECT_TRUE(std::isfinite(levels.backward(gradient.data())));
      for (const Real g : gradient) ASSERT_TRUE(std::isfinite(g));
      for (int l = 0; l < levels.levels(); ++l)
        for (int r = 0; r < 3; ++r) {
          double sum = 0;
          for (const Real w : levels.weights(l, r)) {
            ASSERT_GE(w, 0);
            sum += static_cast<double>(w);
          }
          EXPECT_LE(sum, 1 + 1e-6);
        }
    }
}

Camera sphere_like_camera() { return test::pinhole(40, 30, 35); }

// The pixels of a chunk do not depend on what else is in it.
TEST(NetworkLevels, RaysDoNotMeetEachOther) {
  for (const NetworkOptions& o : all_methods()) {
    NetworkField field(o, 0.5, 4);
    field.initialise(3);
    NetworkLevels together(field, 5), alone(field, 5);
    auto rays = some_rays(5, 2);
    together.forward(rays, 1);
    for (int r = 0; r < 5; ++r) {
      std::vector<NetworkRay> one{rays[static_cast<size_t>(r)]};
      alone.forward(one, 1);
      Real a[3], b[3], oa, ob;
      together.pixel(r, a, oa);
      alone.pixel(0, b, ob);
      EXPECT_EQ(oa, ob);
      for (int k = 0; k < 3; ++k) EXPECT_EQ(a[k], b[k]);
    }
  }
}

// Samples without density are left out of everything but their density: the same pixels and
// weights, the same gradient but for the order of its sums.
TEST(NetworkLevels, SkippingEmptySamplesChangesNothing) {
  NetworkOptions relu_360 = small_network(mipnerf360_options());
  relu_360.density = DensityActivation::kRelu;
  for (const NetworkOptions& o : {small_network(nerf_options()), relu_360})
    for (Real bias : {-0.2_r, -100.0_r}) {  // some samples have density; none has
      NetworkField field(o, 0.5, 4);
      field.initialise(3);
      for (const RadianceNetwork& n : field.networks) field.weights[n.density.bias_offset()] = bias;
      const NetworkLosses losses{o.proposal_colour ? 1.0_r : 0.0_r, 1, 0.01_r, {}, 0.1_r};
      NetworkLevels whole(field, 5, true, losses), part(field, 5, true, losses);
      ASSERT_TRUE(whole.can_skip());
      auto rays = some_rays(5, 2), again = rays;
      whole.forward(rays, 1, false);
      part.forward(again, 1, true);
      EXPECT_EQ(whole.all_samples(), part.all_samples());
      EXPECT_EQ(whole.dense_samples(), part.dense_samples());
      EXPECT_LT(part.dense_samples(), 0.9 * static_cast<double>(part.all_samples()));
      const int64_t ends = o.opaque_end ? 5 * part.levels() : 0;  // are asked for in any case
      EXPECT_EQ(part.dense_samples() > ends, bias > -1);
      for (int r = 0; r < 5; ++r) {
        Real a[3], b[3], oa, ob;
        whole.pixel(r, a, oa);
        part.pixel(r, b, ob);
        EXPECT_EQ(oa, ob);
        for (int k = 0; k < 3; ++k) EXPECT_EQ(a[k], b[k]);
        for (int l = 0; l < whole.levels(); ++l)
          EXPECT_TRUE(std::ranges::equal(whole.weights(l, r), part.weights(l, r)));
      }
      AlignedArray<Real> want(field.weights.size()), got(field.weights.size());
      const double loss = whole.backward(want.data());
      EXPECT_NEAR(part.backward(got.data()), loss, 1e-12 * loss);
      double largest = 0;
      for (const Real g : want) largest = std::max(largest, std::fabs(static_cast<double>(g)));
      for (size_t i = 0; i < want.size(); ++i)
        ASSERT_NEAR(got[i], want[i], 64 * 0x1p-24 * largest) << i;
    }
}

class BakedModels : public ::testing::TestWithParam<bool> {};

TEST_P(BakedModels, SkipEmptySpace) {
  const bool cones = GetParam();
  const auto field = test::octahedron(small_network(cones ? mipnerf_options() : nerf_options()));
  ThreadPool pool(2);
  const Camera camera = sphere_like_camera();
  Pose pose;
  pose.translation = {0.1, 0.2, -2.5};
  ModelInfo info;
  info.method = "composed";
  info.alpha = true;
  EXPECT_EQ(RadianceField(info, field).bake(uint64_t{1} << 40, pool), !cones);  // of no photos
  Pose other = pose;
  other.translation = {0.3, -0.2, -2};
  for (const Pose& p : {pose, other}) info.views.push_back({"a photo", camera, p});
  RadianceField model(info, field);
  const Frame whole = render(model, camera, pose, {}, pool);
  EXPECT_FALSE(model.bake(100, pool));  // a few pixels are not worth it
  ASSERT_TRUE(model.bake(uint64_t{1} << 40, pool));
  EXPECT_GT(model.baked()->occupied_fraction(), 0.005);
  EXPECT_LT(model.baked()->occupied_fraction(), 0.2);
  const Frame skipped = render(model, camera, pose, {}, pool);
  RenderOptions off;
  off.unclipped = true;
  const Frame unskipped = render(model, camera, pose, off, pool);
  EXPECT_EQ(whole.rgb, unskipped.rgb);
  EXPECT_LT(skipped.statistics.density_evaluations, whole.statistics.density_evaluations / 2);
  EXPECT_LT(skipped.statistics.colour_evaluations, whole.statistics.colour_evaluations / 2);
  EXPECT_EQ(whole.statistics.colour_evaluations, int64_t{40} * 30 * (cones ? 64 : 128));
  double largest = 0;
  for (size_t i = 0; i < whole.rgb.size(); ++i)
    largest = std::max(largest, std::fabs(static_cast<double>(whole.rgb[i]) -
                                          static_cast<double>(skipped.rgb[i])));
  // Samples of the fine level stand elsewhere where the coarse level's faint light is missing.
  EXPECT_LT(largest, 0.02);
  EXPECT_GT(*std::max_element(whole.alpha.begin(), whole.alpha.end()), 0.9_r);
}

INSTANTIATE_TEST_SUITE_P(PointsAndCones, BakedModels, ::testing::Bool());

// Matter that jumps behind the first moment: every picture finds out what is empty at its own.
TEST(BakedMoments, SkipWhatIsEmpty) {
  const auto field = test::octahedron(small_network(test::dnerf_options()));
  field->weights[field->networks[0].deform.warp.last.bias_offset()] = 0.6_r;
  ModelInfo info;
  info.method = "composed";
  info.alpha = true;
  RadianceField model(info, field);
  ThreadPool pool(2);
  EXPECT_FALSE(model.bake(uint64_t{1} << 40, pool));
  const Camera camera = test::pinhole(160, 120, 130);
  Pose pose;
  pose.translation = {0.1, 0.2, -2.5};
  double places[2];
  for (int moment = 0; moment < 2; ++moment) {
    RenderOptions as_usual, off;
    as_usual.time = off.time = 0.5_r * static_cast<Real>(moment);
    off.unclipped = true;
    const Frame skipped = render(model, camera, pose, as_usual, pool);
    const Frame whole = render(model, camera, pose, off, pool);
    EXPECT_LT(skipped.statistics.density_evaluations, whole.statistics.density_evaluations / 2);
    double largest = 0, light = 0, sum = 0;
    for (size_t i = 0; i < whole.alpha.size(); ++i) {
      largest =
          std::max(largest, std::fabs(static_cast<double>(whole.alpha[i] - skipped.alpha[i])));
      light += static_cast<double>(skipped.alpha[i]);
      sum += static_cast<double>(skipped.alpha[i]) * static_cast<double>(i % 160);
    }
    EXPECT_LT(largest, 0.02);  // as above
    // In parts: found out once for all of them.
    as_usual.supersample = off.supersample = 2;
    const Camera half = test::pinhole(80, 60, 65);
    const Frame finer = render(model, half, pose, as_usual, pool);
    EXPECT_LT(finer.statistics.density_evaluations,
              render(model, half, pose, off, pool).statistics.density_evaluations / 2);
    places[moment] = sum / light;
  }
  // -0.6 / 2.5 of the focal length, a little more for what is nearer.
  EXPECT_NEAR(places[1] - places[0], -0.6 / 2.5 * 130, 3);
}

Camera small_camera() { return test::pinhole(19, 7, 15); }

// Saved and loaded: the same picture; any number of threads: the same bits; queries agree with it.
TEST(NetworkRenderer, FilesAndThreadsChangeNothing) {
  for (const NetworkOptions& o : all_methods()) {
    auto field = std::make_shared<NetworkField>(o, 0.5, 4);
    field->initialise(5);
    for (Real& w : field->weights) w = static_cast<float>(w);  // as the file has them
    ModelInfo info;
    info.method = "composed";
    info.alpha = true;
    info.near = 0.5;
    info.far = 4;
    const RadianceField model(info, field);
    test::TempFolder folder;
    model.save(folder / "m.nerf");
    const RadianceField loaded = RadianceField::load(folder / "m.nerf");
    Pose pose;
    pose.translation = {0, 0, -2};
    ThreadPool one(1), two(2);
    const Frame a = render(model, small_camera(), pose, {}, one);
    const Frame b = render(loaded, small_camera(), pose, {}, two);
    EXPECT_EQ(a.rgb, b.rgb);
    EXPECT_EQ(a.alpha, b.alpha);
    EXPECT_EQ(a.depth_z, b.depth_z);
    for (const Real v : a.rgb) EXPECT_TRUE(v >= 0 && v <= 1);

    std::vector<Vec3d> points, directions;
    for (int i = 0; i < 100; ++i) {
      points.push_back({0.01 * i, 0.3, -0.2});
      directions.push_back({0, 0.6, 0.8});
    }
    std::vector<Real> density(100), rgb(300), density2(100), rgb2(300);
    model.query(points, directions, density, rgb, one);
    loaded.query(points, directions, density2, rgb2, two);
    EXPECT_EQ(density, density2);
    EXPECT_EQ(rgb, rgb2);
    for (const Real d : density) EXPECT_TRUE(std::isfinite(d) && d >= 0);
    EXPECT_NE(density[0], density[99]);
  }
}

// Light along a stretch of the world is that along its image in the cube.
TEST(NetworkRenderer, DensitiesInNormalisedDeviceCoordinatesAreOfTheWorld) {
  NetworkOptions o = test::small_network(test::nerf_options());
  o.space = Space::kNdc;
  auto field = std::make_shared<NetworkField>(o, 0, 1);
  field->initialise(5);
  field->ndc.scale_x = 1.5;
  field->ndc.near = 0.5;
  ModelInfo info;
  info.to_engine.scale = 0.25;
  const RadianceField model(info, field);
  const Vec3d p{0.4, -0.2, 5};
  const std::vector<Vec3d> points(3, p);
  const std::vector<Vec3d> directions{{0, 0, 1}, {1, 0, 0}, {0, -0.6, 0.8}};
  std::vector<Real> density(3), rgb(9);
  ThreadPool pool(1);
  model.query(points, directions, density, rgb, pool);
  ASSERT_GT(density[0], 0);
  for (size_t i = 1; i < 3; ++i)
    EXPECT_NEAR(density[i] / density[0],
                ndc_stretch(field->ndc, p * 0.25, directions[i]) /
                    ndc_stretch(field->ndc, p * 0.25, directions[0]),
                1e-5)
        << i;
  const std::vector<Vec3d> behind{{0, 0, -1}};
  model.query(behind, std::span(directions).first(1), std::span(density).first(1),
              std::span(rgb).first(3), pool);
  EXPECT_EQ(density[0], 0);
}

}  // namespace
}  // namespace nerf
