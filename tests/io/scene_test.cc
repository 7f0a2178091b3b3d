#include "nerf/io/scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "io/cameras/made_database.h"
#include "nerf/base/file.h"
#include "nerf/io/photos.h"
#include "nerf/io/video.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf {
namespace {

using namespace nerf::test;
namespace fs = std::filesystem;

const char* const kFieldOfView = R"("camera_angle_x":0.69)";

void write_blender(const fs::path& root, int train, int test, bool transparent = true) {
  const auto part = [&](const std::string& name, int count) {
    write_text(root / fmt::format("transforms_{}.json", name),
               transforms_text(count, fmt::format("./{}/r_", name), "", kFieldOfView));
    for (int i = 0; i < count; ++i) {
      write_picture(root / name / fmt::format("r_{}.png", i), 32, 32, 4, transparent);
    }
  };
  part("train", train);
  part("test", test);
}

TEST(LoadScene, ColmapCapture) {
  TempFolder folder;
  TestModel model = ring_model(17, 60);
  std::reverse(model.images.begin(), model.images.end());  // the model's order is not the names'
  const Vec3d eye = ring_pose(16, 17).translation;
  model.points[0].position = eye * 0.9;
  model.points[0].track = {{17, 0}, {16, 0}, {15, 0}};
  write_capture(model, folder.path());
  write_picture(folder / "images" / "sub" / "unregistered.png");
  const Scene scene = load_scene(folder.path());
  ASSERT_EQ(scene.views.size(), 17u);
  for (int i = 0; i < 17; ++i) {
    const View& view = scene.views[static_cast<size_t>(i)];
    EXPECT_EQ(view.name, fmt::format("{:02}.png", i));
    EXPECT_TRUE(fs::is_regular_file(view.image_path));
    EXPECT_LT(length(view.pose.translation - ring_pose(i, 17).translation), 1e-9);
  }
  EXPECT_EQ(scene.test, (std::vector<int>{0, 8, 16}));
  EXPECT_EQ(scene.train.size(), 14u);
  EXPECT_EQ(scene.cameras.size(), 1u);
  EXPECT_TRUE(scene.unbounded);
  EXPECT_FALSE(scene.alpha);
  const SceneReport& report = scene.report;
  EXPECT_EQ(report.format, "COLMAP binary, sparse/0");
  EXPECT_EQ(report.images_total, 18);
  EXPECT_EQ(report.images_registered, 17);
  EXPECT_EQ(report.images_missing, 0);
  EXPECT_EQ(report.points, 60);
  EXPECT_NEAR(report.mean_reprojection_error, 0.5, 1e-12);
  EXPECT_EQ(report.camera_models, std::vector<std::string>{"PINHOLE 40x30"});
  EXPECT_GT(report.up.z, 0.999);
  // Half of what the image right behind the first point sees: its observations are still its own.
  EXPECT_NEAR(report.near, 0.5 * 0.1 * length(eye), 1e-6);
  EXPECT_GE(report.memory_estimate_bytes, 17u * 40 * 30 * 3);
  EXPECT_GT(report.memory_limit_bytes, 0u);
  EXPECT_TRUE(report.warnings.empty());
}

TEST(LoadScene, Splits) {
  TempFolder folder;
  write_capture(ring_model(20, 5), folder.path());
  SceneOptions options;
  options.split = Split::kNone;
  Scene scene = load_scene(folder.path(), options);
  EXPECT_EQ(scene.train.size(), 20u);
  EXPECT_TRUE(scene.test.empty());

  const Similarity frame = scene.to_engine;
  options.split = Split::kDev;
  scene = load_scene(folder.path(), options);
  // Views 0, 8 and 16 are gone; of the 17 left, 0, 8 and 16 are 01, 10 and 19.
  ASSERT_EQ(scene.views.size(), 17u);
  EXPECT_EQ(scene.test, (std::vector<int>{0, 8, 16}));
  EXPECT_EQ(scene.views[0].name, "01.png");
  EXPECT_EQ(scene.views[8].name, "10.png");
  EXPECT_EQ(scene.views[16].name, "19.png");
  EXPECT_EQ(scene.train.size(), 14u);
  EXPECT_EQ(scene.to_engine.scale, frame.scale);
}

TEST(LoadScene, BlenderTripleComesFirst) {
  TempFolder folder;
  write_blender(folder.path(), 10, 3);
  write_text(folder / "transforms_val.json", "{}");
  write_text(folder / "transforms.json", "{}");
  write_binary(ring_model(), folder / "sparse" / "0");
  SceneOptions options;
  const Scene scene = load_scene(folder.path(), options);
  EXPECT_EQ(scene.report.format, "Blender transforms");
  EXPECT_TRUE(scene.alpha);
  EXPECT_FALSE(scene.unbounded);
  EXPECT_EQ(scene.train.size(), 10u);
  EXPECT_EQ(scene.test.size(), 3u);
  EXPECT_EQ(scene.views[static_cast<size_t>(scene.test[0])].name, "test/r_0.png");
  EXPECT_TRUE(any_contains(scene.report.ignored, "transforms_val.json"));
  EXPECT_TRUE(any_contains(scene.report.ignored, "transforms.json"));
  EXPECT_TRUE(any_contains(scene.report.ignored, "COLMAP"));
  EXPECT_EQ(scene.report.up, (Vec3d{0, 0, 1}));

  options.split = Split::kNone;
  EXPECT_EQ(load_scene(folder.path(), options).train.size(), 13u);
  options.split = Split::kDev;
  const Scene dev = load_scene(folder.path(), options);
  EXPECT_EQ(dev.views.size(), 10u);
  EXPECT_EQ(dev.test.size(), 2u);
  EXPECT_FALSE(any_contains({dev.views[0].name}, "test/"));
}

TEST(LoadScene, OpaqueAlphaIsNoAlpha) {
  TempFolder folder;
  write_blender(folder.path(), 6, 2, false);
  EXPECT_FALSE(load_scene(folder.path()).alpha);
}

TEST(LoadScene, ColmapBeforeTransformsAndFormatOverrides) {
  TempFolder folder;
  write_capture(ring_model(6), folder.path());
  for (int i = 0; i < 6; ++i) write_picture(folder / "images" / fmt::format("{}.png", i));
  write_text(folder / "transforms.json", transforms_text(6, "images/", ".png", kFieldOfView));
  write_text(folder / "poses_bounds.npy", "");
  const Scene colmap = load_scene(folder.path());
  EXPECT_EQ(colmap.report.format, "COLMAP binary, sparse/0");
  EXPECT_EQ(colmap.report.ignored,
            (std::vector<std::string>{"transforms.json", "poses_bounds.npy"}));

  SceneOptions options;
  options.format = SceneFormat::kTransforms;
  const Scene transforms = load_scene(folder.path(), options);
  EXPECT_EQ(transforms.report.format, "transforms.json");
  EXPECT_EQ(transforms.views[0].name, "images/0.png");
  EXPECT_EQ(transforms.report.ignored,
            (std::vector<std::string>{"COLMAP model (sparse/0, sparse or colmap/sparse/0)",
                                      "poses_bounds.npy"}));
  EXPECT_EQ(load_scene(folder / "transforms.json").report.format, "transforms.json");

  options.format = SceneFormat::kBlender;
  EXPECT_TRUE(contains(load_error(folder.path(), options), "there is no transforms_train.json"));
}

TEST(LoadScene, WhatIsNoSceneIsAnError) {
  TempFolder folder;
  EXPECT_TRUE(contains(load_error(folder / "nowhere"), "there is no such file or folder"));
  EXPECT_TRUE(contains(load_error(folder.path()), "the folder is empty"));
  write_text(folder / "notes.txt", "hello");
  EXPECT_TRUE(contains(load_error(folder.path()), "there is no scene in this folder"));
  EXPECT_TRUE(contains(load_error(folder / "notes.txt"), "neither a transforms .json nor a video"));
  SceneOptions options;
  options.format = SceneFormat::kColmap;
  EXPECT_TRUE(contains(load_error(folder.path(), options), "there is no COLMAP model (sparse/0"));
  options.format = SceneFormat::kAuto;
  options.downscale = -1;
  EXPECT_TRUE(contains(load_error(folder.path(), options), "--downscale -1"));
}

TEST(LoadScene, PhotosNeedAKnownCameraModelAndAFolderToWorkIn) {
  TempFolder folder;
  for (int i = 0; i < 3; ++i) write_picture(folder / fmt::format("{}.png", i));
  EXPECT_TRUE(contains(load_error(folder.path()), "folder to work in"));
  SceneOptions options;
  options.camera_model = "OPENCVV";
  EXPECT_TRUE(contains(load_error(folder.path(), options), "did you mean OPENCV"));
  options.camera_model = "OPENCV";
  write_picture(folder / "masks" / "0.png");
  EXPECT_TRUE(contains(load_error(folder.path(), options), "masks/"));
}

// A film by the installed ffmpeg; a stand-in for colmap gives its frames the poses of a ring.
TEST(LoadScene, FramesOfAVideoBecomeAScene) {
  TempFolder folder;
  std::vector<fs::path> frames;
  TestModel model = ring_model(6, 20);
  for (size_t i = 0; i < model.images.size(); ++i) {
    frames.push_back(folder / fmt::format("{}.png", i));
    write_picture(frames.back());
    model.images[i].name = fmt::format("frame_{:06}.jpg", i + 1);
  }
  fs::create_directories(folder / "capture");
  write_video(folder / "capture" / "walk.mp4", frames);
  write_video(folder / "capture" / "zoom.mp4", frames);
  write_colmap_text(model, folder / "model");
  fs::create_directory(folder / "bin");
  {
    test::MadeDatabase database(folder / "model" / "made.db");
    for (int i = 1; i <= 6; ++i) database.add_image(fmt::format("frame_{:06}.jpg", i), {});
  }
  write_text(folder / "bin" / "colmap",
             "#!/bin/sh\n"
             "[ \"$2\" = -h ] && exit 0\n"
             "[ \"$1\" = feature_extractor ] && cp \"$STANDIN_MODEL/made.db\" \"$3\"\n"
             "[ \"$1\" = mapper ] || exit 0\n"
             "while [ \"$1\" != --output_path ]; do shift; done\n"
             "mkdir \"$2/0\" && cp \"$STANDIN_MODEL\"/* \"$2/0\"\n");
  fs::permissions(folder / "bin" / "colmap", fs::perms{0755});
  const std::string path = ::getenv("PATH");
  ::setenv("PATH", ((folder / "bin").string() + ":" + path).c_str(), 1);
  ::setenv("STANDIN_MODEL", (folder / "model").c_str(), 1);
  SceneOptions options;
  options.work_folder = folder / "run" / "capture";
  options.run_folder = folder / "run";
  Scene scene;
  const std::string error = error_of([&] { scene = load_scene(folder / "capture", options); });
  ::setenv("PATH", path.c_str(), 1);
  ::unsetenv("STANDIN_MODEL");
  ASSERT_EQ(error, "");
  EXPECT_EQ(scene.options.format, SceneFormat::kVideo);
  EXPECT_EQ(scene.report.format.rfind("video walk.mp4, photos, COLMAP text", 0), 0u)
      << scene.report.format;
  EXPECT_EQ(scene.report.ignored, std::vector<std::string>{"zoom.mp4"});
  ASSERT_EQ(scene.views.size(), 6u);
  EXPECT_EQ(scene.views[5].name, "frame_000006.jpg");
  EXPECT_LT(length(scene.views[5].pose.translation - ring_pose(5, 6).translation), 1e-9);
  ThreadPool pool(1);
  EXPECT_EQ(load_photos(scene, pool).photos[0].width, 40);
}

TEST(LoadScene, TheLargestOfSeveralModels) {
  TempFolder folder;
  write_capture(ring_model(9, 5), folder.path());
  fs::rename(folder / "sparse" / "0", folder / "sparse" / "10");
  write_binary(ring_model(3, 2), folder / "sparse" / "0");
  write_colmap_text(ring_model(4, 2), folder / "sparse" / "2");
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.views.size(), 9u);
  EXPECT_EQ(scene.report.format, "COLMAP binary, sparse/10");
  EXPECT_TRUE(any_contains(scene.report.ignored, "sparse/0 (3 images; sparse/10 is the largest"));
  EXPECT_TRUE(any_contains(scene.report.ignored, "sparse/2 (4 images"));
}

TEST(LoadScene, WhereModelsAndImagesMayBe) {
  const TestModel model = ring_model(5);
  for (const char* place : {"sparse/0", "sparse", "colmap/sparse/0", "sparse/3", "."}) {
    for (const char* images : {"images", "images_2", "images_8"}) {
      TempFolder folder;
      write_binary(model, folder / place);
      for (const TestImage& image : model.images) write_picture(folder / images / image.name);
      EXPECT_EQ(load_scene(folder.path()).views.size(), 5u) << place << " " << images;
    }
  }
  // Both: the full-size ones, and the report says so.
  TempFolder folder;
  write_capture(model, folder.path());
  fs::copy(folder / "images", folder / "images_4");
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.views[0].image_path, folder / "images" / "00.png");
  EXPECT_TRUE(any_contains(scene.report.ignored, "images_4/"));
}

TEST(FormatReport, SaysWhatAPersonWantsToKnow) {
  TempFolder folder;
  write_capture(ring_model(9, 60), folder.path());
  write_picture(folder / "masks" / "00.png");
  fs::remove(folder / "images" / "03.png");
  Scene scene = load_scene(folder.path());
  scene.report.ignored.push_back("something");
  const std::string text = format_report(scene.report);
  for (const char* part :
       {"scene         COLMAP binary, sparse/0\n", "9 registered of 9, 1 missing\n",
        "PINHOLE 40x30\n", "60, mean reprojection error 0.50 px\n", "extent        -",
        "near, far     ", "up            (", "masks         1 of 8 images\n",
        "values of 128 and more keep", "memory        about ", "ignored       something\n",
        "warning       1 of 9 registered"}) {
    EXPECT_TRUE(contains(text, part));
  }
}

}  // namespace
}  // namespace nerf
