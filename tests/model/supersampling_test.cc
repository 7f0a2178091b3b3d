// Several rays to a pixel.
#include "model/supersampling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "model/homogeneous_field.h"
#include "nerf/model/network_field.h"
#include "support/cameras.h"
#include "support/network_options.h"

namespace nerf {
namespace {

// Each pixel of `mean` against the n x n of `large` that it covers. Returns how many lie on an edge
// of what has a depth.
int expect_means(const Frame& large, const Frame& mean, int n) {
  EXPECT_EQ(mean.width * n, large.width);
  EXPECT_EQ(mean.height * n, large.height);
  const size_t all = static_cast<size_t>(n * n);
  int edges = 0;
  for (int y = 0; y < mean.height; ++y)
    for (int x = 0; x < mean.width; ++x) {
      double alpha = 0, rgb[3] = {0, 0, 0};
      std::vector<Real> depths;
      for (int i = 0; i < n * n; ++i) {
        const size_t at = static_cast<size_t>((n * y + i / n) * large.width + n * x + i % n);
        alpha += static_cast<double>(large.alpha[at]) / (n * n);
        for (size_t k = 0; k < 3; ++k)
          rgb[k] += static_cast<double>(large.rgb[3 * at + k]) / (n * n);
        if (large.depth_z[at] > 0) depths.push_back(large.depth_z[at]);
      }
      const size_t at = static_cast<size_t>(y * mean.width + x);
      // Sums of n x n floats of at most 1.
      const double bound = 0x1p-24 * (n * n + 2);
      EXPECT_NEAR(static_cast<double>(mean.alpha[at]), alpha, bound);
      for (size_t k = 0; k < 3; ++k)
        EXPECT_NEAR(static_cast<double>(mean.rgb[3 * at + k]), rgb[k], bound);
      std::sort(depths.begin(), depths.end());
      EXPECT_EQ(mean.depth_z[at], 2 * depths.size() > all ? depths[depths.size() / 2] : 0)
          << x << ' ' << y;
      edges += !depths.empty() && depths.size() < all;
    }
  return edges;
}

Pose nine_units_before(const Similarity& to_engine) {
  Pose pose;
  pose.translation = to_engine.center + Vec3d{0.3, -0.2, -9};
  return pose;
}

TEST(Supersampling, AveragesALargerPicture) {
  const Similarity to_engine = test::tilted();
  const RadianceField field = test::homogeneous_field(to_engine);
  const Camera camera = test::pinhole(20, 14, 20, 22);
  const Pose pose = nine_units_before(to_engine);
  ThreadPool pool(2);
  RenderOptions one, three;
  one.interpolated = three.interpolated = 0;  // the means are of all rays
  one.supersample = 1;
  three.supersample = 3;
  three.background = one.background = {0.2, 0.9, 0.4};
  const Frame large = render(field, camera.scaled_to(60, 42), pose, one, pool);
  const Frame mean = render(field, camera, pose, three, pool);
  EXPECT_GT(expect_means(large, mean, 3), 0);
  EXPECT_EQ(mean.statistics.rays, large.statistics.rays);
  EXPECT_NE(render(field, camera, pose, one, pool).rgb, mean.rgb);
}

// A paper's method casts one unless it is asked for more.
TEST(Supersampling, IsForEveryKindOfField) {
  auto network = std::make_shared<NetworkField>(test::small_network(test::nerf_options()), 2, 6);
  network->initialise(3);
  for (Real& w : network->weights) w *= 4;
  ModelInfo info;
  info.near = 1e-3;
  info.alpha = true;
  const RadianceField field(std::move(info), std::move(network));
  const Camera camera = test::pinhole(9, 7, 8);
  Pose pose;
  pose.translation = {0.3, -0.2, -4};
  ThreadPool pool(2);
  RenderOptions automatic, one, two;
  one.supersample = 1;
  two.supersample = 2;
  EXPECT_EQ(rays_per_side(field, automatic, camera, pose), 1);
  EXPECT_EQ(rays_per_side(field, two, camera, pose), 2);
  const Frame single = render(field, camera, pose, one, pool);
  EXPECT_EQ(render(field, camera, pose, automatic, pool).rgb, single.rgb);
  const Frame mean = render(field, camera, pose, two, pool);
  EXPECT_NE(mean.rgb, single.rgb);
  expect_means(render(field, camera.scaled_to(18, 14), pose, one, pool), mean, 2);
}

// Bands are parts of one picture: whatever their number, every pixel is drawn once, in its place.
TEST(Supersampling, BandsHoldNoMoreThanAFewMillionPixels) {
  const Camera camera = test::pinhole(1000, 700, 900);
  std::vector<int> heights;
  std::vector<double> progress;
  const internal::RenderPart draw = [&](const Camera& part, const std::function<void(double)>& at) {
    heights.push_back(part.height);
    at(0.5);
    at(1);
    Frame frame{part.width, part.height, {}, {}, {}};
    const size_t pixels = static_cast<size_t>(part.width) * static_cast<size_t>(part.height);
    EXPECT_LE(pixels, size_t{1} << 22);
    frame.rgb.resize(3 * pixels, 0.5_r);
    frame.alpha.resize(pixels);
    frame.depth_z.resize(pixels);
    for (int y = 0; y < part.height; ++y)
      for (int x = 0; x < part.width; ++x) {
        const Vec3d d = *unproject(part, {x + 0.5, y + 0.5});
        const size_t i =
            static_cast<size_t>(y) * static_cast<size_t>(part.width) + static_cast<size_t>(x);
        frame.alpha[i] = static_cast<Real>(d.y);  // which row of the whole picture this is
        frame.depth_z[i] = static_cast<Real>(2 + d.x);
      }
    frame.statistics.rays = static_cast<int64_t>(pixels);
    return frame;
  };
  const Frame out = internal::render_supersampled(
      5, camera, [&](double share) { progress.push_back(share); }, draw);
  EXPECT_GT(heights.size(), 3u);
  EXPECT_EQ(out.statistics.rays, 25 * 1000 * 700);
  ASSERT_EQ(out.alpha.size(), 1000u * 700u);
  for (int y = 0; y < 700; ++y)
    for (int x : {0, 417, 999}) {
      const Vec3d d = *unproject(camera, {x + 0.5, y + 0.5});
      const size_t i = static_cast<size_t>(1000 * y + x);
      EXPECT_NEAR(static_cast<double>(out.alpha[i]), d.y, 1e-6) << x << ' ' << y;
      EXPECT_NEAR(static_cast<double>(out.depth_z[i]), 2 + d.x, 1e-6) << x << ' ' << y;
    }
  EXPECT_TRUE(std::is_sorted(progress.begin(), progress.end()));
  EXPECT_DOUBLE_EQ(progress.back(), 1);
}

TEST(Supersampling, FollowsThePhotos) {
  const Similarity same;
  const auto field_with = [](const std::vector<ModelView>& views, const Similarity& to_engine) {
    const RadianceField field = test::homogeneous_field(to_engine);
    ModelInfo info = field.info();
    info.views = views;
    return RadianceField(std::move(info), std::make_shared<GridField>(field.grid()));
  };
  const Camera camera = test::pinhole(400, 300, 500);
  Pose pose;
  pose.translation = {0, 0, -3};
  const auto rays = [&](const RadianceField& field, const Camera& c, const Pose& p) {
    return rays_per_side(field, RenderOptions(), c, p);
  };
  EXPECT_EQ(rays(field_with({}, same), camera, pose), 1) << "nothing to compare with";
  const std::vector<ModelView> views = {
      {"a", camera, pose, /*held_out=*/false, 0},
      {"b", camera.scaled_to(40, 30), pose, /*held_out=*/true, 0}};
  const RadianceField field = field_with(views, same);
  EXPECT_EQ(rays(field, camera, pose), 1);
  EXPECT_EQ(rays(field, camera.scaled_to(1600, 1200), pose), 1);
  EXPECT_EQ(rays(field, camera.scaled_to(200, 150), pose), 2);
  EXPECT_EQ(rays(field, camera.scaled_to(100, 75), pose), 4);
  EXPECT_EQ(rays(field, camera.scaled_to(20, 15), pose), kMostSupersampling);
  // Farther away a pixel of the same angle is wider.
  Pose far = pose;
  far.translation = {0, 0, -11};
  EXPECT_EQ(rays(field, camera, far), 3);
  Similarity smaller;  // the same in input units is less in the engine's
  smaller.scale = 0.25;
  EXPECT_EQ(rays(field_with(views, smaller), camera, far), 2);
}

}  // namespace
}  // namespace nerf
