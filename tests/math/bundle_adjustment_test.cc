#include "math/bundle_adjustment.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "nerf/math/camera_paths.h"
#include "nerf/math/random.h"
#include "nerf/math/refined_camera.h"
#include "support/cameras.h"

namespace nerf {
namespace {

using test::make_camera;

constexpr int kImages = 12, kPoints = 150;
constexpr double kRadius = 4;  // of the arc that the cameras stand on; points fill a ball of 2.5

Vec3d some_vector(Random& random) { return {random.normal(), random.normal(), random.normal()}; }
Vec3d some_direction(Random& random) { return normalized(some_vector(random)); }

// Cameras on two thirds of a circle look at a ball of points; each sees what its picture holds.
Bundle make_bundle(const std::vector<Camera>& cameras) {
  Random random(5, 0, 0);
  Bundle bundle;
  bundle.cameras = cameras;
  for (int i = 0; i < kImages; ++i) {
    const double azimuth = 4.0 / 3 * std::numbers::pi * i / kImages;
    const Vec3d eye{kRadius * std::cos(azimuth), kRadius * std::sin(azimuth), 0.3 * (i % 3)};
    bundle.images.push_back(
        {i % static_cast<int>(cameras.size()), {look_rotation(-eye, {0, 0, 1}), eye}});
  }
  while (bundle.points.size() < kPoints) {
    const Vec3d point = some_vector(random) * 2;
    if (length(point) < 2.5) bundle.points.push_back(point);
  }
  for (int i = 0; i < kImages; ++i)
    for (int p = 0; p < kPoints; ++p) {
      const Bundle::Image& image = bundle.images[static_cast<size_t>(i)];
      const auto pixel = project(bundle.cameras[static_cast<size_t>(image.camera)],
                                 image.pose.inverse() * bundle.points[static_cast<size_t>(p)]);
      const bool seen = pixel && pixel->x > 0 && pixel->y > 0 && pixel->x < 640 && pixel->y < 480;
      if (seen) bundle.keypoints.push_back({i, p, *pixel});
    }
  EXPECT_GT(bundle.keypoints.size(), size_t{kImages} * kPoints / 2);
  return bundle;
}

// Poses are off by half a degree and 1 % of the radius, points by as much, focal lengths by 2 %.
Bundle shaken(Bundle bundle) {
  Random random(6, 0, 0);
  for (Bundle::Image& image : bundle.images) {
    image.pose.rotation = rotation_by(some_direction(random) * 0.0087) * image.pose.rotation;
    image.pose.translation = image.pose.translation + some_direction(random) * (0.01 * kRadius);
  }
  for (Vec3d& point : bundle.points) point = point + some_direction(random) * (0.01 * kRadius);
  for (Camera& camera : bundle.cameras) {
    camera.params[0] *= 1.02;
    if (camera_model_name(camera.model).find("RADIAL") == std::string_view::npos &&
        camera.model != CameraModel::kSimplePinhole)
      camera.params[1] *= 1.02;
  }
  return bundle;
}

// Largest angle between rotations of the two from one image to the next, radians: what does not
// depend on where the whole lies.
double worst_turn(const Bundle& a, const Bundle& b) {
  double worst = 0;
  for (size_t i = 0; i + 1 < a.images.size(); ++i) {
    const auto step = [&](const Bundle& of) {
      return of.images[i].pose.rotation.transposed() * of.images[i + 1].pose.rotation;
    };
    worst = std::max(worst, rotation_angle(step(a), step(b)));
  }
  return worst;
}

TEST(BundleAdjustment, FindsCamerasOfExactKeypointsAgain) {
  using enum CameraModel;
  const std::vector<std::vector<Camera>> lenses = {
      {make_camera(kSimplePinhole, {501, 322, 238})},
      {make_camera(kSimpleRadial, {501, 322, 238, -0.09})},
      {make_camera(kOpenCV, {501, 498, 322, 238, -0.1, 0.04, 0.002, -0.003})},
      {make_camera(kOpenCVFisheye, {301, 298, 322, 238, 0.02, -0.01, 0.004, -0.0005})},
      {make_camera(kFov, {501, 498, 322, 238, 0.5})},
      {make_camera(kSimplePinhole, {501, 322, 238}), make_camera(kPinhole, {700, 690, 310, 250})},
  };
  ThreadPool pool(2);
  for (const std::vector<Camera>& cameras : lenses) {
    SCOPED_TRACE(camera_model_name(cameras.back().model));
    const Bundle truth = make_bundle(cameras);
    Bundle bundle = shaken(truth);
    const AdjustmentResult result = adjust_bundle(bundle, pool);
    EXPECT_GT(result.before, 3);
    // The priors hold on to the shaken cameras as 8 per squared radian against the keypoints' 80 x
    // 500^2. What they leave is far below a hundredth of a pixel, but where the whole bends.
    EXPECT_LT(result.after, 0.005);
    EXPECT_LT(worst_turn(bundle, truth), 5e-5);
    for (size_t c = 0; c < cameras.size(); ++c) {
      EXPECT_NEAR(bundle.cameras[c].fx() / truth.cameras[c].fx(), 1, 5e-4);
      EXPECT_EQ(bundle.cameras[c].cx(), truth.cameras[c].cx());
    }
    EXPECT_LT(result.iterations, 25);
  }
}

// Sum of Cauchy's losses with the scale of the last iterations, by this test's own pinhole.
double loss_of(const Bundle& bundle) {
  double sum = 0;
  for (const Keypoint& k : bundle.keypoints) {
    const Bundle::Image& image = bundle.images[static_cast<size_t>(k.image)];
    const auto& [f, cx, cy] = std::array{bundle.cameras[0].params[0], 322.0, 238.0};
    const Vec3d apart = bundle.points[static_cast<size_t>(k.point)] - image.pose.translation;
    const double z = dot(image.pose.rotation.column(2), apart);
    const double x = f * dot(image.pose.rotation.column(0), apart) / z + cx - k.pixel.x;
    const double y = f * dot(image.pose.rotation.column(1), apart) / z + cy - k.pixel.y;
    sum += 4 * std::log(1 + (x * x + y * y) / 4);
  }
  return sum;
}

// Keypoints are half a pixel off, and one in twenty of them 50 pixels: without a robust loss as if
// all were 11 pixels off.
TEST(BundleAdjustment, WrongKeypointsDoNotMoveTheCameras) {
  const Bundle truth = make_bundle({make_camera(CameraModel::kSimplePinhole, {501, 322, 238})});
  ThreadPool pool(2);
  const auto adjusted = [&](double off) {
    Bundle bundle = shaken(truth), seen = truth;
    Random random(7, 0, 0);
    for (size_t k = 0; k < bundle.keypoints.size(); ++k) {
      const double by = k % 20 == 0 ? off : 0.5;
      bundle.keypoints[k].pixel.x += by * random.normal();
      bundle.keypoints[k].pixel.y += by * random.normal();
    }
    seen.keypoints = bundle.keypoints;
    // Half a pixel each way is 0.59 in the median, of which cameras and points take a part.
    EXPECT_NEAR(adjust_bundle(bundle, pool).after, 0.59, 0.1);
    EXPECT_LT(loss_of(bundle), loss_of(seen));
    return worst_turn(bundle, truth);
  };
  const double clean = adjusted(0.5), wrong = adjusted(50);
  EXPECT_LT(clean, 0.25 * worst_turn(shaken(truth), truth));
  EXPECT_LT(wrong, 1.5 * clean);
}

TEST(BundleAdjustment, IsTheSameForAnyNumberOfThreads) {
  const Bundle given =
      shaken(make_bundle({make_camera(CameraModel::kSimpleRadial, {501, 322, 238, -0.09}),
                          make_camera(CameraModel::kPinhole, {700, 690, 310, 250})}));
  std::vector<Bundle> results;
  for (const int threads : {1, 2, 3}) {
    ThreadPool pool(threads);
    results.push_back(given);
    adjust_bundle(results.back(), pool);
  }
  for (size_t r = 1; r < results.size(); ++r) {
    EXPECT_EQ(results[r].points, results[0].points);
    for (size_t i = 0; i < kImages; ++i) {
      EXPECT_EQ(results[r].images[i].pose.rotation.m, results[0].images[i].pose.rotation.m);
      EXPECT_EQ(results[r].images[i].pose.translation, results[0].images[i].pose.translation);
    }
    for (size_t c = 0; c < 2; ++c)
      EXPECT_EQ(results[r].cameras[c].params, results[0].cameras[c].params);
  }
}

// An image that sees nothing, points that one image sees or none, and points behind a camera.
TEST(BundleAdjustment, WhatNobodySeesStays) {
  Bundle bundle = make_bundle({make_camera(CameraModel::kSimplePinhole, {501, 322, 238})});
  const Bundle truth = bundle;
  bundle = shaken(bundle);
  const size_t alone = bundle.points.size();
  bundle.points.push_back({0.1, 0.2, 0.3});
  bundle.points.push_back({9, 9, 9});
  bundle.points.push_back({100, 0, 0});
  bundle.keypoints.push_back({0, static_cast<int32_t>(alone), {300, 200}});
  for (const int32_t image : {0, 1})  // which stand before it and look away
    bundle.keypoints.push_back({image, static_cast<int32_t>(alone) + 2, {300, 200}});
  bundle.images.push_back(bundle.images.front());
  const Pose unseen = bundle.images.back().pose;
  ThreadPool pool(2);
  EXPECT_LT(adjust_bundle(bundle, pool).after, 0.005);
  EXPECT_EQ(bundle.points[alone], (Vec3d{0.1, 0.2, 0.3}));
  EXPECT_EQ(bundle.points[alone + 1], (Vec3d{9, 9, 9}));
  EXPECT_LT(length(bundle.points[alone + 2] - Vec3d{100, 0, 0}), 1e-6);
  EXPECT_LT(rotation_angle(bundle.images.back().pose.rotation, unseen.rotation), 1e-6);
  EXPECT_LT(length(bundle.images.back().pose.translation - unseen.translation), 1e-9);
}

}  // namespace
}  // namespace nerf
