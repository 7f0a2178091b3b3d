// Captures as they come out of archives, off disks and from scripts: wrapped in folders, with other
// programs' files between, with slips in their JSON that other readers take.
#include <gtest/gtest.h>

#include <cmath>

#include "io/cameras/capture_photos.h"
#include "io/scene_detect.h"
#include "nerf/base/file.h"
#include "nerf/io/scene.h"
#include "test_images.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;
namespace fs = std::filesystem;

class MovedCaptures : public ::testing::Test {
 protected:
  void write_ring(const fs::path& root, const std::string& prefix = "images/",
                  const std::string& extension = ".png") {
    for (int i = 0; i < 5; ++i) write_picture(root / "images" / fmt::format("{}.png", i));
    write_text(root / "transforms.json", transforms_text(5, prefix, extension, R"("fl_x":50)"));
  }
  std::string text() const { return read_text_file(folder_ / "transforms.json"); }
  TempFolder folder_;
};

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  for (size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + with.size()))
    text.replace(at, what.size(), with);
  return text;
}

TEST_F(MovedCaptures, ArchivesUnpackedIntoFolders) {
  write_capture(ring_model(5), folder_ / "garden" / "garden");
  write_text(folder_ / "__MACOSX" / "._garden", "");
  write_text(folder_ / "garden" / ".DS_Store", "");
  const Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.views.size(), 5u);
  EXPECT_EQ(scene.root.lexically_normal(), folder_ / "garden" / "garden");
  EXPECT_TRUE(any_contains(scene.report.notes, "the scene is in"));
  // Something else beside it: nobody knows what is meant.
  write_text(folder_ / "garden" / "readme.txt", "");
  EXPECT_TRUE(contains(load_error(folder_.path()), "no scene in this folder"));
}

// Its photos alone would be found from above, and colmap run although the cameras are there.
TEST_F(MovedCaptures, CamerasOfAWrappedCaptureAreNotPassedBy) {
  write_ring(folder_ / "fox");
  write_picture(folder_ / "fox" / "cover.png");
  EXPECT_EQ(load_scene(folder_.path()).views.size(), 5u);
}

TEST_F(MovedCaptures, WrappedPhotosAndRunsBesideThem) {
  write_picture(folder_ / "a" / "b" / "images" / "0.png");
  EXPECT_EQ(unwrapped(folder_.path(), {}), folder_ / "a" / "b");
  fs::create_directories(folder_ / "a" / "out");
  EXPECT_EQ(unwrapped(folder_.path(), {}), folder_.path());
  EXPECT_EQ(unwrapped(folder_.path(), folder_ / "a" / "out"), folder_ / "a" / "b");
  EXPECT_EQ(unwrapped(folder_ / "a" / "b", {}), folder_ / "a" / "b") << "images/ is no wrapping";
}

TEST_F(MovedCaptures, ModelsWhoseNamesBeginWithTheFolder) {
  TestModel model = ring_model(5);
  write_capture(model, folder_.path());
  for (TestImage& image : model.images) image.name = "images/" + image.name;
  write_binary(model, folder_ / "sparse" / "0");
  const Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.views.size(), 5u);
  EXPECT_TRUE(scene.report.ignored.empty()) << scene.report.ignored.front();
}

TEST_F(MovedCaptures, BackslashesInPaths) {
  write_ring(folder_.path(), "images\\\\");
  const Scene scene = load_scene(folder_.path());
  EXPECT_EQ(scene.views.size(), 5u);
  EXPECT_EQ(scene.views[0].name, "images/0.png");
}

TEST_F(MovedCaptures, PathsWithoutExtensionInAFileWithAMark) {
  write_ring(folder_.path(), "./images/", "");
  write_text(folder_ / "transforms.json", "\xEF\xBB\xBF" + text());
  EXPECT_EQ(load_scene(folder_.path()).views.size(), 5u);
}

TEST_F(MovedCaptures, MatricesOfThreeRows) {
  write_ring(folder_.path());
  write_text(folder_ / "transforms.json", replaced(text(), ",[0,0,0,1]]", "]"));
  const Scene scene = load_scene(folder_.path());
  ASSERT_EQ(scene.views.size(), 5u);
  EXPECT_LT(length(scene.views[1].pose.translation - ring_pose(1, 5).translation), 1e-5);
}

TEST_F(MovedCaptures, AnglesThatFramesSay) {
  write_ring(folder_.path());
  std::string json = replaced(text(), R"("fl_x":50,)", "");
  json = replaced(json, R"("file_path")", R"("camera_angle_x":0.8,"file_path")");
  write_text(folder_ / "transforms.json", json);
  const Scene scene = load_scene(folder_.path());
  EXPECT_NEAR(scene.cameras[static_cast<size_t>(scene.views[0].camera)].fx(), 20 / std::tan(0.4),
              1e-9);
}

// Two cameras of a rig number their photos alike.
TEST_F(MovedCaptures, MasksOfPhotosThatShareTheirNames) {
  const std::string json = transforms_text(4, "", "", R"("fl_x":50)");
  for (const bool named : {true, false}) {
    std::string text = json;
    for (int i = 0; i < 4; ++i) {
      const std::string name = fmt::format("{}/{}", i % 2 ? "front" : "back", i / 2);
      write_picture(folder_ / "images" / (name + ".png"));
      write_picture(folder_ / "masks" / (name + ".png"));
      std::string frame = fmt::format(R"("file_path":"images/{}.png")", name);
      if (named) frame += fmt::format(R"(,"mask_path":"masks/{}.png")", name);
      text = replaced(text, fmt::format(R"("file_path":"{}")", i), frame);
    }
    write_text(folder_ / "transforms.json", text);
    const Scene scene = load_scene(folder_.path());
    ASSERT_EQ(scene.views.size(), 4u);
    for (const View& view : scene.views)
      EXPECT_EQ(view.mask_path.lexically_relative(folder_ / "masks"),
                fs::path(view.name).lexically_relative("images"))
          << named;
  }
}

TEST_F(MovedCaptures, SmallCopiesOfPhotosAreNoPhotos) {
  for (const char* name : {"a.png", "b/c.png", ".thumbnails/a.png", "@eaDir/a.png/SYNO_THUMB.png",
                           "b/@eaDir/c.png", "._a.png"})
    write_picture(folder_ / name);
  EXPECT_EQ(capture_photo_names(folder_.path(), {}),
            (std::vector<std::string>{"a.png", "b/c.png"}));
}

}  // namespace
}  // namespace nerf::internal
