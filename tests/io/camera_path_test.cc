#include "nerf/io/camera_path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "nerf/base/error.h"
#include "nerf/math/camera_paths.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::error_of;

constexpr double kPi = std::numbers::pi;

Camera camera(int width = 64, int height = 48, double f = 60) {
  Camera c;
  c.model = CameraModel::kPinhole;
  c.width = width;
  c.height = height;
  c.params = {f, f, width * 0.5, height * 0.5};
  return c;
}

// A frame that is neither level nor centred nor of the engine's size in input coordinates.
Similarity skewed_frame() {
  Similarity s;
  s.scale = 0.25;
  s.rotation = to_rotation({0.5, 0.5, -0.1, std::sqrt(1 - 0.51)});
  s.center = {10, -4, 2};
  return s;
}

void add(ModelInfo& info, const Pose& engine_pose, bool held_out = false) {
  ModelView view;
  view.name = "photos/img" + std::to_string(info.views.size()) + ".jpg";
  view.camera = camera();
  view.pose = info.to_engine.apply_inverse(engine_pose);
  view.held_out = held_out;
  info.views.push_back(view);
}

// Cameras around `target` (engine coordinates) on an arc, tilted a little sideways each.
ModelInfo ring(int count, double arc = 2 * kPi, const Vec3d& target = {0.2, -0.1, 0.3}) {
  ModelInfo info;
  info.to_engine = skewed_frame();
  info.near = 0.1;
  info.far = 8;
  for (int i = 0; i < count; ++i) {
    const double a = arc * i / count;
    const Vec3d position = target + Vec3d{2 * std::cos(a), 2 * std::sin(a), 1};
    const Vec3d up{0.1 * std::sin(3 * a), 0.1, 1};
    add(info, {look_rotation(target - position, up), position});
  }
  return info;
}

ModelInfo forward_facing(int count) {
  ModelInfo info;
  info.to_engine = skewed_frame();
  info.near = 1;
  info.far = 6;
  for (int i = 0; i < count; ++i) {
    const Vec3d position{0.1 * (i % 4) - 0.15, -2, 0.1 * (i / 4) - 0.1};
    add(info, {look_rotation({0.01 * i, 1, 0.005 * i}, {0.05, 0, 1}), position});
  }
  return info;
}

Pose engine_pose(const ModelInfo& info, const PathFrame& frame) {
  return info.to_engine.apply(frame.camera_to_world);
}

void expect_sound(const CameraPath& path, int frames) {
  ASSERT_EQ(static_cast<int>(path.frames.size()), frames);
  for (const PathFrame& f : path.frames) {
    ASSERT_LT(orthonormality_error(f.camera_to_world.rotation), 1e-12) << f.name;
    ASSERT_TRUE(std::isfinite(length(f.camera_to_world.translation))) << f.name;
    EXPECT_EQ(f.camera.width, 64);
  }
}

void expect_level(const ModelInfo& info, const CameraPath& path) {
  for (const PathFrame& f : path.frames) {
    const Mat3d r = engine_pose(info, f).rotation;
    EXPECT_NEAR(r.column(0).z, 0, 1e-12) << f.name << ": x is not horizontal";
    EXPECT_LT(r.column(1).z, 0) << f.name << " stands on its head";
  }
}

TEST(CameraPath, OrbitIsALevelCircleAroundWhatIsLookedAt) {
  const ModelInfo info = ring(12);
  const Vec3d target{0.2, -0.1, 0.3};
  const CameraPath path = make_camera_path(info, PathKind::kOrbit, {24, 25});
  expect_sound(path, 24);
  expect_level(info, path);
  EXPECT_EQ(path.fps, 25);
  EXPECT_TRUE(path.notes.empty());
  EXPECT_EQ(path.frames[0].name, "orbit_0000");
  EXPECT_EQ(path.frames[23].name, "orbit_0023");
  double turned = 0;
  for (size_t i = 0; i < path.frames.size(); ++i) {
    const Pose pose = engine_pose(info, path.frames[i]);
    const Vec3d from = pose.translation - target;
    EXPECT_NEAR(std::hypot(from.x, from.y), 2, 1e-6);
    EXPECT_NEAR(from.z, 1, 1e-6);
    EXPECT_LT(length(pose.rotation.column(2) + normalized(from)), 1e-6) << "looks elsewhere";
    const Vec3d next =
        engine_pose(info, path.frames[(i + 1) % path.frames.size()]).translation - target;
    const double step =
        std::atan2(from.x * next.y - from.y * next.x, from.x * next.x + from.y * next.y);
    EXPECT_NEAR(step, 2 * kPi / 24, 1e-4) << "the last step, back to the first frame, included";
    turned += step;
    EXPECT_EQ(path.frames[i].time, 0);
  }
  EXPECT_NEAR(turned, 2 * kPi, 1e-9) << "once around";
}

TEST(CameraPath, OrbitOfCamerasOnOneSideStaysAmongThem) {
  const ModelInfo info = ring(10, kPi / 2);
  const CameraPath path = make_camera_path(info, PathKind::kOrbit, {60, 30});
  expect_sound(path, 60);
  expect_level(info, path);
  EXPECT_EQ(path.notes.size(), 1u);
  double least = 10, most = -10;
  for (const PathFrame& f : path.frames) {
    const Vec3d from = engine_pose(info, f).translation - Vec3d{0.2, -0.1, 0.3};
    const double azimuth = std::atan2(from.y, from.x);
    least = std::min(least, azimuth);
    most = std::max(most, azimuth);
  }
  EXPECT_NEAR(least, 0, 0.02);
  EXPECT_NEAR(most, kPi / 2 * 0.9, 0.02);
  // It turns round gently: a frame before the end it hardly moves.
  const auto step = [&](size_t i) {
    return length(path.frames[i + 1].camera_to_world.translation -
                  path.frames[i].camera_to_world.translation);
  };
  EXPECT_LT(step(14), 0.1 * step(0));
}

TEST(CameraPath, OrbitOfAForwardFacingCaptureIsASmallSwing) {
  const ModelInfo info = forward_facing(12);
  const CameraPath path = make_camera_path(info, PathKind::kOrbit, {30, 30});
  expect_sound(path, 30);
  expect_level(info, path);
  for (const PathFrame& f : path.frames) {
    const Pose pose = engine_pose(info, f);
    EXPECT_LT(length(pose.translation - Vec3d{0, -2, 0}), 0.5) << f.name;
    EXPECT_GT(pose.rotation.column(2).y, 0.9) << f.name;
  }
}

TEST(CameraPath, PanoramaLooksOutward) {
  ModelInfo info = ring(12);
  for (ModelView& view : info.views) {  // turn every camera around its y axis by half a turn
    Mat3d& r = view.pose.rotation;
    r.set_column(0, -r.column(0));
    r.set_column(2, -r.column(2));
  }
  const CameraPath path = make_camera_path(info, PathKind::kOrbit, {12, 30});
  expect_sound(path, 12);
  expect_level(info, path);
  for (const PathFrame& f : path.frames) {
    const Pose pose = engine_pose(info, f);
    EXPECT_GT(dot(pose.rotation.column(2), pose.translation - Vec3d{0.2, -0.1, 0.3}), 0);
  }
}

// Cameras 1 and 3 from the axis, all at height 1: their mean squared distance is 5 + 1.
TEST(CameraPath, SpherifiedIsALevelCircleOnTheCamerasSphere) {
  ModelInfo info;
  info.to_engine = skewed_frame();
  const Vec3d target{0.2, -0.1, 0.3};
  for (int i = 0; i < 12; ++i) {
    const double a = 2 * kPi * i / 12, radius = i % 2 ? 1 : 3;
    const Vec3d position = target + Vec3d{radius * std::cos(a), radius * std::sin(a), 1};
    add(info, {look_rotation(target - position, {0.1, 0, 1}), position});
  }
  const CameraPath path = make_camera_path(info, PathKind::kSpherified, {16, 30});
  expect_sound(path, 16);
  expect_level(info, path);
  EXPECT_EQ(path.frames[3].name, "spherified_0003");
  for (size_t i = 0; i < path.frames.size(); ++i) {
    const Pose pose = engine_pose(info, path.frames[i]);
    const Vec3d from = pose.translation - target;
    EXPECT_NEAR(std::hypot(from.x, from.y), std::sqrt(5), 1e-6);
    EXPECT_NEAR(from.z, 1, 1e-6);
    EXPECT_LT(length(pose.rotation.column(2) + normalized(from)), 1e-6) << "looks elsewhere";
    EXPECT_NEAR(std::cos(std::atan2(from.y, from.x) - 2 * kPi * static_cast<double>(i) / 16), 1,
                1e-9);
  }
}

TEST(CameraPath, EllipseFitsTheCameras) {
  ModelInfo info;
  info.to_engine = skewed_frame();
  const double slant = 0.6;
  for (int i = 0; i < 40; ++i) {  // axes 3 and 1.5, turned by `slant`
    const double a = 2 * kPi * i / 40;
    const double x = 3 * std::cos(a), y = 1.5 * std::sin(a);
    const Vec3d p{x * std::cos(slant) - y * std::sin(slant),
                  x * std::sin(slant) + y * std::cos(slant), 0.5};
    add(info, {look_rotation(-p, {0, 0, 1}), p});
  }
  const CameraPath path = make_camera_path(info, PathKind::kEllipse, {200, 30});
  expect_sound(path, 200);
  expect_level(info, path);
  double longest = 0, shortest = 10, step_least = 10, step_most = 0;
  Vec3d far_end;
  for (size_t i = 0; i < path.frames.size(); ++i) {
    const Pose pose = engine_pose(info, path.frames[i]);
    EXPECT_NEAR(pose.translation.z, 0.5, 1e-9);
    EXPECT_LT(length(pose.rotation.column(2) + normalized(pose.translation)), 1e-6);
    const double r = std::hypot(pose.translation.x, pose.translation.y);
    if (r > longest) far_end = pose.translation;
    longest = std::max(longest, r);
    shortest = std::min(shortest, r);
    const Vec3d next = engine_pose(info, path.frames[(i + 1) % 200]).translation;
    step_least = std::min(step_least, length(next - pose.translation));
    step_most = std::max(step_most, length(next - pose.translation));
  }
  EXPECT_NEAR(longest, 3, 0.15);
  EXPECT_NEAR(shortest, 1.5, 0.1);
  EXPECT_NEAR(std::abs(std::atan(far_end.y / far_end.x)), slant, 0.05);
  EXPECT_LT(step_most / step_least, 1.01) << "constant speed";
}

TEST(CameraPath, SpiralStaysAmongForwardFacingCameras) {
  const ModelInfo info = forward_facing(12);
  const CameraPath path = make_camera_path(info, PathKind::kSpiral, {60, 30});
  expect_sound(path, 60);
  expect_level(info, path);
  double widest = 0;
  for (const PathFrame& f : path.frames) {
    const Pose pose = engine_pose(info, f);
    widest = std::max(widest, length(pose.translation - Vec3d{0, -2, 0}));
    EXPECT_GT(pose.rotation.column(2).y, 0.95) << f.name;
  }
  EXPECT_GT(widest, 0.1);
  EXPECT_LT(widest, 0.4);
  // Of cameras all around it stays near the first one.
  const ModelInfo around = ring(12);
  const CameraPath near_first = make_camera_path(around, PathKind::kSpiral, {60, 30});
  expect_sound(near_first, 60);
  const Vec3d first = around.to_engine.apply(around.views[0].pose).translation;
  for (const PathFrame& f : near_first.frames)
    EXPECT_LT(length(engine_pose(around, f).translation - first), 0.25 * std::sqrt(5.0));
}

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
    ModelInfo info = ring(12, 2 * kPi, {0, 0, 0});
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
