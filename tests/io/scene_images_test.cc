// The images of a capture: which belong to it, their size against their camera's, masks.
#include <gtest/gtest.h>

#include <algorithm>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf {
namespace {

using namespace nerf::test;
namespace fs = std::filesystem;

TEST(LoadScene, NamesWithSubfoldersAndSeveralCameras) {
  TestModel model = ring_model(6);
  model.cameras.push_back({2, 2, 80, 60, {90, 40, 30, 0.01}});
  for (size_t i = 0; i < 6; ++i) {
    model.images[i].name = (i % 2 ? "right/" : "left/") + model.images[i].name;
    model.images[i].camera = i % 2 ? 2 : 1;
  }
  TempFolder folder;
  write_binary(model, folder / "sparse");
  for (size_t i = 0; i < 6; ++i) {
    write_picture(folder / "images" / model.images[i].name, i % 2 ? 80 : 40, i % 2 ? 60 : 30);
  }
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.views[0].name, "left/00.png");
  EXPECT_EQ(scene.views[3].name, "right/01.png");
  EXPECT_EQ(scene.cameras[static_cast<size_t>(scene.views[3].camera)].model,
            CameraModel::kSimpleRadial);
  EXPECT_EQ(
      scene.report.camera_models,
      (std::vector<std::string>{"PINHOLE 40x30 (3 images)", "SIMPLE_RADIAL 80x60 (3 images)"}));
}

TEST(LoadScene, ResizedImagesScaleTheirCamera) {
  TestModel model = ring_model(4);
  model.cameras[0] = {1, 2, 81, 60, {90, 40, 30, 0.01}};
  for (TestImage& image : model.images) image.points2d.clear();  // which are not of this lens
  TempFolder folder;
  write_binary(model, folder / "sparse" / "0");
  for (size_t i = 0; i < 4; ++i) {
    // Two at full size, two at half size with a rounded side: ratios differ a little.
    write_picture(folder / "images" / model.images[i].name, i < 2 ? 81 : 40, i < 2 ? 60 : 30);
  }
  const Scene scene = load_scene(folder.path());
  ASSERT_EQ(scene.cameras.size(), 2u);
  const Camera& half = scene.cameras[static_cast<size_t>(scene.views[3].camera)];
  EXPECT_EQ(half.model, CameraModel::kOpenCV);
  EXPECT_DOUBLE_EQ(half.fx(), 90.0 * 40 / 81);
  EXPECT_DOUBLE_EQ(half.fy(), 45);
  EXPECT_EQ(scene.cameras[static_cast<size_t>(scene.views[0].camera)].model,
            CameraModel::kSimpleRadial);
}

TEST(LoadScene, ImagesOfAnotherShapeAreErrors) {
  TempFolder folder;
  write_capture(ring_model(4), folder.path());
  write_picture(folder / "images" / "02.png", 30, 40);
  std::string error = load_error(folder.path());
  EXPECT_TRUE(contains(error, "02.png"));
  EXPECT_TRUE(contains(error, "turned by 90 degrees"));
  EXPECT_TRUE(contains(error, "EXIF"));
  write_picture(folder / "images" / "02.png", 40, 22);
  EXPECT_TRUE(contains(load_error(folder.path()), "cropped"));
  write_text(folder / "images" / "02.png", "no picture");
  EXPECT_TRUE(contains(load_error(folder.path()), "02.png"));
}

TEST(LoadScene, MissingImages) {
  TempFolder folder;
  write_capture(ring_model(10, 5), folder.path());
  for (const char* name : {"01.png", "03.png", "05.png"}) fs::remove(folder / "images" / name);
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.views.size(), 7u);
  EXPECT_EQ(scene.report.images_registered, 10);
  EXPECT_EQ(scene.report.images_missing, 3);
  EXPECT_EQ(scene.report.missing_names, (std::vector<std::string>{"01.png", "03.png", "05.png"}));
  EXPECT_TRUE(any_contains(scene.report.warnings, "3 of 10 registered images are missing: 01.png"));
  // Indices of the split count the images that exist.
  EXPECT_EQ(scene.test, std::vector<int>{0});

  for (const char* name : {"07.png", "08.png"}) fs::remove(folder / "images" / name);
  EXPECT_EQ(load_scene(folder.path()).views.size(), 5u);  // exactly half
  fs::remove(folder / "images" / "09.png");
  EXPECT_TRUE(contains(load_error(folder.path()), "6 of 10 registered images are missing"));
  fs::remove_all(folder / "images");
  EXPECT_TRUE(contains(load_error(folder.path()), "none of the model's 10 images was found"));
}

TEST(LoadScene, TooFewImages) {
  TempFolder folder;
  write_capture(ring_model(1, 0), folder / "one");
  EXPECT_TRUE(contains(load_error(folder / "one"), "only one registered image"));
  write_capture(ring_model(0, 0), folder / "none");
  EXPECT_TRUE(contains(load_error(folder / "none"), "no registered image"));
}

TEST(LoadScene, MasksByAllTheirNames) {
  TempFolder folder;
  write_capture(ring_model(5), folder.path());
  write_picture(folder / "masks" / "00.png");
  write_picture(folder / "masks" / "01.png.png");
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.report.masks, 2);
  EXPECT_EQ(scene.views[0].mask_path, folder / "masks" / "00.png");
  EXPECT_EQ(scene.views[1].mask_path, folder / "masks" / "01.png.png");
  EXPECT_TRUE(scene.views[2].mask_path.empty());
  EXPECT_TRUE(any_contains(scene.report.warnings, "3 of 5 images have no mask"));
  EXPECT_TRUE(contains(scene.report.mask_convention, "128"));

  TestModel model = ring_model(4);
  for (TestImage& image : model.images) image.name.replace(2, 4, ".jpg");
  TempFolder jpegs;
  write_capture(model, jpegs.path());
  for (int i = 0; i < 4; ++i) write_picture(jpegs / "masks" / fmt::format("0{}.png", i));
  EXPECT_EQ(load_scene(jpegs.path()).report.masks, 4);
  EXPECT_TRUE(load_scene(jpegs.path()).report.warnings.empty());

  TempFolder strangers;
  write_capture(model, strangers.path());
  write_picture(strangers / "masks" / "other.png");
  EXPECT_TRUE(
      any_contains(load_scene(strangers.path()).report.warnings, "none named after an image"));
}

TEST(LoadScene, DownscaleMustLeaveSomething) {
  TempFolder folder;
  write_capture(ring_model(4), folder.path());
  SceneOptions options;
  options.downscale = 2;
  const Scene scene = load_scene(folder.path(), options);
  EXPECT_EQ(scene.cameras[0].width, 40);  // cameras are those of the full-size photos
  EXPECT_EQ(scene.options.downscale, 2);
  options.downscale = 31;
  EXPECT_TRUE(contains(load_error(folder.path(), options), "--downscale 31 leaves nothing"));
}

TEST(LoadScene, LargePhotosAreMadeSmallerUnlessSomebodySaysByHowMuch) {
  TempFolder folder;
  TestModel model = ring_model(5);
  model.cameras[0].width = 1024;
  model.cameras[0].height = 16;
  write_capture(model, folder.path());
  const auto make = [&](std::initializer_list<size_t> which, int width, int height) {
    for (const size_t i : which)
      write_picture(folder / "images" / model.images[i].name, width, height);
  };
  SceneOptions options;
  options.downscale = 0;
  const auto chosen = [&] { return load_scene(folder.path(), options).options.downscale; };
  make({2, 3, 4}, 1024, 16);
  make({0, 1}, 4096, 64);
  EXPECT_EQ(chosen(), 1);  // the median is small
  make({2}, 4096, 64);
  const Scene halved = load_scene(folder.path(), options);
  EXPECT_EQ(halved.options.downscale, 2);
  EXPECT_TRUE(any_contains(halved.report.notes,
                           "4096 x 64 pixels are learnt at 1/2 of their size, 2048 x 32"));
  make({0, 1, 2}, 4100, 64);
  EXPECT_EQ(chosen(), 3);
  options.downscale = 1;
  EXPECT_EQ(chosen(), 1);
}

}  // namespace
}  // namespace nerf
