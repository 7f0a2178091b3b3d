// Captures as other tools lay them out, and as they look after being moved and converted.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <limits>

#include "io/image_lookup.h"
#include "nerf/io/scene.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;
namespace fs = std::filesystem;
using How = FoundImage::How;

class ImageLookup : public ::testing::Test {
 protected:
  FoundImage find(const std::string& name) { return find_images(folder_.path(), {name})[0]; }
  TempFolder folder_;
};

TEST_F(ImageLookup, TheLongestTailThatExists) {
  for (const char* name : {"images/a.jpg", "a.jpg", "deep/images/a.jpg"})
    write_text(folder_ / name, "");
  EXPECT_EQ(find("C:\\Users\\me\\spoon\\images\\a.jpg").path, folder_ / "images/a.jpg");
  EXPECT_EQ(find("C:\\Users\\me\\spoon\\images\\a.jpg").name, "images/a.jpg");
  EXPECT_EQ(find("/elsewhere/deep/images/a.jpg").path, folder_ / "deep/images/a.jpg");
  EXPECT_EQ(find("D:/a.jpg").path, folder_ / "a.jpg");
  EXPECT_EQ(find("..\\photos\\a").path, folder_ / "a.jpg");
  EXPECT_EQ(find("images/a.jpg").how, How::kAsNamed);
  EXPECT_EQ(find("/x/images/a.jpg").how, How::kByTail);
  EXPECT_TRUE(find("/x/b.jpg").path.empty());
  EXPECT_EQ(find("C:\\x\\b.jpg").name, "x/b.jpg");
  EXPECT_TRUE(find("").path.empty());
  EXPECT_TRUE(find("C:\\").path.empty());
  EXPECT_TRUE(find("../..").path.empty());
}

TEST_F(ImageLookup, AnotherExtensionWhereOnlyOneFileFits) {
  for (const char* name : {"images/a.png", "images/b.PNG", "images/B.jpg", "images/C.JPG",
                           "images/shot.v2.png", "images/d.txt"})
    write_text(folder_ / name, "");
  EXPECT_EQ(find("images/a.jpeg").path, folder_ / "images/a.png");
  EXPECT_EQ(find("images/a.jpeg").how, How::kByStem);
  EXPECT_TRUE(find("images/b.jpeg").path.empty());  // two fit
  EXPECT_EQ(find("images/c.jpg").path, folder_ / "images/C.JPG");
  EXPECT_EQ(find("images/shot.v2.jpg").path, folder_ / "images/shot.v2.png");
  EXPECT_TRUE(find("images/d.jpg").path.empty());  // a text is no image
}

TEST_F(ImageLookup, AFileThatTwoNamesLeadToIsNeither) {
  write_text(folder_ / "a.jpg", "");
  std::vector<std::string> notes;
  auto found = find_images(folder_.path(), {"left/a.jpg", "right/a.jpg"}, &notes);
  EXPECT_TRUE(found[0].path.empty() && found[1].path.empty());
  EXPECT_EQ(found[0].name, "left/a.jpg");
  EXPECT_TRUE(notes.empty());
  found = find_images(folder_.path(), {"left/a.jpg", "a.jpg", "a.png"}, &notes);
  EXPECT_TRUE(found[0].path.empty() && found[2].path.empty());
  EXPECT_EQ(found[1].path, folder_ / "a.jpg");
  // The same name twice is one name.
  found = find_images(folder_.path(), {"/x/a.jpg", "/x/a.jpg"}, &notes);
  EXPECT_FALSE(found[0].path.empty());
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_TRUE(contains(notes[0], "2 images found by the end of a path"));
  EXPECT_TRUE(contains(notes[0], "/x/a.jpg is a.jpg"));
}

TEST_F(ImageLookup, NamesThatDifferInCaseOnlyStayApart) {
  for (const char* name : {"a.png", "A.png"}) write_text(folder_ / name, "");
  const auto found = find_images(folder_.path(), {"a.png", "A.png"});
  EXPECT_EQ(found[0].path, folder_ / "a.png");
  EXPECT_EQ(found[1].path, folder_ / "A.png");
  EXPECT_TRUE(find("a.jpg").path.empty());
}

// Pictures 0.png, ... of transforms_text().
void write_pictures(const fs::path& folder, int n) {
  for (int i = 0; i < n; ++i) write_picture(folder / fmt::format("{}.png", i));
}

TEST(Layouts, AbsolutePathsOfAnotherComputer) {
  for (const char* place : {"images", "."}) {
    TempFolder folder;
    write_pictures(folder / place, 5);
    const std::string below = std::string(place) == "." ? "" : "images\\\\";
    write_text(
        folder / "transforms.json",
        transforms_text(5, "C:\\\\Users\\\\me\\\\spoon\\\\" + below, ".png", R"("fl_x":50)"));
    const Scene scene = load_scene(folder.path());
    EXPECT_EQ(scene.views.size(), 5u);
    EXPECT_EQ(scene.views[0].name, below.empty() ? "0.png" : "images/0.png");
    EXPECT_TRUE(any_contains(scene.report.notes, "5 images found by the end of a path"));
  }
}

TEST(Layouts, FramesThatAllMissNameTheFile) {
  TempFolder folder;
  write_text(folder / "transforms.json",
             transforms_text(5, "C:\\\\photos\\\\", ".png", R"("fl_x":50)"));
  const std::string error = load_error(folder.path());
  EXPECT_TRUE(contains(error, "transforms.json: 5 of 5 registered images are missing"));
  EXPECT_TRUE(contains(error, "photos/0.png"));
}

TEST(Layouts, AColmapModelOfAnotherComputer) {
  TestModel model = ring_model(5);
  TempFolder folder;
  for (TestImage& image : model.images) {
    write_picture(folder / "images" / image.name);
    image.name = "D:\\job\\" + image.name;
  }
  write_binary(model, folder / "sparse" / "0");
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.views.size(), 5u);
  EXPECT_EQ(scene.views[0].name, "00.png");
  EXPECT_EQ(scene.report.images_total, 5);
  EXPECT_TRUE(any_contains(scene.report.notes, "5 images found by the end of a path"));
}

TEST(Layouts, ConvertedPhotosAreMatchedByTheirStem) {
  TestModel model = ring_model(5);
  TempFolder folder;
  for (TestImage& image : model.images) {
    write_picture(folder / "images" / image.name);
    image.name.replace(2, 4, ".jpeg");
  }
  write_binary(model, folder / "sparse" / "0");
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.views.size(), 5u);
  EXPECT_EQ(scene.report.images_total, 5);
  EXPECT_TRUE(any_contains(scene.report.notes, "5 images found under another extension"));
  EXPECT_TRUE(any_contains(scene.report.notes, "00.jpeg is 00.png"));
}

TEST(Layouts, WhereOtherToolsPutModelsAndImages) {
  const TestModel model = ring_model(5);
  const std::vector<std::pair<const char*, const char*>> layouts{
      {"distorted/sparse/0", "input"},
      {"sparse/0", "input"},
      {"dense/sparse", "dense/images"},
      {"colmap/dense/0/sparse", "images"},
      {"colmap", "images"},
      {"colmap/0", "images"},
      {"undistorted/sparse", "undistorted/images"},
      {"sparse/0", "rgb"},
      {"colmap/sparse/0", "colmap/images"}};
  for (const auto& [place, images] : layouts) {
    TempFolder folder;
    write_binary(model, folder / place);
    for (const TestImage& image : model.images) write_picture(folder / images / image.name);
    EXPECT_EQ(load_scene(folder.path()).views.size(), 5u) << place << " " << images;
  }
  // The path of the model itself.
  for (const char* place : {"sparse/0", "sparse"}) {
    TempFolder folder;
    write_binary(model, folder / place);
    for (const TestImage& image : model.images) write_picture(folder / "images" / image.name);
    EXPECT_EQ(load_scene(folder / place).views.size(), 5u) << place;
  }
}

TEST(Layouts, UndistortedPhotosGoWithTheirModel) {
  TempFolder folder;
  write_capture(ring_model(5), folder.path());
  // What the converter ran on: more photos, of another size.
  TestModel distorted = ring_model(6);
  distorted.cameras[0] = {1, 2, 80, 60, {90, 40, 30, 0.01}};
  write_binary(distorted, folder / "distorted" / "sparse" / "0");
  for (const TestImage& image : distorted.images)
    write_picture(folder / "input" / image.name, 80, 60);
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.views.size(), 5u);
  EXPECT_EQ(scene.views[0].image_path, folder / "images" / "00.png");
  EXPECT_TRUE(any_contains(scene.report.ignored, "distorted/sparse/0 (6 images; sparse/0 is read"));
}

// The ring with +y up, as ARKit has it: y and z of the world change places.
Pose phone_pose(int i, int n) {
  const Pose ring = ring_pose(i, n);
  const Vec3d p = ring.translation;
  return look_at({p.x, p.z, -p.y}, {0, 0, 0}, {0, 1, 0});
}

void expect_ring(const Scene& scene, int n) {
  ASSERT_EQ(scene.views.size(), static_cast<size_t>(n));
  EXPECT_NEAR(scene.report.up.y, 1, 1e-9);
  for (int i = 0; i < n; ++i) {
    const Pose& pose = scene.views[static_cast<size_t>(i)].pose;
    const Pose expected = phone_pose(i, n);
    EXPECT_LT(length(pose.translation - expected.translation), 1e-9);
    EXPECT_LT(length(pose.rotation.column(2) - expected.rotation.column(2)), 1e-9);
    EXPECT_LT(length(pose.rotation.column(1) - expected.rotation.column(1)), 1e-9);
  }
}

TEST(Layouts, PolycamsRawData) {
  TempFolder folder;
  for (int i = 0; i < 6; ++i) {
    const Pose p = phone_pose(i, 6);
    std::string text = R"({"fx":50,"fy":51,"cx":20,"cy":15,"width":40,"height":30)";
    for (size_t r = 0; r < 3; ++r) {
      const double row[] = {p.rotation.m[r][0], -p.rotation.m[r][1], -p.rotation.m[r][2],
                            p.translation[static_cast<int>(r)]};
      for (int c = 0; c < 4; ++c) text += fmt::format(",\"t_{}{}\":{}", r, c, row[c]);
    }
    write_picture(folder / "keyframes" / "images" / fmt::format("10{}.jpg", i));
    write_text(folder / "keyframes" / "cameras" / fmt::format("10{}.json", i), text + "}");
  }
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.report.format, "Polycam raw data");
  EXPECT_EQ(scene.views[0].name, "keyframes/images/100.jpg");
  EXPECT_EQ(scene.cameras[0].fy(), 51);
  expect_ring(scene, 6);
  write_text(folder / "keyframes" / "cameras" / "103.json", R"({"fx":50})");
  EXPECT_TRUE(contains(load_error(folder.path()), "103.json: there is no \"t_00\""));
}

TEST(Layouts, Record3DsExport) {
  TempFolder folder;
  std::vector<std::string> poses;
  for (int i = 0; i < 12; ++i) {
    Pose p = phone_pose(i, 12);
    for (int c : {1, 2}) p.rotation.set_column(c, -p.rotation.column(c));  // OpenGL's axes
    const auto q = colmap_pose(p.inverse());  // w x y z of camera-to-world
    poses.push_back(fmt::format("[{},{},{},{},{},{},{}]", q[1], q[2], q[3], q[0], p.translation.x,
                                p.translation.y, p.translation.z));
    write_picture(folder / "rgb" / fmt::format("{}.jpg", i));
  }
  write_text(folder / "metadata.json",
             fmt::format(R"({{"w":40,"h":30,"K":[50,0,0,0,51,0,20,15,1],"fps":60,"poses":[{}]}})",
                         fmt::join(poses, ",")));
  Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.report.format, "Record3D");
  EXPECT_EQ(scene.cameras[0].cy(), 15);
  // Views are sorted bytewise: 0, 1, 10, 11, 2.
  std::stable_sort(scene.views.begin(), scene.views.end(),
                   [](const View& a, const View& b) { return a.name.size() < b.name.size(); });
  expect_ring(scene, 12);
  fs::remove(folder / "rgb" / "3.jpg");
  EXPECT_TRUE(contains(load_error(folder.path()), "has 12 poses, but rgb/ holds 11 images"));
}

TEST(Layouts, FewPlacedPhotosAreALoudWarning) {
  TempFolder folder;
  write_capture(ring_model(4), folder.path());
  for (int i = 10; i < 16; ++i) write_picture(folder / "images" / fmt::format("{}.png", i));
  const Scene scene = load_scene(folder.path());
  ASSERT_FALSE(scene.report.warnings.empty());
  EXPECT_TRUE(contains(scene.report.warnings[0], "ONLY 4 OF 10 PHOTOS"));
  fs::remove(folder / "images" / "10.png");
  fs::remove(folder / "images" / "11.png");
  EXPECT_FALSE(any_contains(load_scene(folder.path()).report.warnings, "ONLY"));  // half
}

TEST(Layouts, ExtentOfProjectedCoordinatesCanBePasted) {
  TestModel model = ring_model(8);
  for (size_t i = 0; i < 8; ++i) {
    Pose pose = ring_pose(static_cast<int>(i), 8);
    pose.translation = pose.translation + Vec3d{454321.125, 5412345.5, 200};
    model.images[i].pose = colmap_pose(pose);
  }
  model.points.clear();
  TempFolder folder;
  write_capture(model, folder.path());
  const std::string text = format_report(load_scene(folder.path()).report);
  EXPECT_TRUE(contains(text,
                       "extent        454317.125,5412341.500,201.000,454325.125,5412349.500,"
                       "201.000"));
}

TEST(Layouts, CamerasThatAreNoneLeaveTheirPhotosOut) {
  for (const bool binary : {false, true}) {
    TestModel model = ring_model(6);
    const double nan = std::nan("");
    model.cameras.push_back({2, 1, 40, 30, {nan, nan, nan, nan}});
    model.cameras.push_back({3, 1, 40, 30, {0, 0, 20, 15}});
    model.images[1].camera = 2;
    model.images[4].camera = 3;
    model.images[2].pose[4] = std::numeric_limits<double>::infinity();
    TempFolder folder;
    write_capture(model, folder.path());
    if (!binary) {
      fs::remove_all(folder / "sparse" / "0");
      write_colmap_text(model, folder / "sparse" / "0");
      // As another compiler's library prints it.
      std::ifstream in(folder / "sparse" / "0" / "cameras.txt");
      std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
      const size_t at = text.find("nan nan nan nan");
      ASSERT_NE(at, text.npos);
      write_text(folder / "sparse" / "0" / "cameras.txt",
                 text.replace(at, 15, "-nan(ind) -1.#IND 1.#QNAN inf"));
    }
    const Scene scene = load_scene(folder.path());
    EXPECT_EQ(scene.views.size(), 3u);
    EXPECT_TRUE(any_contains(scene.report.warnings, "3 of 6 images are left out"));
    EXPECT_TRUE(any_contains(scene.report.warnings, "01.png, 02.png, 04.png"));
  }
}

TEST(Layouts, WhereNoCameraIsOneTheFirstFaultIsSaid) {
  TestModel model = ring_model(3);
  model.cameras[0].params[0] = std::nan("");
  TempFolder folder;
  write_capture(model, folder.path());
  EXPECT_TRUE(contains(load_error(folder.path()), "camera 1 has a parameter that is not finite"));
}

}  // namespace
}  // namespace nerf::internal
