#include "io/colmap_adjustment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "nerf/math/camera_paths.h"
#include "nerf/math/refined_camera.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

// A ring of 16 photos of 640x480 in and about which points lie, seen half a pixel off.
ColmapModel ring(double degrees) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const TestModel of = ring_model(16, 300);
  ColmapModel model;
  model.cameras.push_back({CameraModel::kSimplePinhole, 640, 480, {600, 320, 240}});
  for (int i = 0; i < 16; ++i) {
    const Pose pose = ring_pose(i, 16);
    const Vec3d axis = normalized(Vec3d{normal(random), normal(random), normal(random)});
    model.images.push_back({of.images[static_cast<size_t>(i)].name, 0, pose});
    model.images.back().pose.rotation =
        rotation_by(axis * (degrees * std::numbers::pi / 180)) * pose.rotation;
  }
  for (size_t p = 0; p < of.points.size(); ++p) {
    const Vec3d at = of.points[p].position * 2.5;
    model.points.push_back({at, 0.5, 0});
    for (int i = 0; i < 16; ++i) {
      const Vec3d d = ring_pose(i, 16).inverse() * at;
      const double x = 600 * d.x / d.z + 320, y = 600 * d.y / d.z + 240;
      if (d.z < 1 || x < 2 || y < 2 || x > 638 || y > 478) continue;
      ++model.points.back().views;
      model.observations.push_back({i, static_cast<int32_t>(p)});
      model.keypoints.push_back({x + 0.5 * normal(random), y + 0.5 * normal(random)});
    }
  }
  return model;
}

bool same_poses(const ColmapModel& a, const ColmapModel& b) {
  for (size_t i = 0; i < a.images.size(); ++i)
    if (a.images[i].pose.rotation.m != b.images[i].pose.rotation.m) return false;
  return true;
}

TEST(ColmapAdjustment, TurnsCamerasBackThatDoNotFitTheirPoints) {
  const ColmapModel wrong = ring(1);  // 10 pixels
  ColmapModel model = wrong;
  std::vector<std::string> notes;
  EXPECT_TRUE(adjust_cameras(AdjustCameras::kAuto, model, notes));
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("were adjusted, to 0.5 pixels"), std::string::npos) << notes[0];
  double worst = 0, worst_before = 0;
  for (int i = 0; i + 1 < 16; ++i) {
    const auto step = [&](const Pose& a, const Pose& b) {
      return a.rotation.transposed() * b.rotation;
    };
    const size_t n = static_cast<size_t>(i);
    const Mat3d truth = step(ring_pose(i, 16), ring_pose(i + 1, 16));
    worst = std::max(worst,
                     rotation_angle(truth, step(model.images[n].pose, model.images[n + 1].pose)));
    worst_before = std::max(
        worst_before, rotation_angle(truth, step(wrong.images[n].pose, wrong.images[n + 1].pose)));
  }
  EXPECT_GT(worst_before, 0.01);
  EXPECT_LT(worst, 0.002);
  // Half a pixel of noise each way: a mean length of 0.63, less what points and cameras take up.
  EXPECT_NEAR(model.points[7].error, 0.6, 0.3);
  EXPECT_EQ(model.points[7].views, wrong.points[7].views);
}

TEST(ColmapAdjustment, LeavesCamerasThatFit) {
  const ColmapModel good = ring(0);
  ColmapModel model = good;
  std::vector<std::string> notes;
  EXPECT_FALSE(adjust_cameras(AdjustCameras::kAuto, model, notes));
  EXPECT_TRUE(same_poses(model, good));
  EXPECT_TRUE(notes.empty());
  EXPECT_TRUE(adjust_cameras(AdjustCameras::kOn, model, notes));
  EXPECT_FALSE(same_poses(model, good));
}

TEST(ColmapAdjustment, IsSwitchedOff) {
  const ColmapModel wrong = ring(1);
  ColmapModel model = wrong;
  std::vector<std::string> notes;
  EXPECT_FALSE(adjust_cameras(AdjustCameras::kOff, model, notes));
  EXPECT_TRUE(same_poses(model, wrong));
  EXPECT_TRUE(notes.empty());
}

TEST(ColmapAdjustment, KeypointsOfPhotosOfAnotherSizeAreNotUsed) {
  const ColmapModel good = ring(0);
  ColmapModel model = good;
  for (const double factor : {2.0, 0.25})
    for (const AdjustCameras wanted : {AdjustCameras::kAuto, AdjustCameras::kOn}) {
      for (size_t k = 0; k < model.keypoints.size(); ++k)
        model.keypoints[k] = {factor * good.keypoints[k].x, factor * good.keypoints[k].y};
      std::vector<std::string> notes;
      EXPECT_FALSE(adjust_cameras(wanted, model, notes));
      EXPECT_TRUE(same_poses(model, good));
      EXPECT_TRUE(any_contains(notes, "keypoints are of photos of another size")) << factor;
    }
}

TEST(ColmapAdjustment, KeypointsThatNothingFitsLeaveTheCameras) {
  const ColmapModel good = ring(0);
  ColmapModel model = good;
  std::mt19937 random(4);
  std::uniform_real_distribution<double> x(0, 640), y(0, 480);
  for (Vec2d& k : model.keypoints) k = {x(random), y(random)};
  for (const AdjustCameras wanted : {AdjustCameras::kAuto, AdjustCameras::kOn}) {
    std::vector<std::string> notes;
    EXPECT_FALSE(adjust_cameras(wanted, model, notes));
    EXPECT_TRUE(same_poses(model, good));
    EXPECT_TRUE(any_contains(notes, "no cameras were found that fit"));
  }
}

TEST(ColmapAdjustment, WithoutKeypointsThereIsNothingToAdjustTo) {
  const ColmapModel wrong = ring(1);
  ColmapModel model = wrong;
  for (Vec2d& k : model.keypoints) k.x = std::nan("");
  std::vector<std::string> notes;
  EXPECT_FALSE(adjust_cameras(AdjustCameras::kAuto, model, notes));
  EXPECT_TRUE(notes.empty());
  EXPECT_FALSE(adjust_cameras(AdjustCameras::kOn, model, notes));
  EXPECT_TRUE(notes.empty());
  EXPECT_TRUE(same_poses(model, wrong));
}

// As colmap's own feature_extractor makes it by default: a lens for each photo, focal lengths a few
// per cent off and places along the view that make up for them.
ColmapModel ring_of_lenses() {
  ColmapModel model = ring(0);
  const ColmapModel truth = model;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  model.cameras.clear();
  for (size_t i = 0; i < model.images.size(); ++i) {
    const double focal = 600 * (1 + 0.02 * normal(random));
    model.cameras.push_back({CameraModel::kSimplePinhole, 640, 480, {focal, 320, 240}});
    model.images[i].camera = static_cast<int>(i);
    model.images[i].pose.translation = model.images[i].pose.translation * (focal / 600);
  }
  return model;
}

// Every fourth photo was zoomed.
ColmapModel ring_of_zooms() {
  ColmapModel model = ring(0);
  model.cameras.assign(model.images.size(), model.cameras.front());
  const auto zoom = [](size_t image) { return image % 4 == 0 ? 1.08 : 1; };
  for (size_t i = 0; i < model.images.size(); ++i) {
    model.images[i].camera = static_cast<int>(i);
    model.cameras[i].params[0] *= zoom(i);
  }
  for (size_t k = 0; k < model.keypoints.size(); ++k) {
    Vec2d& pixel = model.keypoints[k];
    const double by = zoom(static_cast<size_t>(model.observations[k].image));
    pixel = {320 + (pixel.x - 320) * by, 240 + (pixel.y - 240) * by};
  }
  return model;
}

TEST(ColmapAdjustment, PhotosThatHadALensEachGetOneWhereThatExplainsThem) {
  ColmapModel model = ring_of_lenses();
  std::vector<std::string> notes;
  EXPECT_TRUE(adjust_cameras(AdjustCameras::kAuto, model, notes));
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_NE(notes[0].find("16 photos of 640 x 480 pixels had a lens each"), std::string::npos)
      << notes[0];
  const int shared = model.images[0].camera;
  for (const ColmapImage& image : model.images) EXPECT_EQ(image.camera, shared);
  const Camera& camera = model.cameras[static_cast<size_t>(shared)];
  EXPECT_EQ(camera.model, CameraModel::kRadial);
  EXPECT_NEAR(camera.fx() / 600, 1, 0.01);
  // Distances from the middle, of which the ring has one.
  double least = 1e9, most = 0;
  for (const ColmapImage& image : model.images) {
    least = std::min(least, length(image.pose.translation));
    most = std::max(most, length(image.pose.translation));
  }
  EXPECT_LT(most / least, 1.01);
}

TEST(ColmapAdjustment, PhotosOfLensesThatDifferKeepThem) {
  const ColmapModel zoomed = ring_of_zooms();
  ColmapModel model = zoomed;
  std::vector<std::string> notes;
  EXPECT_FALSE(adjust_cameras(AdjustCameras::kAuto, model, notes));
  for (size_t i = 0; i < model.images.size(); ++i)
    EXPECT_EQ(model.images[i].camera, static_cast<int>(i));
  EXPECT_TRUE(notes.empty());
}

// A point behind a camera, and a keypoint that no picture has, say nothing of lenses.
TEST(ColmapAdjustment, WhatCannotBeSeenDoesNotShareLenses) {
  ColmapModel model = ring_of_zooms();
  model.points.push_back({ring_pose(0, 16).translation * 2, 0.5, 2});
  const auto behind = static_cast<int32_t>(model.points.size()) - 1;
  for (const int32_t image : {0, 1}) {
    model.observations.push_back({image, behind});
    model.keypoints.push_back({320, 240});
  }
  model.observations.push_back({2, 0});
  model.keypoints.push_back({1e200, 240});
  std::vector<std::string> notes;
  EXPECT_FALSE(adjust_cameras(AdjustCameras::kAuto, model, notes));
  EXPECT_TRUE(notes.empty());
}

TEST(ColmapAdjustment, OneCameraIsNotReplaced) {
  ColmapModel model = ring(0);
  std::vector<std::string> notes;
  EXPECT_FALSE(adjust_cameras(AdjustCameras::kAuto, model, notes));
  EXPECT_EQ(model.cameras.size(), 1u);
}

// A capture as a whole: poses in the scene are not those of the files.
TEST(ColmapAdjustment, AScenesCamerasAreAdjusted) {
  TestModel model = ring_model(12, 60);
  model.cameras[0] = {1, 1, 640, 480, {800, 800, 320, 240}};
  for (TestImage& image : model.images) image.points2d.clear();
  for (TestPoint& point : model.points) {
    point.track.clear();
    for (int i = 0; i < 12; ++i) {
      auto& keypoints = model.images[static_cast<size_t>(i)].points2d;
      const auto [x, y, id] = keypoint_of(ring_pose(i, 12), point);
      point.track.push_back(
          {static_cast<uint32_t>(i) + 1, static_cast<uint32_t>(keypoints.size())});
      keypoints.push_back({16 * x, 16 * y, id});
    }
  }
  for (int i = 0; i < 12; ++i) {
    Pose pose = ring_pose(i, 12);
    pose.rotation = rotation_by({i % 2 ? 0.02 : -0.02, 0, 0.01 * (i % 3)}) * pose.rotation;
    model.images[static_cast<size_t>(i)].pose = colmap_pose(pose);
  }
  TempFolder folder;
  write_colmap_text(model, folder.path() / "sparse" / "0");
  for (const TestImage& image : model.images)
    write_picture(folder.path() / "images" / image.name, 640, 480);
  SceneOptions options;
  const Scene scene = load_scene(folder.path(), options);
  EXPECT_TRUE(scene.cameras_adjusted);
  EXPECT_TRUE(any_contains(scene.report.notes, "cameras, lenses and points were adjusted"));
  EXPECT_LT(scene.report.mean_reprojection_error, 0.05);
  options.adjust_cameras = AdjustCameras::kOff;
  const Scene as_written = load_scene(folder.path(), options);
  EXPECT_FALSE(as_written.cameras_adjusted);
  EXPECT_GT(rotation_angle(as_written.views[1].pose.rotation, scene.views[1].pose.rotation), 0.005);
}

// Some programs write one keypoint for all tracks: points could collapse into what it shows.
TEST(ColmapAdjustment, KeypointsThatDoNotNameTheirPointAreNotBelieved) {
  TestModel written = ring_model(12, 60);
  for (TestImage& image : written.images) image.points2d = {{1.5, 2.5, 7}};
  for (TestPoint& point : written.points) {
    point.track.clear();
    for (uint32_t i = 1; i <= 12; ++i) point.track.push_back({i, 0});
  }
  TempFolder folder;
  write_binary(written, folder / "bin");
  write_colmap_text(written, folder / "txt");
  for (const char* kind : {"bin", "txt"}) {
    ColmapModel model = read_colmap_model(folder / kind);
    const ColmapModel given = model;
    std::vector<std::string> notes;
    EXPECT_FALSE(adjust_cameras(AdjustCameras::kAuto, model, notes)) << kind;
    EXPECT_TRUE(same_poses(model, given));
    EXPECT_EQ(std::ranges::count_if(model.keypoints, [](const Vec2d& k) { return k.x == 1.5; }),
              12);
  }
}

// Tracks may name keypoints that their image does not have.
TEST(ColmapAdjustment, ReadsTracksWithoutKeypoints) {
  TestModel written = ring_model(4, 3);
  written.images[1].points2d.clear();
  TempFolder folder;
  write_colmap_text(written, folder.path());
  const ColmapModel model = read_colmap_model(folder.path());
  ASSERT_EQ(model.keypoints.size(), 9u);
  for (size_t i = 0; i < 9; ++i)
    EXPECT_EQ(std::isnan(model.keypoints[i].x), model.observations[i].image == 1);
}

}  // namespace
}  // namespace nerf::internal
