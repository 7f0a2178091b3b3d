// Cameras of glTF files as paths: closed forms, and nerf_export's files read back.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "io/some_gltf.h"
#include "nerf/io/camera_path.h"
#include "nerf/io/mesh_file.h"
#include "nerf/math/camera_paths.h"
#include "support/cameras.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

using test::Json;
using test::SomeGltf;

// Its engine axes are the input's, but for a unit and an origin of its own: glTF's y is z.
ModelInfo capture() {
  ModelInfo info;
  info.to_engine.scale = 0.5;
  info.to_engine.center = {1, 2, 3};
  info.near = 0.1;
  for (int i = 0; i < 3; ++i) {
    ModelView view;
    view.name = "a" + std::to_string(i) + ".jpg";
    view.camera = test::pinhole(160, 120, 100);
    view.pose = {look_rotation({-1, 0, 0}, {0, 0, 1}), {4, static_cast<double>(i), 3}};
    info.views.push_back(view);
  }
  return info;
}

class GltfPathTest : public ::testing::Test {
 protected:
  GltfPathTest() {
    gltf_.json["cameras"] = {
        {{"type", "perspective"},
         {"perspective", {{"yfov", 1.0}, {"aspectRatio", 2.0}, {"znear", 0.1}}}}};
    gltf_.json["nodes"] = {{{"name", "Camera"}, {"camera", 0}}};
  }
  CameraPath read(const PathReading& reading = {}) {
    const auto bytes = gltf_.glb();
    test::write_text(file_, std::string(bytes.begin(), bytes.end()));
    return read_camera_path(file_, info_, reading);
  }
  std::string error(const PathReading& reading = {}) {
    return test::error_of([&] { read(reading); });
  }
  // glTF's axes to those of the input.
  static Vec3d from_gltf(const Vec3d& v) { return {v.x, -v.z, v.y}; }

  ModelInfo info_ = capture();
  SomeGltf gltf_;
  test::TempFolder folder_;
  std::filesystem::path file_ = folder_ / "film.glb";
};

TEST_F(GltfPathTest, NerfExportsFilesAreReadBack) {
  CameraPath path = make_camera_path(info_, PathKind::kOrbit, {.frames = 17});
  path.fps = 24;
  for (const double metres : {1.0, 0.25}) {
    SCOPED_TRACE(metres);
    write_glb_cameras(file_, info_, path, input_to_gltf(info_, metres));
    const CameraPath back = read_camera_path(file_, info_);
    EXPECT_EQ(back.fps, 24);
    EXPECT_EQ(back.begin, 0);
    ASSERT_EQ(back.frames.size(), path.frames.size());
    for (size_t i = 0; i < back.frames.size(); ++i) {
      const Pose &a = back.frames[i].camera_to_world, &b = path.frames[i].camera_to_world;
      EXPECT_LT(length(a.translation - b.translation), 2e-6) << i;
      EXPECT_LT(rotation_angle(a.rotation, b.rotation), 1e-6) << i;
      EXPECT_EQ(back.frames[i].camera.params, path.frames[i].camera.params);
      EXPECT_EQ(back.frames[i].camera.width, path.frames[i].camera.width);
    }
    EXPECT_EQ(back.frames[3].name, "film_0003");
    ASSERT_FALSE(back.notes.empty());
    EXPECT_TRUE(test::contains(back.notes[0], "a1.jpg"));
    // A training camera alone.
    const CameraPath one = read_camera_path(file_, info_, {.camera = "a1.jpg"});
    ASSERT_EQ(one.frames.size(), 1u);
    EXPECT_LT(length(one.frames[0].camera_to_world.translation - info_.views[1].pose.translation),
              2e-6);
    // At another speed the ends stay.
    const CameraPath twice = read_camera_path(file_, info_, {.fps = 48});
    ASSERT_EQ(twice.frames.size(), 33u);
    EXPECT_LT(length(twice.frames[32].camera_to_world.translation -
                     path.frames[16].camera_to_world.translation),
              2e-6);
  }
}

// A camera two metres behind the middle of a stage that turns by a quarter about y, which stands on
// another node.
TEST_F(GltfPathTest, ACameraOnATurningStage) {
  gltf_.json["nodes"] = {
      {{"name", "Set"}, {"translation", {0, 1, 0}}, {"scale", {2, 2, 2}}, {"children", {1}}},
      {{"name", "Stage"}, {"children", {2}}},
      {{"name", "Camera"}, {"camera", 0}, {"translation", {0, 0, 1}}}};
  const float s = std::sqrt(0.5f);
  gltf_.animate(1, "rotation", {0.5f, 1.5f}, {0, 0, 0, 1, 0, s, 0, s}, "VEC4");
  const CameraPath path = read({.fps = 10});
  ASSERT_EQ(path.frames.size(), 11u);
  EXPECT_EQ(path.begin, 0.5);
  EXPECT_EQ(path.fps, 10);
  for (size_t i = 0; i < 11; ++i) {
    const double a = std::numbers::pi / 2 * static_cast<double>(i) / 10;
    const Pose& pose = path.frames[i].camera_to_world;
    const Vec3d at = Vec3d{0, 1, 0} + Vec3d{std::sin(a), 0, std::cos(a)} * 2.0;
    EXPECT_LT(length(pose.translation - (info_.to_engine.center + from_gltf(at))), 1e-6) << i;
    const Vec3d forward{-std::sin(a), 0, -std::cos(a)};
    EXPECT_LT(length(pose.rotation.column(2) - from_gltf(forward)), 1e-6) << i;
    EXPECT_LT(length(pose.rotation.column(1) - Vec3d{0, 0, -1}), 1e-6) << "down";
  }
  // yfov of 1 and twice as wide as high, at the photos' height.
  const Camera& lens = path.frames[0].camera;
  EXPECT_EQ(lens.height, 120);
  EXPECT_EQ(lens.width, 240);
  EXPECT_NEAR(lens.fy(), 60 / std::tan(0.5), 1e-9);
  EXPECT_EQ(lens.fx(), lens.fy());
}

TEST_F(GltfPathTest, StepsAndCubics) {
  gltf_.animate(0, "translation", {0, 1, 2}, {0, 0, 0, 1, 0, 0, 5, 0, 0}, "VEC3", "STEP");
  const auto x = [&](size_t i) {
    return read({.fps = 2}).frames.at(i).camera_to_world.translation.x - info_.to_engine.center.x;
  };
  EXPECT_NEAR(x(1), 0, 1e-9);
  EXPECT_NEAR(x(3), 1, 1e-9);
  EXPECT_NEAR(x(4), 5, 1e-9);
  // t squared.
  gltf_.json.erase("animations");
  gltf_.animate(0, "translation", {0, 2}, {0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 0, 4, 0, 0, 4, 0, 0},
                "VEC3", "CUBICSPLINE");
  for (size_t i = 0; i < 5; ++i) EXPECT_NEAR(x(i), 0.25 * static_cast<double>(i * i), 1e-6);
}

// Times of 40 s are floats with steps of 4e-6.
TEST_F(GltfPathTest, SpeedOfALongFilmIsThatOfItsKeys) {
  for (const int fps : {24, 25, 60}) {
    std::vector<float> times, values;
    for (int i = 0; i <= 40 * fps; ++i) {
      times.push_back(static_cast<float>(i) / static_cast<float>(fps));
      values.insert(values.end(), {static_cast<float>(i), 0, 0});
    }
    gltf_.json.erase("animations");
    gltf_.animate(0, "translation", times, values, "VEC3");
    const CameraPath path = read();
    EXPECT_EQ(path.fps, fps);
    EXPECT_EQ(path.frames.size(), times.size());
  }
}

TEST_F(GltfPathTest, SpeedIsThatOfItsKeysWhereTheyAreAFilms) {
  std::vector<float> times, values;
  for (int i = 0; i < 25; ++i) {
    times.push_back(static_cast<float>(1 + i) / 25.0f);  // Blender's first frame is 1
    values.insert(values.end(), {static_cast<float>(i), 0, 0});
  }
  gltf_.animate(0, "translation", times, values, "VEC3");
  CameraPath path = read();
  EXPECT_NEAR(path.fps, 25, 1e-9);
  ASSERT_EQ(path.frames.size(), 25u);
  EXPECT_NEAR(path.begin, 0.04, 1e-6);
  EXPECT_NEAR(path.frames[24].camera_to_world.translation.x - 1, 24, 1e-5);
  gltf_.json.erase("animations");
  gltf_.animate(0, "translation", {0, 0.3f, 2}, {0, 0, 0, 1, 0, 0, 2, 0, 0}, "VEC3");
  path = read();
  EXPECT_EQ(path.fps, 30);
  EXPECT_EQ(path.frames.size(), 61u);
}

TEST_F(GltfPathTest, TheFirstThatMovesIsShownOrTheOneOfAName) {
  gltf_.json["nodes"] = {{{"name", "Still"}, {"camera", 0}, {"translation", {9, 0, 0}}},
                         {{"name", "Dolly"}, {"camera", 0}},
                         {{"name", "Crane"}, {"camera", 0}}};
  gltf_.json["scenes"][0]["nodes"] = {0, 1, 2};
  gltf_.animate(1, "translation", {0, 1}, {0, 0, 0, 3, 0, 0}, "VEC3");
  gltf_.animate(2, "translation", {0, 2}, {0, 0, 0, 0, 3, 0}, "VEC3", "LINEAR", 1);
  const CameraPath path = read();
  EXPECT_EQ(path.frames.size(), 31u);
  EXPECT_TRUE(test::contains(path.notes.at(0), "'Dolly' is shown, not Still, Crane"))
      << path.notes[0];
  EXPECT_EQ(read({.camera = "Crane"}).frames.size(), 61u);
  EXPECT_EQ(read({.camera = "Still"}).frames.size(), 1u);
  EXPECT_TRUE(test::contains(error({.camera = "Dolli"}), "did you mean Dolly?"));
}

TEST_F(GltfPathTest, SaysWhatIsWrong) {
  const auto expect = [&](const std::string& part, const auto& change) {
    SCOPED_TRACE(part);
    const SomeGltf whole = gltf_;
    change(gltf_);
    const std::string text = error();
    EXPECT_TRUE(test::contains(text, part)) << text;
    EXPECT_TRUE(test::contains(text, "film.glb"));
    gltf_ = whole;
  };
  EXPECT_EQ(error(), "");
  const auto lens = [](SomeGltf& g) -> Json& { return g.json["cameras"][0]["perspective"]; };
  expect("no camera in it", [](SomeGltf& g) { g.json["nodes"][0].erase("camera"); });
  expect("there is no camera 3", [](SomeGltf& g) { g.json["nodes"][0]["camera"] = 3; });
  expect("yfov of 4", [&](SomeGltf& g) { lens(g)["yfov"] = 4; });
  expect("aspect ratio of -1", [&](SomeGltf& g) { lens(g)["aspectRatio"] = -1; });
  expect("is orthographic", [](SomeGltf& g) {
    g.json["cameras"][0] = {
        {"type", "orthographic"},
        {"orthographic", {{"xmag", 1}, {"ymag", 1}, {"znear", 0.1}, {"zfar", 10}}}};
  });
  expect("mirrored", [](SomeGltf& g) { g.json["nodes"][0]["scale"] = {-1, 1, 1}; });
  expect("mirrored", [](SomeGltf& g) { g.json["nodes"][0]["scale"] = {0, 0, 0}; });
  expect("moves for",
         [](SomeGltf& g) { g.animate(0, "translation", {0, 1e6f}, {0, 0, 0, 3, 0, 0}, "VEC3"); });
  expect("do not rise",
         [](SomeGltf& g) { g.animate(0, "translation", {1, 0}, {0, 0, 0, 3, 0, 0}, "VEC3"); });
  expect("circle", [](SomeGltf& g) { g.json["nodes"][0]["children"] = {0}; });
  expect("input_to_gltf", [](SomeGltf& g) {
    g.json["asset"]["extras"]["input_to_gltf"] = std::vector<double>(16, 1.0);
  });
  EXPECT_TRUE(test::contains(test::error_of([&] {
                               test::write_text(folder_ / "a.json", "[]");
                               read_camera_path(folder_ / "a.json", info_, {.camera = "x"});
                             }),
                             "--path-camera"));
}

}  // namespace
}  // namespace nerf
