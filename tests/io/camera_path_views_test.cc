// Camera paths through the views of a capture, the camera they are shown with, and captures that
// leave little to go by.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "nerf/base/error.h"
#include "nerf/io/camera_path.h"
#include "path_captures.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::add;
using test::camera;
using test::engine_pose;
using test::error_of;
using test::expect_level;
using test::expect_sound;
using test::ring;

TEST(CameraPath, InterpolationVisitsTrainingViewsInCaptureOrderAtConstantSpeed) {
  ModelInfo info = ring(12);
  // Names sorted bytewise put img10 and img11 before img2; capture order does not.
  std::swap(info.views[2], info.views[10]);
  info.views[5].held_out = true;
  const int frames = 400;
  const CameraPath path = make_camera_path(info, PathKind::kInterpolate, {frames, 30});
  expect_sound(path, frames);
  size_t seen = 0;
  std::vector<int> order{0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11};
  double least = 1e9, most = 0, held_out = 1e9;
  for (int i = 0; i < frames; ++i) {
    const Pose pose = path.frames[i].camera_to_world;
    for (const ModelView& v : info.views) {
      const double distance = length(v.pose.translation - pose.translation);
      if (v.held_out) held_out = std::min(held_out, distance);
      if (seen < order.size() && v.name == "photos/img" + std::to_string(order[seen]) + ".jpg" &&
          distance < 0.1 && rotation_angle(v.pose.rotation, pose.rotation) < 0.03)
        ++seen;
    }
    if (i == 0) continue;
    const Pose before = path.frames[i - 1].camera_to_world;
    const double moved = length(pose.translation - before.translation) * 0.25;  // engine units
    const double turned = 0.5 * std::sqrt(5.0) * rotation_angle(before.rotation, pose.rotation);
    least = std::min(least, std::hypot(moved, turned));
    most = std::max(most, std::hypot(moved, turned));
  }
  EXPECT_EQ(seen, order.size());
  EXPECT_LT(most / least, 1.05);
  EXPECT_GT(held_out, 0.01) << "the path has no business with held-out views";
}

TEST(CameraPath, TimesRunAlongWhereViewsHaveThem) {
  ModelInfo info = ring(5);
  for (int i = 0; i < 5; ++i) info.views[i].time = (5 - i) * 0.1;  // against the names' order
  const CameraPath orbit = make_camera_path(info, PathKind::kOrbit, {11, 30});
  EXPECT_EQ(orbit.frames.front().time, 0);
  EXPECT_EQ(orbit.frames[5].time, 0.5);
  EXPECT_EQ(orbit.frames.back().time, 1);
  const CameraPath path = make_camera_path(info, PathKind::kInterpolate, {50, 30});
  EXPECT_NEAR(path.frames.front().time, 0.1, 1e-12);
  EXPECT_NEAR(path.frames.back().time, 0.5, 1e-12);
  EXPECT_LT(
      length(path.frames.front().camera_to_world.translation - info.views[4].pose.translation),
      1e-9);
  for (size_t i = 1; i < 50; ++i) EXPECT_GE(path.frames[i].time, path.frames[i - 1].time);
  // A camera that stood still: of three equal stretches the first now takes twice the time of the
  // others, 0.2 of 49 / 3 frames, and no frame jumps.
  info.views[3].pose = info.views[4].pose;
  const CameraPath stood = make_camera_path(info, PathKind::kInterpolate, {50, 30});
  EXPECT_NEAR(stood.frames.front().time, 0.1, 1e-12);
  EXPECT_NEAR(stood.frames.back().time, 0.5, 1e-12);
  for (size_t i = 1; i < 50; ++i) {
    EXPECT_GT(stood.frames[i].time, stood.frames[i - 1].time);
    EXPECT_LT(stood.frames[i].time - stood.frames[i - 1].time, 1.3 * 0.2 * 3 / 49);
  }
}

TEST(CameraPath, ARigInMotionIsSeenByOneOfItsCameras) {
  ModelInfo info = ring(6);
  for (int i = 0; i < 6; ++i) {
    info.views[i].ids = {i / 2, -1, i % 2};
    info.views[i].time = (i / 2) / 2.0;
    info.views[i].held_out = i == 2;
  }
  info.views[3].ids.camera = 0;
  const CameraPath path = make_camera_path(info, PathKind::kInterpolate, {41, 30});
  const auto passes = [&](int view) {
    return std::ranges::any_of(path.frames, [&](const PathFrame& frame) {
      return length(frame.camera_to_world.translation - info.views[view].pose.translation) < 0.5;
    });
  };
  for (const int own : {0, 2, 3, 4}) EXPECT_TRUE(passes(own)) << own;
  for (const int other : {1, 5}) EXPECT_FALSE(passes(other)) << other;
}

TEST(CameraPath, ViewsComeWithTheirOwnNamesAndCameras) {
  ModelInfo info = ring(5);
  info.views[1].held_out = info.views[4].held_out = true;
  info.views[4].camera = camera(32, 24);
  const CameraPath test = make_camera_path(info, PathKind::kTest);
  ASSERT_EQ(test.frames.size(), 2u);
  EXPECT_EQ(test.frames[0].name, "photos/img1.jpg");
  EXPECT_EQ(test.frames[1].camera.width, 32);
  EXPECT_EQ(test.frames[1].camera_to_world.translation, info.views[4].pose.translation);
  EXPECT_EQ(make_camera_path(info, PathKind::kTrain).frames.size(), 3u);
  EXPECT_NE(error_of([] { make_camera_path(ring(3), PathKind::kTest); }).find("no held-out views"),
            std::string::npos);
}

TEST(CameraPath, PathCameraIsTheCommonOneWithoutDistortion) {
  ModelInfo info = ring(5);
  info.views[0].camera = camera(320, 240, 900);
  info.views[1].camera.model = CameraModel::kSimpleRadial;
  info.views[1].camera.params = {60, 30, 20, 0.1};
  const Camera c = path_camera(info);
  EXPECT_EQ(c.model, CameraModel::kPinhole);
  EXPECT_EQ(c.width, 64);
  EXPECT_EQ(c.fx(), 60);
  EXPECT_EQ(c.cx(), 32);
  EXPECT_EQ(c.cy(), 24);
  for (ModelView& v : info.views) {
    v.camera.model = CameraModel::kOpenCVFisheye;
    v.camera.params = {20, 20, 32, 24};  // 180 degrees across
  }
  EXPECT_EQ(path_camera(info).fx(), 32) << "a pinhole of 90 degrees";
}

// The orbit of panoramas with any headings turns round the middle of the scene and looks at it.
TEST(CameraPath, PanoramasAreTakenForNoDirection) {
  for (const double heading : {0.0, 2.0}) {
    ModelInfo info = ring(12, 2 * std::numbers::pi, {0, 0, 0});
    for (ModelView& view : info.views) {
      view.camera = panorama(128, 64);
      Pose pose = info.to_engine.apply(view.pose);
      pose.rotation = look_rotation({std::cos(heading), std::sin(heading), 0}, {0, 0, 1});
      view.pose = info.to_engine.apply_inverse(pose);
    }
    EXPECT_EQ(path_camera(info).model, CameraModel::kPinhole);
    EXPECT_EQ(path_camera(info).fx(), 64) << "90 degrees wide";
    for (const PathFrame& frame : make_camera_path(info, PathKind::kOrbit, {8, 30}).frames) {
      const Pose pose = engine_pose(info, frame);
      EXPECT_NEAR(std::hypot(pose.translation.x, pose.translation.y), 2, 1e-9);
      EXPECT_LT(length(pose.rotation.column(2) + normalized(pose.translation)), 1e-9);
    }
  }
}

TEST(CameraPath, DegenerateCaptures) {
  const auto all = {PathKind::kOrbit, PathKind::kSpiral, PathKind::kSpherified, PathKind::kEllipse};
  ModelInfo none;
  for (const PathKind kind :
       {PathKind::kOrbit, PathKind::kSpiral, PathKind::kSpherified, PathKind::kEllipse,
        PathKind::kInterpolate, PathKind::kTest, PathKind::kTrain})
    EXPECT_NE(error_of([&] { make_camera_path(none, kind); }), "");

  ModelInfo one = ring(1);
  for (const PathKind kind : all) {
    const CameraPath path = make_camera_path(one, kind, {20, 30});
    expect_sound(path, 20);
    expect_level(one, path);
    const Vec3d first = engine_pose(one, path.frames[0]).translation;
    EXPECT_GT(length(engine_pose(one, path.frames[7]).translation - first), 1e-3)
        << "a path that stands still shows nothing";
  }
  EXPECT_NE(error_of([&] {
              make_camera_path(one, PathKind::kInterpolate);
            }).find("at least two training cameras"),
            std::string::npos);

  ModelInfo same = ring(1);
  for (int i = 0; i < 3; ++i) same.views.push_back(same.views[0]);
  EXPECT_NE(error_of([&] { make_camera_path(same, PathKind::kInterpolate); }), "");

  ModelInfo line, opposed, above;
  for (int i = 0; i < 4; ++i) {
    add(line, {look_rotation({0, 1, 0}, {0, 0, 1}), {0.3 * i, -2, 0}});
    add(opposed,
        {look_rotation({i % 2 ? 1.0 : -1.0, 0, 0}, {0, 0, 1}), {i % 2 ? -1.0 : 1.0, 0, 0}});
    add(above, {look_rotation({0, 0, -1}, {0, 0, 1}), {0, 0, 3.0 + 0.1 * i}});
  }
  for (const ModelInfo& info : {line, opposed, above})
    for (const PathKind kind :
         {PathKind::kOrbit, PathKind::kSpiral, PathKind::kEllipse, PathKind::kInterpolate})
      expect_sound(make_camera_path(info, kind, {20, 30}), 20);
  for (const PathKind kind : {PathKind::kOrbit, PathKind::kEllipse})
    expect_level(above, make_camera_path(above, kind, {20, 30}));

  ModelInfo broken = ring(4);
  broken.views[2].pose.translation.x = std::nan("");
  EXPECT_NE(error_of([&] { make_camera_path(broken, PathKind::kOrbit); }).find("img2"),
            std::string::npos);
  broken = ring(4);
  broken.views[1].pose.rotation.m[0][0] += 1;
  EXPECT_NE(error_of([&] { make_camera_path(broken, PathKind::kEllipse); }).find("img1"),
            std::string::npos);
  EXPECT_EQ(make_camera_path(ring(4), PathKind::kOrbit, {1, 30}).frames.size(), 1u);
}

}  // namespace
}  // namespace nerf
