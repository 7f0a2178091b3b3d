#include "io/scene_frame.h"

#include <gtest/gtest.h>

#include <numbers>

#include "frame_poses.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

// choose_frame on a capture in memory.
struct Capture {
  SceneInput input;
  Scene scene;

  explicit Capture(const std::vector<Pose>& poses, const std::vector<Vec3d>& points = {}) {
    scene.cameras.push_back({CameraModel::kPinhole, 400, 300, {500, 500, 200, 150}});
    scene.views = views_of(poses);
    for (const Vec3d& p : points) {
      scene.points.push_back({p, 0.5, 3});
      for (int32_t v = 0; v < 3; ++v) {
        input.observations.push_back({v, static_cast<int32_t>(scene.points.size()) - 1});
      }
    }
  }
  void choose() { choose_frame(input, scene); }
  double largest_camera_coordinate() const {
    double largest = 0;
    for (const View& view : scene.views) {
      const Vec3d c = scene.to_engine.apply(view.pose.translation);
      for (int k = 0; k < 3; ++k) largest = std::max(largest, std::abs(c[k]));
    }
    return largest;
  }
};

std::vector<Vec3d> ball(int n, double radius, const Vec3d& center = {}) {
  std::vector<Vec3d> points;
  for (const TestPoint& p : ring_model(1, n).points) points.push_back(center + p.position * radius);
  return points;
}

TEST(ChooseFrame, UnboundedRingHoldsAllCamerasRoundTheFocus) {
  std::vector<Vec3d> points = ball(300, 1, {0, 0, 0});
  for (const Vec3d& p : ball(300, 30)) points.push_back(p);
  Capture capture(rotated(arc(30, 350), tilted()), points);
  for (ScenePoint& p : capture.scene.points) p.position = tilted() * p.position;
  capture.choose();
  const Scene& scene = capture.scene;
  EXPECT_TRUE(scene.unbounded);
  EXPECT_LT(length(scene.to_engine.center), 0.05);
  EXPECT_LE(capture.largest_camera_coordinate(), 1);
  EXPECT_GT(capture.largest_camera_coordinate(), 0.9);
  // The subject's ball of radius 1, seen from 4 away, keeps its share of the box.
  EXPECT_GT(scene.to_engine.scale, 0.2);
  EXPECT_LT(angle(scene.report.up, tilted() * Vec3d{0, 0, 1}), 1.5 * kDegree);
  EXPECT_LT(length(scene.to_engine.rotation * scene.report.up - Vec3d{0, 0, 1}), 1e-9);
  EXPECT_GT(scene.far, 30 * scene.to_engine.scale);
  EXPECT_GT(scene.near, 0);
  EXPECT_NEAR(scene.report.far, scene.far / scene.to_engine.scale, 1e-9);
}

TEST(ChooseFrame, NearIsHalfOfTheClosestSupportedPoint) {
  Capture capture(arc(30, 350), ball(400, 1));
  // A cluster of noise right before a camera, seen by too few images to count.
  for (int i = 0; i < 20; ++i) {
    const Vec3d eye = capture.scene.views[0].pose.translation;
    capture.scene.points.push_back({eye * 0.99, 0.5, 2});
    capture.input.observations.push_back(
        {0, static_cast<int32_t>(capture.scene.points.size()) - 1});
  }
  capture.choose();
  double closest = 1e9;
  for (const Observation& o : capture.input.observations) {
    const ScenePoint& p = capture.scene.points[static_cast<size_t>(o.point)];
    if (p.views >= 3) {
      closest = std::min(
          closest,
          length(p.position - capture.scene.views[static_cast<size_t>(o.image)].pose.translation));
    }
  }
  EXPECT_GE(capture.scene.report.near, 0.5 * closest - 1e-9);
  EXPECT_LT(capture.scene.report.near, 0.6 * closest);
}

// Of two images no point is seen by three.
TEST(ChooseFrame, TwoImagesUseThePointsOfBoth) {
  Capture capture({ring_pose(0, 8), ring_pose(1, 8)}, ball(100, 1));
  capture.input.observations.clear();
  for (int32_t i = 0; i < 100; ++i) {
    capture.scene.points[static_cast<size_t>(i)].views = 2;
    for (int32_t v = 0; v < 2; ++v) capture.input.observations.push_back({v, i});
  }
  capture.choose();
  EXPECT_GT(capture.scene.report.near, 1.5);
  EXPECT_LT(capture.scene.report.near, 2.5);
}

TEST(ChooseFrame, ForwardFacingHoldsCamerasAndPoints) {
  std::vector<Pose> poses;
  for (int i = 0; i < 12; ++i) {
    Pose p = look_at({0, 0, 0}, {0, 10, 0});
    p.translation = {0.3 * (i % 4), 0, 0.3 * (i / 4)};
    poses.push_back(p);
  }
  const std::vector<Vec3d> points = ball(500, 2, {0, 6, 0});
  Capture capture(poses, points);
  capture.choose();
  EXPECT_TRUE(capture.scene.unbounded);
  EXPECT_LE(capture.largest_camera_coordinate(), 1);
  size_t inside = 0;
  for (const Vec3d& p : points) {
    const Vec3d e = capture.scene.to_engine.apply(p);
    inside += std::max({std::abs(e.x), std::abs(e.y), std::abs(e.z)}) <= 1;
  }
  EXPECT_GT(inside, points.size() * 8 / 10);
  EXPECT_GT(capture.scene.to_engine.scale, 0.2);
}

TEST(ChooseFrame, AlphaGivesTheBoxThatAllViewsSee) {
  Capture capture(arc(30, 350));
  capture.scene.alpha = true;
  capture.choose();
  const Scene& scene = capture.scene;
  EXPECT_FALSE(scene.unbounded);
  EXPECT_LT(length(scene.to_engine.center), 1e-6);
  // The farthest cameras are sqrt(16 + 2.5^2) away; half the picture's height is 150/500 of that.
  EXPECT_NEAR(1 / scene.to_engine.scale, std::sqrt(16 + 6.25) * 0.3, 1e-6);
  // The box's nearest and farthest place from a camera, in input units.
  EXPECT_GT(scene.report.near, 1);
  EXPECT_LT(scene.report.near, 4 - 1.4);
  EXPECT_GT(scene.report.far, 4 + 1.4);
  EXPECT_LT(scene.report.far, 8);
}

// load_blender.py: near 2, far 6, with the published captures' cameras 4 units away.
TEST(ChooseFrame, BlendersPublishedRange) {
  std::vector<Pose> poses = arc(30, 350, 0, 0);
  const auto range = [&](bool blender, const SceneOptions& options) {
    Capture capture(poses);
    capture.scene.alpha = true;
    capture.scene.options = options;
    capture.input.blender = blender;
    capture.choose();
    const double scale = capture.scene.to_engine.scale;
    return std::pair(capture.scene.published_near / scale, capture.scene.published_far / scale);
  };
  const auto published = range(true, {});
  EXPECT_NEAR(published.first, 2, 1e-12);
  EXPECT_NEAR(published.second, 6, 1e-12);
  EXPECT_EQ(range(false, {}), std::pair(0.0, 0.0));
  SceneOptions boxed;
  boxed.bbox = Box3{{-2, -2, -2}, {2, 2, 2}};
  EXPECT_EQ(range(true, boxed), std::pair(0.0, 0.0)) << "a box was asked for";
  poses[3] = look_at({3, 0, 0}, {0, 0, 0});
  EXPECT_EQ(range(true, {}), std::pair(0.0, 0.0)) << "a camera stands elsewhere";
}

TEST(ChooseFrame, BlenderSnapsToItsOwnUp) {
  std::vector<Pose> poses = arc(30, 350);
  for (size_t i = 0; i < poses.size(); ++i) poses[i] = rolled(poses[i], i % 3 == 0 ? 0.05 : 0.0);
  Capture capture(poses);
  capture.input.blender = true;
  capture.choose();
  EXPECT_EQ(capture.scene.report.up, (Vec3d{0, 0, 1}));
  EXPECT_EQ(capture.scene.to_engine.rotation.m, Mat3d{}.m);
}

TEST(ChooseFrame, BoundingBoxAndUpOptionsOverride) {
  Capture capture(arc(30, 350), ball(300, 20));
  capture.scene.options.bbox = Box3{{-1, -2, 0}, {3, 2, 1}};
  capture.scene.options.up = Vec3d{0, 0, 2};
  capture.choose();
  EXPECT_TRUE(capture.scene.unbounded) << "opaque photos show what is beyond the box, too";
  EXPECT_EQ(capture.scene.to_engine.center, (Vec3d{1, 0, 0.5}));
  EXPECT_NEAR(capture.scene.to_engine.scale, 0.5, 1e-12);

  capture.scene.options.bbox.reset();
  capture.scene.options.up = Vec3d{1, 0, 0};
  capture.choose();
  EXPECT_LT(length(capture.scene.to_engine.rotation * Vec3d{1, 0, 0} - Vec3d{0, 0, 1}), 1e-9);

  capture.scene.options.up = Vec3d{0, 0, 0};
  EXPECT_TRUE(contains(error_of([&] { capture.choose(); }), "--up"));
  capture.scene.options.up.reset();
  capture.scene.options.bbox = Box3{{1, 0, 0}, {1, 2, 2}};
  EXPECT_TRUE(contains(error_of([&] { capture.choose(); }), "--bbox"));
}

TEST(ChooseFrame, BoundedOnlyWhereEverythingLiesBetweenTheCameras) {
  Capture turntable(arc(30, 350), ball(1000, 1.2));
  turntable.choose();
  EXPECT_FALSE(turntable.scene.unbounded);
  EXPECT_EQ(turntable.scene.report.warnings.size(), 1u);

  std::vector<Vec3d> one_outside = ball(1000, 1.2);
  one_outside.push_back({9, 0, 0});
  Capture room(arc(30, 350), one_outside);
  room.choose();
  EXPECT_TRUE(room.scene.unbounded);

  Capture one_side(arc(30, 120), ball(1000, 1.2));
  one_side.choose();
  EXPECT_TRUE(one_side.scene.unbounded);
}

// Where a panorama's forward axis points says nothing of the scene: cameras on a ring with any
// headings stay in the middle of the frame.
TEST(ChooseFrame, PanoramasLookNowhere) {
  std::vector<Similarity> frames;
  for (const double turn : {0.0, 0.4, 2.0}) {
    std::vector<Pose> poses;
    for (int i = 0; i < 24; ++i) {
      const double a = 2 * std::numbers::pi * i / 24;
      const Vec3d position{4 * std::cos(a) + 7, 4 * std::sin(a), 1};
      poses.push_back(look_at(position, position + Vec3d{std::cos(turn), std::sin(turn), 0}));
    }
    Capture capture(poses);
    capture.scene.cameras = {panorama(64, 32)};
    capture.choose();
    EXPECT_TRUE(capture.scene.unbounded);
    EXPECT_LT(length(capture.scene.to_engine.center - Vec3d{7, 0, 1}), 0.6);
    EXPECT_LE(capture.largest_camera_coordinate(), 1);
    EXPECT_GT(capture.largest_camera_coordinate(), 0.9);
    EXPECT_LT(angle(capture.scene.report.up, {0, 0, 1}), 1e-6);
    frames.push_back(capture.scene.to_engine);
  }
  for (const Similarity& f : frames) {
    EXPECT_EQ(f.scale, frames[0].scale);
    EXPECT_EQ(f.center, frames[0].center);
  }
}

TEST(ChooseFrame, CamerasAtOnePointAreAnError) {
  std::vector<Pose> poses = arc(10, 300);
  for (Pose& p : poses) p.translation = {1, 2, 3};
  Capture capture(poses);
  EXPECT_TRUE(contains(error_of([&] { capture.choose(); }), "all cameras stand at one point"));
}

TEST(ChooseFrame, WithoutPointsNearAndFarAreStillSane) {
  Capture capture(arc(30, 350));
  capture.choose();
  EXPECT_TRUE(capture.scene.unbounded);
  EXPECT_GT(capture.scene.near, 0.01);
  EXPECT_LT(capture.scene.near, 0.2);
  EXPECT_GT(capture.scene.far, 10);
}

}  // namespace
}  // namespace nerf::internal
