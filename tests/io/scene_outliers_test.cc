// Cameras that stand far out: left out by name, or kept without setting the scene's size.
#include "io/scene_outliers.h"

#include <gtest/gtest.h>

#include "io/scene_statistics.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

// 24 cameras on the ring of radius 4 around 100 points; those of `moved` stand elsewhere, their
// pictures as they were.
TestModel ring_with(const std::vector<std::pair<size_t, Vec3d>>& moved) {
  TestModel model = ring_model(24, 100);
  for (TestImage& image : model.images) image.points2d.clear();  // cameras stay where they are put
  for (TestPoint& point : model.points) {
    point.track.clear();
    for (uint32_t i = 1; i <= 24; ++i) point.track.push_back({i, 0});
  }
  for (const auto& [i, to] : moved) {
    Pose pose = ring_pose(static_cast<int>(i), 24);
    pose.translation = to;
    model.images[i].pose = colmap_pose(pose);
  }
  return model;
}

Scene load(const TestModel& model) {
  TempFolder folder;
  write_capture(model, folder.path());
  return load_scene(folder.path());
}

TEST(SceneStatistics, TheCrowdIsFourFifths) {
  EXPECT_EQ(in_the_crowd({1, 2, 3, 4, 100}, 10), (std::vector<char>{1, 1, 1, 1, 0}));
  EXPECT_EQ(in_the_crowd({1, 2, 3, 4, 40}, 10), (std::vector<char>{1, 1, 1, 1, 1}));
  EXPECT_EQ(in_the_crowd({0, 0, 0, 0, 5}, 10), (std::vector<char>{1, 1, 1, 1, 1}));
  EXPECT_TRUE(in_the_crowd({}, 10).empty());
  EXPECT_EQ(quantile({5, 1, 3}, 0.5), 3);
  EXPECT_EQ(median_position({{1, 5, 0}, {2, 4, 0}, {900, -900, 7}}).x, 2);
}

TEST(FarCameras, AreLeftOutByName) {
  const Scene alone = load(ring_with({}));
  const Scene scene = load(ring_with({{7, {-4000, 3000, 900}}, {16, {9000, 0, 0}}}));
  EXPECT_EQ(scene.views.size(), 22u);
  EXPECT_TRUE(any_contains(scene.report.warnings, "2 of 24 cameras stand more than 50 times"));
  EXPECT_TRUE(any_contains(scene.report.warnings, "07.png, 16.png"));
  EXPECT_FALSE(any_contains(alone.report.warnings, "cameras stand"));
  // The rest is as good as without them.
  EXPECT_NEAR(scene.to_engine.scale, alone.to_engine.scale, 1e-9);
  EXPECT_LT(length(scene.to_engine.center - alone.to_engine.center), 1e-9);
  EXPECT_NEAR(scene.report.near, alone.report.near, 0.1 * alone.report.near);
  EXPECT_NEAR(scene.report.far, alone.report.far, 0.1 * alone.report.far);
  EXPECT_LT(scene.report.extent.size().x, 8.1);
}

TEST(FarCameras, OneThatIsBelievedDoesNotSetTheSize) {
  const Scene alone = load(ring_with({})), scene = load(ring_with({{7, {24, -16, 7}}}));
  EXPECT_EQ(scene.views.size(), 24u);
  EXPECT_NEAR(scene.to_engine.scale, alone.to_engine.scale, 0.05 * alone.to_engine.scale);
  EXPECT_NEAR(scene.report.far, alone.report.far, 0.1 * alone.report.far);
  EXPECT_NEAR(scene.report.near, alone.report.near, 0.1 * alone.report.near);
  EXPECT_LT(scene.report.extent.size().x, 8.1);
  EXPECT_LT(length(scene.report.up - alone.report.up), 0.01);
}

TEST(FarCameras, OfAnOpenSceneWithoutPoints) {
  TempFolder folder;
  for (int i = 0; i < 24; ++i) write_picture(folder / fmt::format("{}.png", i));
  std::string text = transforms_text(24, "", ".png", R"("fl_x":50)");
  write_text(folder / "transforms.json", text);
  const double scale = load_scene(folder.path()).to_engine.scale;
  // The first camera, at (4, 0, 1), goes to (4000000, 0, 1).
  const size_t at = text.find(",4],");
  ASSERT_NE(at, text.npos);
  text.insert(at + 2, "000000");
  write_text(folder / "transforms.json", text);
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.views.size(), 23u);
  EXPECT_TRUE(any_contains(scene.report.warnings, "left out, as badly placed: 0.png"));
  EXPECT_NEAR(scene.to_engine.scale, scale, 0.02 * scale);
}

TEST(FarCameras, ASeriesFromOnePlaceIsNoCrowd) {
  // 20 photos from one place (a millimetre apart) and 4 around the object: none is far out.
  std::vector<std::pair<size_t, Vec3d>> moved;
  for (size_t i = 0; i < 20; ++i) moved.push_back({i, {4 + 0.001 * static_cast<double>(i), 0, 1}});
  TestModel model = ring_with(moved);
  for (size_t i = 0; i < 20; ++i) {
    Pose pose = ring_pose(0, 24);
    pose.translation = moved[i].second;
    model.images[i].pose = colmap_pose(pose);
  }
  EXPECT_EQ(load(model).views.size(), 24u);
}

TEST(NearAndFar, OptionsSetThemInInputUnits) {
  TempFolder folder;
  write_capture(ring_with({}), folder.path());
  SceneOptions options;
  options.near = 0.9;
  Scene scene = load_scene(folder.path(), options);
  EXPECT_NEAR(scene.near, 0.9 * scene.to_engine.scale, 1e-12);
  EXPECT_NEAR(scene.report.near, 0.9, 1e-12);
  options.far = 18;
  scene = load_scene(folder.path(), options);
  EXPECT_NEAR(scene.far, 18 * scene.to_engine.scale, 1e-12);
  options.far = 0.5;
  EXPECT_TRUE(contains(load_error(folder.path(), options), "--near: near is 0.9 and far 0.5"));
  options.near = -1;
  EXPECT_TRUE(contains(load_error(folder.path(), options), "--near: -1 is no distance"));
}

}  // namespace
}  // namespace nerf::internal
