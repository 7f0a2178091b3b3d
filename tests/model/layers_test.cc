// Layers of pictures (model/layers.h) against surfaces with closed forms, and against each other.
#include "nerf/model/layers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "model/analytic_field.h"
#include "model/homogeneous_field.h"
#include "model/some_info.h"
#include "nerf/model/network_field.h"
#include "nerf/model/renderer.h"
#include "support/cameras.h"
#include "support/network_options.h"
#include "support/tables.h"

namespace nerf {
namespace {

const Layers kEveryLayer{.moments = true,
                         .percentiles = true,
                         .samples = true,
                         .normal = true,
                         .deep = true,
                         .apart = true};

RenderOptions all_layers(int supersample = 1) {
  RenderOptions options;
  options.precision = Precision::kF32;
  options.supersample = supersample;
  options.background = {0.2_r, 0.4_r, 0.6_r};
  options.layers = kEveryLayer;
  return options;
}

// In a scene whose axes and unit are not the engine's; looks at engine's origin from 2.5 off.
struct Shot {
  Similarity to_engine = test::tilted();
  Camera camera = test::pinhole(36, 30, 45);
  Pose pose() const {
    Pose at;
    at.rotation.m = {{{0.8, 0, 0.6}, {0, 1, 0}, {-0.6, 0, 0.8}}};
    at.translation = at.rotation * Vec3d{0, 0, -2.5};
    return to_engine.apply_inverse(at);
  }
};

double degrees_between(const Vec3d& a, const Vec3d& b) {
  return std::acos(std::clamp(dot(a, b) / (length(a) * length(b)), -1.0, 1.0)) * 180 / M_PI;
}

// Compares with what `hit` says of a ray (engine units): distance and normal, or no value where the
// pixel is not compared.
template <class Hit>
void expect_surface(const Frame& frame, const Shot& shot, const Hit& hit) {
  const Pose pose = shot.pose();
  double worst = 0, worst_z = 0, worst_mean = 0, tilt = 0;
  int compared = 0;
  for (int y = 0; y < frame.height; ++y)
    for (int x = 0; x < frame.width; ++x) {
      const Vec3d along = normalized(*unproject(shot.camera, {x + 0.5, y + 0.5}));
      const Pose engine = shot.to_engine.apply(pose);
      const auto truth = hit(engine.translation, engine.rotation * along);
      if (!truth) continue;
      const size_t i = static_cast<size_t>(y * frame.width + x);
      const double distance = truth->first / shot.to_engine.scale;
      worst = std::max(worst, std::abs(frame.layers.distance[i] / distance - 1));
      worst_mean = std::max(worst_mean, std::abs(frame.layers.mean[i] / distance - 1));
      worst_z = std::max(worst_z, std::abs(frame.depth_z[i] / (distance * along.z) - 1));
      const Vec3d normal{frame.layers.normal[3 * i], frame.layers.normal[3 * i + 1],
                         frame.layers.normal[3 * i + 2]};
      tilt += degrees_between(normal, shot.to_engine.rotation.transposed() * truth->second);
      EXPECT_LE(frame.layers.near[i], frame.layers.distance[i]);
      EXPECT_GE(frame.layers.far[i], frame.layers.distance[i]);
      EXPECT_GT(frame.layers.samples[i], 0);
      ++compared;
    }
  ASSERT_GT(compared, 250);
  EXPECT_LT(worst, 0.002);
  EXPECT_LT(worst_z, 0.002);
  EXPECT_LT(worst_mean, 0.002);
  EXPECT_LT(tilt / compared, 1);
}

TEST(Layers, DepthAndNormalsOfASphereAreItsOwn) {
  constexpr double kRadius = 0.7;
  const Shot shot;
  const RadianceField field =
      test::surface_field(shot.to_engine, [&](const Vec3d& p) { return length(p) - kRadius; });
  ThreadPool pool(2);
  for (const int rays : {1, 3}) {
    SCOPED_TRACE(rays);
    const Frame frame = render(field, shot.camera, shot.pose(), all_layers(rays), pool);
    expect_surface(
        frame, shot,
        [&](const Vec3d& from, const Vec3d& along) -> std::optional<std::pair<double, Vec3d>> {
          const double b = dot(from, along);
          // A pixel is 0.056 wide here: one and a half of them inside the edge.
          const double reach = std::sqrt(dot(from, from) - b * b);
          if (reach > kRadius - 0.084) return std::nullopt;
          const double t = -b - std::sqrt(kRadius * kRadius - reach * reach);
          return std::pair(t, from + along * t);
        });
  }
}

TEST(Layers, DepthAndNormalsOfAPlaneAreItsOwn) {
  const Vec3d up = normalized(Vec3d{0.3, -0.5, -1});
  const Shot shot;
  const RadianceField field =
      test::surface_field(shot.to_engine, [&](const Vec3d& p) { return dot(p, up) - 0.1; });
  ThreadPool pool(2);
  const Frame frame = render(field, shot.camera, shot.pose(), all_layers(), pool);
  expect_surface(
      frame, shot,
      [&](const Vec3d& from, const Vec3d& along) -> std::optional<std::pair<double, Vec3d>> {
        const double t = (0.1 - dot(from, up)) / dot(along, up);
        const Vec3d p = from + along * t;
        // The field ends with the box; half a pixel's width and more away from where it does.
        for (int k = 0; k < 3; ++k)
          if (std::abs(p[k]) > 0.95) return std::nullopt;
        return std::pair(t, up);
      });
}

std::shared_ptr<GridField> some_grid() {
  GridOptions o;
  o.levels = 4;
  o.log2_entries = 12;
  o.occupancy_side = 64;
  o.hidden = 32;
  auto grid = std::make_shared<GridField>(o, /*unbounded=*/false, 1);
  grid->initialise(3);
  test::scale_table(*grid, 1e4_r);
  return grid;
}

std::vector<RadianceField> some_fields() {
  ModelInfo info = test::some_info();
  info.to_engine = test::tilted();
  std::vector<RadianceField> fields;
  fields.emplace_back(info, some_grid());
  for (const NetworkOptions& o : {test::small_network(test::nerf_options()),
                                  test::small_network(test::mipnerf360_options())}) {
    auto network = std::make_shared<NetworkField>(o, 0.5, 5);
    network->initialise(4);
    fields.emplace_back(info, network);
  }
  return fields;
}

// What deep samples say of a pixel is what the pixel says of itself.
void expect_deep_sums(const Frame& frame) {
  size_t several = 0;
  for (size_t i = 0; i < frame.alpha.size(); ++i) {
    double weight = 0, rgb[3] = {0, 0, 0};
    Real behind = 0;
    for (const DeepSample& s : frame.layers.deep[i]) {
      ASSERT_GE(s.front, behind) << i;
      ASSERT_GE(s.back, s.front) << i;
      behind = s.back;
      weight += s.weight;
      for (size_t k = 0; k < 3; ++k) rgb[k] += s.rgb[k];
    }
    ASSERT_NEAR(weight, frame.alpha[i], 1e-5) << i;
    for (size_t k = 0; k < 3; ++k) ASSERT_NEAR(rgb[k], frame.layers.rgb[3 * i + k], 1e-5) << i;
    several += frame.layers.deep[i].size() > 1;
  }
  EXPECT_GT(several, 20u);
}

TEST(Layers, TheirPictureIsThePlainOneOfEveryPixelsOwnRays) {
  const Shot shot;
  ThreadPool pool(2);
  for (const RadianceField& field : some_fields())
    for (const int rays : {1, 2})
      for (const bool boxed : {false, true}) {
        SCOPED_TRACE(testing::Message() << field.is_grid() << rays << boxed);
        RenderOptions options = all_layers(rays);
        options.appearance.colours.assign(kColourChange, -0.05_r);
        if (boxed) options.bbox = Box3{{2, -2, 1}, {4, 0.2, 2.5}};
        const Frame layered = render(field, shot.camera, shot.pose(), options, pool);
        options.layers.reset();
        options.interpolated = 0;
        const Frame plain = render(field, shot.camera, shot.pose(), options, pool);
        EXPECT_TRUE(plain.layers.empty());
        ASSERT_EQ(layered.rgb.size(), plain.rgb.size());
        EXPECT_EQ(layered.alpha, plain.alpha);
        EXPECT_EQ(layered.depth_z, plain.depth_z);
        EXPECT_EQ(layered.statistics.density_evaluations, plain.statistics.density_evaluations);
        double alpha = 0;
        for (size_t i = 0; i < plain.alpha.size(); ++i) {
          alpha += plain.alpha[i];
          for (size_t k = 0; k < 3; ++k)
            // Stretches end at gaps too, so that a colour may be shared by fewer samples.
            ASSERT_NEAR(layered.rgb[3 * i + k], plain.rgb[3 * i + k], 2e-3) << i;
        }
        EXPECT_GT(alpha, 5);
      }
}

TEST(Layers, DeepSamplesAddUpToTheirPixel) {
  const Shot shot;
  ThreadPool pool(2);
  for (const RadianceField& field : some_fields())
    for (const int rays : {1, 3})
      for (const bool boxed : {false, true}) {
        SCOPED_TRACE(testing::Message() << field.is_grid() << rays << boxed);
        RenderOptions options = all_layers(rays);
        if (boxed) options.bbox = Box3{{2, -2, 1}, {4, 0.2, 2.5}};
        expect_deep_sums(render(field, shot.camera, shot.pose(), options, pool));
      }
}

// A medium of density 1 from -1 to 1: each stretch stops what lies between its ends.
TEST(Layers, DeepSamplesStandWhereTheLightIsStopped) {
  const RadianceField field = test::homogeneous_field(Similarity());
  Pose pose;
  pose.translation = {0, 0, -3};
  ThreadPool pool(1);
  RenderOptions options = all_layers();
  options.skip_nothing();
  options.shared_colour = 0.1_r;
  const Frame frame = render(field, test::pinhole(9, 9, 40), pose, options, pool);
  const auto& samples = frame.layers.deep[40];  // the middle pixel: along z
  ASSERT_GE(samples.size(), 8u);
  EXPECT_NEAR(samples.front().front, 2, 0.02);
  EXPECT_NEAR(samples.back().back, 4, 0.02);
  for (const DeepSample& s : samples) {
    EXPECT_NEAR(s.weight, std::exp(2 - s.front) - std::exp(2 - s.back), 1e-3);
    EXPECT_NEAR(s.rgb[0], 0.5 * s.weight, 1e-5);
  }
  EXPECT_NEAR(frame.layers.mean[40], 2 + 1 - 2 * std::exp(-2.0) / (1 - std::exp(-2.0)), 0.02);
}

TEST(Layers, AreTheSameForAnyNumberOfThreads) {
  const Shot shot;
  ThreadPool one(1), three(3);
  for (const RadianceField& field : some_fields()) {
    const Frame a = render(field, shot.camera, shot.pose(), all_layers(2), one);
    const Frame b = render(field, shot.camera, shot.pose(), all_layers(2), three);
    for (const auto& [values, per_pixel] : kLayerArrays) {
      EXPECT_EQ(a.layers.*values, b.layers.*values);
      EXPECT_EQ((a.layers.*values).size(), a.alpha.size() * per_pixel);
    }
    for (size_t i = 0; i < a.alpha.size(); ++i) {
      ASSERT_EQ(a.layers.deep[i].size(), b.layers.deep[i].size());
      for (size_t s = 0; s < a.layers.deep[i].size(); ++s)
        ASSERT_EQ(a.layers.deep[i][s].weight, b.layers.deep[i][s].weight);
    }
  }
}

// Of a pixel's four rays: mean and variance of all their light, distances of the middle one.
TEST(Layers, ManyRaysToAPixelAreOnePixel) {
  const Shot shot;
  const RadianceField field = some_fields()[0];
  ThreadPool pool(2);
  const Frame two = render(field, shot.camera, shot.pose(), all_layers(2), pool);
  const Frame fine = render(field, shot.camera.scaled_to(72, 60), shot.pose(), all_layers(1), pool);
  int compared = 0;
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 36; ++x) {
      const size_t at = static_cast<size_t>(y * 36 + x);
      std::vector<double> distances;
      double light = 0, first = 0, second = 0, samples = 0, lowest = 1e30, highest = 0,
             darkest = 1e30;
      for (const int i : {0, 1, 72, 73}) {
        const size_t from = static_cast<size_t>(2 * y * 72 + 2 * x + i);
        samples += fine.layers.samples[from];
        if (fine.layers.distance[from] > 0) distances.push_back(fine.layers.distance[from]);
        lowest = std::min<double>(lowest, fine.layers.near[from]);
        highest = std::max<double>(highest, fine.layers.far[from]);
        darkest = std::min<double>(darkest, fine.layers.far[from]);
        const double w = fine.alpha[from], m = fine.layers.mean[from];
        light += w;
        first += w * m;
        second += w * (fine.layers.variance[from] + m * m);
      }
      EXPECT_EQ(two.layers.samples[at], samples);
      if (light > 0.1) {
        EXPECT_NEAR(two.layers.mean[at], first / light, 1e-3);
        EXPECT_NEAR(two.layers.variance[at], second / light - first / light * first / light, 0.02);
      }
      std::ranges::sort(distances);
      EXPECT_EQ(two.layers.distance[at],
                distances.size() > 2 ? distances[distances.size() / 2] : 0);
      if (lowest > 0) {
        ++compared;
        EXPECT_EQ(two.layers.near[at], lowest);
      }
      if (darkest > 0) {
        EXPECT_EQ(two.layers.far[at], highest);
      }
    }
  EXPECT_GT(compared, 50);
}

// A panorama has no axis: its depth is the distance.
TEST(Layers, OfAPanoramaAreAlongItsRays) {
  const Shot shot;
  ThreadPool pool(2);
  for (const RadianceField& field : some_fields()) {
    Camera camera = panorama(48, 24);
    camera.params[4] = 0.03;  // one eye of two
    const Frame frame = render(field, camera, shot.pose(), all_layers(), pool);
    for (size_t i = 0; i < frame.alpha.size(); ++i)
      ASSERT_NEAR(frame.layers.distance[i], frame.depth_z[i], 1e-5 * frame.depth_z[i]) << i;
    expect_deep_sums(frame);
  }
}

TEST(Layers, WhatIsNotWantedIsNotThere) {
  const Shot shot;
  ThreadPool pool(1);
  RenderOptions options = all_layers();
  options.layers = Layers{};
  const Frame frame = render(some_fields()[0], shot.camera, shot.pose(), options, pool);
  EXPECT_EQ(frame.layers.rgb.size(), frame.rgb.size());
  EXPECT_EQ(frame.layers.distance.size(), frame.alpha.size());
  EXPECT_TRUE(frame.layers.mean.empty() && frame.layers.near.empty() &&
              frame.layers.samples.empty() && frame.layers.normal.empty() &&
              frame.layers.deep.empty());
}

}  // namespace
}  // namespace nerf
