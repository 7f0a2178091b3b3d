#include "render_plan.h"

#include <gtest/gtest.h>

#include <numbers>

#include "io/some_gltf.h"
#include "nerf/base/error.h"
#include "nerf/math/camera_paths.h"
#include "run_program.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;
using testing_apps::TempFolder;
using testing_apps::write_text;

constexpr uint64_t kPlenty = uint64_t{1} << 40;

ModelInfo model(const std::vector<std::string>& names) {
  ModelInfo info;
  for (size_t i = 0; i < names.size(); ++i) {
    ModelView view;
    view.name = names[i];
    view.camera.model = CameraModel::kSimpleRadial;
    view.camera.width = 640;
    view.camera.height = 480;
    view.camera.params = {500, 320, 240, 0.1};
    const double a = static_cast<double>(i);
    const Vec3d position{2 * std::cos(a), 2 * std::sin(a), 0.5};
    view.pose = {look_rotation(-position, {0, 0, 1}), position};
    view.held_out = i % 2 == 0;
    info.views.push_back(view);
  }
  return info;
}

RenderCommand command(const std::string& views) {
  RenderCommand c;
  c.run = "run";
  c.out = "out";
  c.views = views;
  return c;
}

std::string error_of(const RenderCommand& c, const ModelInfo& info, uint64_t memory = kPlenty) {
  return test::error_of([&] { make_render_plan(c, info, memory); });
}

TEST(RenderPlan, PicturesAreNamedAfterViews) {
  EXPECT_EQ(picture_file("a.jpg"), "a.png");
  EXPECT_EQ(picture_file("left/cam.1/IMG_1.JPG"), "left/cam.1/IMG_1.png");
  EXPECT_EQ(picture_file("orbit_0000"), "orbit_0000.png");
  EXPECT_EQ(picture_file("/etc/passwd"), "etc/passwd.png");
  EXPECT_EQ(picture_file("../../x/./y.png"), "x/y.png");
  EXPECT_EQ(picture_file(".."), "view.png");
  EXPECT_EQ(picture_file(""), "view.png");
  EXPECT_EQ(picture_file("a/" + std::string(255, 'x')), "a/" + std::string(200, 'x') + ".png");
}

TEST(RenderPlan, ViewsKeepNamesSizesAndLenses) {
  const auto plan =
      make_render_plan(command("test"), model({"s/a.jpg", "b.jpg", "c.jpg"}), kPlenty);
  ASSERT_EQ(plan.frames.size(), 2u);
  EXPECT_EQ(plan.frames[0].name, "s/a.jpg");
  EXPECT_EQ(plan.frames[0].color, "s/a.png");
  EXPECT_EQ(plan.frames[0].depth, "depth/s/a.png");
  EXPECT_EQ(plan.frames[1].color, "c.png");
  EXPECT_EQ(plan.frames[0].camera.width, 640);
  EXPECT_EQ(plan.frames[0].camera.model, CameraModel::kSimpleRadial);
  RenderCommand flat = command("train");
  flat.depth = false;
  const auto train = make_render_plan(flat, model({"a", "b", "c"}), kPlenty);
  ASSERT_EQ(train.frames.size(), 1u);
  EXPECT_TRUE(train.frames[0].depth.empty());
}

TEST(RenderPlan, NoTwoPicturesShareAFile) {
  const ModelInfo info = model({"a.jpg", "x", "a.png", "x", "depth/a.tif", "x", "a_2.bmp"});
  const auto plan = make_render_plan(command("test"), info, kPlenty);
  std::set<fs::path> files;
  for (const PlannedFrame& f : plan.frames) {
    EXPECT_TRUE(files.insert(f.color).second) << f.color;
    EXPECT_TRUE(files.insert(f.depth).second) << f.depth;
  }
  EXPECT_EQ(files.size(), 8u);
}

TEST(RenderPlan, SizesAreScaled) {
  RenderCommand c = command("test");
  c.downscale = 3;
  const ModelInfo info = model({"a", "b", "c"});
  auto plan = make_render_plan(c, info, kPlenty);
  EXPECT_EQ(plan.frames[0].camera.width, 213);
  EXPECT_EQ(plan.frames[0].camera.height, 160);
  EXPECT_NEAR(plan.frames[0].camera.fx(), 500 * 213.0 / 640, 1e-9);
  c.downscale = 1;
  c.size = ImageSize{320, 240};
  plan = make_render_plan(c, info, kPlenty);
  EXPECT_EQ(plan.frames[0].camera.width, 320);
  EXPECT_NEAR(plan.frames[0].camera.fx(), 250, 1e-9);
  EXPECT_TRUE(plan.notes.empty());
  c.size = ImageSize{320, 320};
  EXPECT_EQ(make_render_plan(c, info, kPlenty).notes.size(), 1u) << "stretched photos are told of";
  // A generated path keeps square pixels and its height's field of view.
  c.views = "orbit";
  c.size = ImageSize{960, 240};
  c.frames = 7;
  plan = make_render_plan(c, info, kPlenty);
  ASSERT_EQ(plan.frames.size(), 7u);
  EXPECT_EQ(plan.frames[6].color, "orbit_0006.png");
  EXPECT_NEAR(plan.frames[0].camera.fx(), 250, 1e-9);
  EXPECT_NEAR(plan.frames[0].camera.fy(), 250, 1e-9);
  EXPECT_EQ(plan.frames[0].camera.cx(), 480);
  EXPECT_EQ(plan.frames[0].camera.cy(), 120);
}

TEST(RenderPlan, ABackgroundThatTheModelHasNotIsToldOf) {
  const ModelInfo info = model({"a", "b"});
  RenderCommand c = command("test");
  const auto notes = [&](bool shows_background) {
    return make_render_plan(c, info, kPlenty, {{}, shows_background}).notes.size();
  };
  EXPECT_EQ(notes(false), 0u);
  c.background = Vec3{1, 1, 1};
  EXPECT_EQ(notes(false), 1u);
  EXPECT_EQ(notes(true), 0u);
}

TEST(RenderPlan, PathFilesAndFramesPerSecond) {
  const TempFolder folder;
  const fs::path file = folder.path() / "tour.json";
  write_text(file, R"({"render_width": 64, "render_height": 32, "fps": 12, "camera_path": [
    {"camera_to_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], "fov": 50}]})");
  RenderCommand c = command(file.string());
  auto plan = make_render_plan(c, {}, kPlenty);
  ASSERT_EQ(plan.frames.size(), 1u);
  EXPECT_EQ(plan.frames[0].color, "tour_0000.png");
  EXPECT_EQ(plan.frames[0].camera.width, 64);
  EXPECT_EQ(plan.fps, 12);
  c.fps = 25;
  EXPECT_EQ(make_render_plan(c, {}, kPlenty).fps, 25);
  c.frames = 3;
  EXPECT_NE(error_of(c, {}).find("--frames"), std::string::npos);
}

TEST(RenderPlan, GltfCamerasArePaths) {
  const TempFolder folder;
  const fs::path file = folder.path() / "film.glb";
  test::SomeGltf gltf;
  gltf.json["cameras"] = {{{"type", "perspective"}, {"perspective", {{"yfov", 1}, {"znear", 1}}}}};
  gltf.json["nodes"] = {{{"name", "eye"}, {"camera", 0}}};
  gltf.animate(0, "translation", {1, 2}, {0, 0, 0, 1, 0, 0}, "VEC3");
  gltf.write(file);
  const ModelInfo info = model({"a", "b"});
  RenderCommand c = command(file.string());
  c.fps = 8;
  c.check_options();  // pictures alone have a speed here
  const auto plan = make_render_plan(c, info, kPlenty);
  ASSERT_EQ(plan.frames.size(), 9u);
  EXPECT_EQ(plan.fps, 8);
  EXPECT_EQ(plan.frames[8].color, "film_0008.png");
  // What is inserted keeps to the file's time.
  EXPECT_EQ(plan.frames[0].seconds, 1);
  EXPECT_EQ(plan.frames[8].seconds, 2);
  // The same by its other name.
  c.path = file;
  c.views = RenderCommand().views;
  c.check_options();
  EXPECT_EQ(make_render_plan(c, info, kPlenty).frames.size(), 9u);
  c.path_camera = "ear";
  EXPECT_NE(error_of(c, info).find("--path-camera"), std::string::npos);
  c.path_camera = {};
  c.freeze_time = 0;
  EXPECT_EQ(make_render_plan(c, info, kPlenty).frames[8].seconds, 1);
  c.views = "orbit";
  EXPECT_NE(test::error_of([&] { c.check_options(); }).find("--path"), std::string::npos);
  RenderCommand orbit = command("orbit");
  orbit.path_camera = "eye";
  EXPECT_NE(error_of(orbit, info).find("--path-camera"), std::string::npos);
  orbit.path_camera = {};
  EXPECT_EQ(make_render_plan(orbit, info, kPlenty).frames[30].seconds, 1);
}

TEST(RenderPlan, GeneratedPathsShowPanoramasLevel) {
  const ModelInfo info = model({"a", "b", "c", "d"});
  RenderCommand c = command("orbit");
  c.frames = 3;
  c.camera = PictureKind::kEquirectangular;
  auto plan = make_render_plan(c, info, kPlenty);
  ASSERT_EQ(plan.frames.size(), 3u);
  EXPECT_TRUE(plan.notes.empty() || plan.notes[0].find("one side") != std::string::npos);
  for (const PlannedFrame& f : plan.frames) {
    EXPECT_EQ(f.camera.params, panorama(2048, 1024).params);
    EXPECT_FALSE(f.right);
    EXPECT_LT(length(f.camera_to_world.rotation.column(1) - Vec3d{0, 0, -1}), 1e-9)
        << "the orbit's camera looks down";
  }
  c.size = ImageSize{400, 200};
  c.camera = PictureKind::kVr180;
  c.ipd = 0.2;
  plan = make_render_plan(c, info, kPlenty);
  EXPECT_NE(plan.notes.back().find("stretched"), std::string::npos);
  for (const PlannedFrame& f : plan.frames) {
    EXPECT_EQ(f.camera.width, 400);
    EXPECT_DOUBLE_EQ(f.camera.fx(), 400 / std::numbers::pi);
    EXPECT_DOUBLE_EQ(f.camera.fy(), 200 / std::numbers::pi);
    ASSERT_TRUE(f.right);
    const Vec3d apart = f.right->camera_to_world.translation - f.camera_to_world.translation;
    EXPECT_LT(length(apart - f.camera_to_world.rotation.column(0) * 0.2), 1e-9);
  }
}

TEST(RenderPlan, EyesOfOdsAreTheCamerasOwn) {
  const TempFolder folder;
  const fs::path file = folder.path() / "tour.json";
  write_text(file, R"({"camera_type": "omnidirectional", "render_width": 64, "render_height": 32,
    "camera_path": [{"camera_to_world": [1,0,0,3, 0,1,0,0, 0,0,1,0, 0,0,0,1], "fov": 50}]})");
  RenderCommand c = command(file.string());
  c.downscale = 2;
  const auto plan = make_render_plan(c, {}, kPlenty);
  ASSERT_EQ(plan.frames.size(), 1u);
  EXPECT_EQ(plan.picture, PictureKind::kOds);
  EXPECT_NE(plan.notes.at(0).find("--ipd"), std::string::npos);
  const PlannedFrame& f = plan.frames[0];
  ASSERT_TRUE(f.right);
  Camera eye = panorama(32, 16);
  eye.params[4] = -0.032;
  EXPECT_EQ(f.camera.params, eye.params);
  eye.params[4] = 0.032;
  EXPECT_EQ(f.right->camera.params, eye.params);
  EXPECT_EQ(f.right->camera_to_world.translation, f.camera_to_world.translation);
}

TEST(RenderPlan, MistakesAboutPanoramasAreNamed) {
  const ModelInfo info = model({"a", "b", "c"});
  RenderCommand c = command("test");
  c.camera = PictureKind::kOds;
  EXPECT_NE(error_of(c, info).find("--camera is for generated paths"), std::string::npos);
  c = command("orbit");
  c.ipd = 0.1;
  EXPECT_NE(error_of(c, info).find("--ipd is for pictures of two eyes"), std::string::npos);
  const TempFolder folder;
  const fs::path file = folder.path() / "tour.json";
  write_text(file, R"({"camera_type": "vr180", "render_width": 64, "render_height": 64,
    "camera_path": [{"camera_to_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}]})");
  c = command(file.string());
  EXPECT_EQ(error_of(c, info), "");
  c.camera = PictureKind::kPerspective;
  EXPECT_NE(error_of(c, info).find("says no field of view"), std::string::npos);
}

TEST(RenderPlan, MistakesAreNamed) {
  const ModelInfo info = model({"a", "b", "c"});
  EXPECT_EQ(error_of(command("obrit"), info),
            "--views: 'obrit' is neither a known kind of views nor a file (did you mean orbit?)");
  EXPECT_NE(error_of(command("nowhere.json"), info).find("nowhere.json"), std::string::npos);
  EXPECT_NE(error_of(command("orbit"), {}).find("no cameras"), std::string::npos);
  RenderCommand c = command("test");
  c.frames = 3;
  EXPECT_NE(error_of(c, info).find("--frames"), std::string::npos);
  c = command("orbit");
  c.size = ImageSize{16384, 16384};
  const std::string needed = sizeof(Real) == 4 ? "17.2" : "25.8";
  EXPECT_EQ(error_of(c, info, uint64_t{1000000000}),
            "--size: a picture of 16384x16384 needs " + needed +
                " GB of memory, and 1.0 GB are there (give a smaller --size)");
  c = command("test");
  c.mp4 = "x.mp4";
  ModelInfo mixed = info;
  mixed.views[2].camera.width = 600;
  EXPECT_NE(error_of(c, mixed).find("different sizes"), std::string::npos);
  EXPECT_EQ(error_of(c, info), "");
}

TEST(RenderPlan, FindsTheModel) {
  const TempFolder folder;
  const auto error = [](const fs::path& run) -> std::string {
    try {
      return find_model_file(run).string();
    } catch (const Error& e) {
      return e.what();
    }
  };
  EXPECT_NE(error(folder.path() / "none").find("no such file or folder"), std::string::npos);
  EXPECT_NE(error(folder.path()).find("there is no model.nerf"), std::string::npos);
  fs::create_directory(folder.path() / "a b");
  EXPECT_NE(error(folder.path() / "a b").find("-o '" + (folder.path() / "a b").string() + "'"),
            std::string::npos);
  write_text(folder.path() / "model.nerf", "x");
  EXPECT_EQ(error(folder.path()), folder.path() / "model.nerf");
  EXPECT_EQ(error(folder.path() / "model.nerf"), folder.path() / "model.nerf");
}

TEST(RenderOptions, SizesAreParsedStrictly) {
  const auto good = parse_image_size("800x600");
  ASSERT_TRUE(good);
  EXPECT_EQ(good->width, 800);
  EXPECT_EQ(good->height, 600);
  for (const char* text : {"", "x", "800", "800x", "x600", "800x600x3", "800X600", "800 x 600",
                           "0x600", "-8x6", "800x16385", "99999999999x1", "8.5x6"})
    EXPECT_FALSE(parse_image_size(text)) << text;
}

TEST(RenderOptions, CombinationsAreChecked) {
  RenderCommand c = command("test");
  EXPECT_NO_THROW(c.check_options());
  c.size = ImageSize{8, 8};
  c.downscale = 2;
  EXPECT_THROW(c.check_options(), Error);
  c.downscale = 1;
  c.mp4 = "video.avi";
  EXPECT_THROW(c.check_options(), Error);
  c.mp4 = "video.mp4";
  EXPECT_NO_THROW(c.check_options());
  c.fps = 25;
  EXPECT_NO_THROW(c.check_options());
  c.mp4.clear();
  EXPECT_THROW(c.check_options(), Error);
}

}  // namespace
}  // namespace nerf::apps
