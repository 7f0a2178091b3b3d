// Objects in pictures: closed forms of what is before and behind them.
#include "nerf/model/insertion.h"

#include <gtest/gtest.h>

#include <cmath>

#include "model/analytic_field.h"
#include "model/exact_options.h"
#include "model/homogeneous_field.h"
#include "model/object_light.h"
#include "model/some_objects.h"
#include "support/cameras.h"

namespace nerf {
namespace {

using test::add_rectangle;
using test::along_x;
using test::box_around;
using test::exact_options;
using test::middle_of;
using test::narrow;
using test::screen;
using test::unlit;
using test::without_shadows;

// The medium of density 1 from -1 to 1, colour 0.5.
TEST(Insertion, AnOpaqueScreenInAMediumHasItsClosedForm) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(2);
  const RenderOptions options = exact_options();
  for (const double x : {-2.0, -1.0, -0.4, 0.5, 2.0}) {
    SCOPED_TRACE(x);
    const Insertion screen_at(field, screen(static_cast<Real>(x), 1), without_shadows(), options,
                              pool);
    const Frame f = render(field, narrow(), along_x(), options, pool, {}, nullptr, &screen_at);
    const size_t p = middle_of(f);
    const double left = std::exp(-std::clamp(x + 1, 0.0, 2.0));
    const double colour[3] = {0.2, 0.4, 0.9};
    for (size_t k = 0; k < 3; ++k)
      EXPECT_NEAR(f.rgb[3 * p + k], 0.5 * (1 - left) + left * colour[k], 2e-4);
    EXPECT_NEAR(f.alpha[p], 1, 1e-6);
    const double depth = left <= 0.5 ? 2 + std::log(2.0) : x + 3;
    EXPECT_NEAR(f.depth_z[p], depth, 0.02);
  }
}

TEST(Insertion, LayersOfAlphaLetTheFieldThrough) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(2);
  RenderOptions options = exact_options();
  options.background = {1, 0, 0};
  SceneObject two = screen(-0.5_r, 0.25);
  two.materials.push_back(unlit({0.8, 0.1, 0.3}, 0.5));
  add_rectangle({0.2_r, -3, -3}, {0, 6, 0}, {0, 0, 6}, 1, two);
  const Insertion screens(field, std::move(two), without_shadows(), options, pool);
  const Frame f = render(field, narrow(), along_x(), options, pool, {}, nullptr, &screens);
  const size_t p = middle_of(f);
  const double a[3] = {0.2, 0.4, 0.9}, b[3] = {0.8, 0.1, 0.3}, back[3] = {1, 0, 0};
  const auto medium = [](double length, double behind) {
    return 0.5 * (1 - std::exp(-length)) + std::exp(-length) * behind;
  };
  for (size_t k = 0; k < 3; ++k) {
    const double second = 0.5 * b[k] + 0.5 * medium(0.8, back[k]);
    const double first = 0.25 * a[k] + 0.75 * medium(0.7, second);
    EXPECT_NEAR(f.rgb[3 * p + k], medium(0.5, first), 3e-4);
  }
  EXPECT_NEAR(f.alpha[p], 1 - std::exp(-2.0) * 0.75 * 0.5, 1e-4);
}

TEST(Insertion, WithAlphaZeroItChangesNoBit) {
  const RadianceField field = test::homogeneous_field(test::tilted(), true);
  ThreadPool pool(2);
  const RenderOptions options;
  SceneObject object = screen(0, 0);
  const Insertion nothing(field, std::move(object), {}, options, pool);
  Pose pose = along_x();
  pose.translation = {3, -1, -8};
  const Camera camera = test::pinhole(40, 30, 40);
  const Frame without = render(field, camera, pose, options, pool);
  const Frame with = render(field, camera, pose, options, pool, {}, nullptr, &nothing);
  EXPECT_EQ(with.rgb, without.rgb);
  EXPECT_EQ(with.alpha, without.alpha);
  EXPECT_EQ(with.depth_z, without.depth_z);
}

// A box that stands halfway in an opaque ball: where each is seen, to a pixel.
TEST(Insertion, WhatIsNearerIsSeen) {
  constexpr double kRadius = 0.5, kHalf = 0.3;
  const RadianceField field =
      test::surface_field(Similarity(), [](const Vec3d& p) { return length(p) - kRadius; });
  ThreadPool pool(2);
  const RenderOptions options;  // with the lattice of pixels
  const Insertion box(field, box_around({-0.3_r, 0.35_r, 0.1_r}, static_cast<Real>(kHalf)),
                      without_shadows(), options, pool);
  const Camera camera = test::pinhole(120, 120, 240);
  const Frame f = render(field, camera, along_x(), options, pool, {}, nullptr, &box);
  const auto nearer = [&](double x, double y) {  // 1: the box, 0: the ball, -1: nothing
    const Vec3d o{-3, 0, 0};
    const Vec3d d = normalized(along_x().rotation * *unproject(camera, {x, y}));
    double near = 0, far = 1e9;
    for (int k = 0; k < 3; ++k) {
      const double c = k == 0 ? -0.3 : k == 1 ? 0.35 : 0.1;
      const double a = (c - kHalf - o[k]) / d[k], b = (c + kHalf - o[k]) / d[k];
      near = std::max(near, std::min(a, b));
      far = std::min(far, std::max(a, b));
    }
    const double b = dot(o, d), root = b * b - dot(o, o) + kRadius * kRadius;
    const double ball = root > 0 ? -b - std::sqrt(root) : 1e9;
    if (near < far && near < ball) return 1;
    return ball < 1e9 ? 0 : -1;
  };
  int boxes = 0, balls = 0, wrong = 0;
  for (int y = 1; y < 119; ++y)
    for (int x = 1; x < 119; ++x) {
      const int here = nearer(x + 0.5, y + 0.5);
      bool inside = true;
      for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}})
        inside = inside && nearer(x + 0.5 + dx, y + 0.5 + dy) == here;
      const size_t p = static_cast<size_t>(y * 120 + x);
      const bool red = f.rgb[3 * p] > 0.9_r && f.rgb[3 * p + 1] < 0.1_r;
      boxes += here == 1;
      balls += here == 0;
      if (inside) wrong += (here == 1) != red;
    }
  EXPECT_GT(boxes, 500);
  EXPECT_GT(balls, 500);
  EXPECT_EQ(wrong, 0);
}

TEST(SameShape, IsOneThatOnlyMoves) {
  const SceneObject box = box_around({0.1_r, 0.2_r, 0.3_r}, 0.2_r);
  const std::vector<Vec3> a = box.mesh.positions;
  std::vector<Vec3> b = a;
  for (Vec3& p : b) p = Vec3{-p.y, p.x, p.z} * 3 + Vec3{5, 0, -2};
  EXPECT_TRUE(internal::same_shape(a, b));
  b[9].x += 0.05_r;
  EXPECT_FALSE(internal::same_shape(a, b));
  EXPECT_FALSE(internal::same_shape(a, std::span(a).first(8)));
  EXPECT_FALSE(internal::same_shape({}, {}));
  // A plate whose bump goes through to the other side; first, middle and last points in its plane.
  std::vector<Vec3> plate;
  for (int i = 0; i < 25; ++i)
    plate.push_back({static_cast<Real>(i % 5), static_cast<Real>(i / 5), 0.0_r});
  std::vector<Vec3> other = plate;
  plate[7].z = 0.5_r;
  other[7].z = 0.5_r;
  plate[18].z = 0.4_r;
  other[18].z = -0.4_r;
  EXPECT_FALSE(internal::same_shape(plate, other));
  EXPECT_FALSE(internal::same_shape(a, std::vector<Vec3>(a.size())));
}

// Moved it is as if it had always stood there, and away it leaves no trace.
TEST(Insertion, MovesWithoutATrace) {
  const RadianceField field =
      test::surface_field(Similarity(), [](const Vec3d& p) { return p.z + 0.3; });
  ThreadPool pool(2);
  const RenderOptions options;
  const auto box = [](const Vec3& at) {
    SceneObject object = box_around(at, 0.2_r);
    object.materials[0].unlit = false;
    return object;
  };
  InsertionOptions moving;
  moving.moves = true;
  Insertion moved(field, box({0, 0, 0}), moving, options, pool);
  const Insertion there(field, box({-0.3_r, 0.2_r, 0.1_r}), {}, options, pool);
  const Camera camera = test::pinhole(60, 40, 60);
  const auto picture = [&](const Insertion* object) {
    return render(field, camera, along_x(), options, pool, {}, nullptr, object);
  };
  const Frame at_first = picture(&moved);
  moved.move(box({-0.3_r, 0.2_r, 0.1_r}).mesh, options, pool);
  const Frame a = picture(&moved), b = picture(&there);
  EXPECT_NE(a.rgb, at_first.rgb);
  EXPECT_EQ(a.rgb, b.rgb);
  EXPECT_EQ(a.depth_z, b.depth_z);
  TriangleMesh nothing = box({0, 0, 0}).mesh;
  for (Vec3& p : nothing.positions) p = {0.1_r, 0, 0};
  moved.move(nothing, options, pool);
  EXPECT_EQ(picture(&moved).rgb, picture(nullptr).rgb);
  moved.move(box({0, 0, 0}).mesh, options, pool);
  EXPECT_EQ(picture(&moved).rgb, at_first.rgb);
  // Bent a little and a little more, as if it had always been so: whatever was between.
  const auto bent = [&](Real by) {
    SceneObject object = box({0, 0, 0});
    for (Vec3& p : object.mesh.positions) p.z += by * p.x * p.x;
    return object;
  };
  const Frame expected = [&] {
    const Insertion fresh(field, bent(0.5_r), {}, options, pool);
    return picture(&fresh);
  }();
  for (const Real by : {0.499_r, 0.5_r}) moved.move(bent(by).mesh, options, pool);
  EXPECT_EQ(picture(&moved).rgb, expected.rgb);
}

TEST(Insertion, HasTheSameBitsForAnyThreads) {
  const RadianceField field =
      test::surface_field(Similarity(), [](const Vec3d& p) { return p.z + 0.3; });
  const RenderOptions options;
  SceneObject object = box_around({0, 0, 0}, 0.25_r);
  object.materials[0].unlit = false;
  object.materials[0].roughness = 0.1;
  ThreadPool one(1), two(2);
  const Insertion a(field, object, {}, options, one), b(field, object, {}, options, two);
  const Camera camera = test::pinhole(60, 40, 60);
  const Pose pose = along_x();
  const Frame f = render(field, camera, pose, options, one, {}, nullptr, &a);
  const Frame g = render(field, camera, pose, options, two, {}, nullptr, &b);
  EXPECT_EQ(f.rgb, g.rgb);
  EXPECT_EQ(f.alpha, g.alpha);
  EXPECT_EQ(f.depth_z, g.depth_z);
}

// Layers of a picture count the object in.
TEST(Insertion, LayersHoldTheObject) {
  const RadianceField field = test::homogeneous_field(Similarity());
  ThreadPool pool(2);
  RenderOptions options = exact_options();
  options.background = {0, 1, 0};
  options.layers = Layers{.moments = true, .percentiles = true, .normal = true, .deep = true};
  const Insertion at(field, screen(-0.8_r, 1), without_shadows(), options, pool);
  const Frame f = render(field, narrow(), along_x(), options, pool, {}, nullptr, &at);
  const size_t p = middle_of(f);
  const double left = std::exp(-0.2);
  const PictureLayers& layers = f.layers;
  EXPECT_NEAR(layers.distance[p], 2.2, 1e-3);
  EXPECT_NEAR(layers.normal[3 * p], -1, 1e-5);  // towards the camera
  EXPECT_NEAR(layers.rgb[3 * p + 1], 0.5 * (1 - left) + left * 0.4, 1e-3);
  EXPECT_NEAR(f.rgb[3 * p + 1], layers.rgb[3 * p + 1], 1e-5);
  EXPECT_NEAR(layers.far[p], 2.2, 1e-3);
  EXPECT_LT(layers.near[p], 2.2 - 0.1);
  Real sum = 0;
  for (const DeepSample& s : layers.deep[p]) sum += s.weight;
  EXPECT_NEAR(sum, 1, 1e-4);
  EXPECT_NEAR(layers.deep[p].back().front, 2.2, 1e-3);
}

}  // namespace
}  // namespace nerf
