#include "io/colmap.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "nerf/base/file.h"
#include "support/temp_folder.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::string read_error(const TestModel& model) {
  TempFolder folder;
  write_binary(model, folder.path());
  return error_of([&] { read_colmap_model(folder.path()); });
}

std::string text_error(const std::string& file, const std::string& text) {
  TempFolder folder;
  write_colmap_text(ring_model(), folder.path());
  write_text(folder / file, text);
  return error_of([&] { read_colmap_model(folder.path()); });
}

void expect_same(const ColmapModel& a, const ColmapModel& b) {
  ASSERT_EQ(a.cameras.size(), b.cameras.size());
  for (size_t i = 0; i < a.cameras.size(); ++i) {
    EXPECT_EQ(a.cameras[i].model, b.cameras[i].model);
    EXPECT_EQ(a.cameras[i].width, b.cameras[i].width);
    EXPECT_EQ(a.cameras[i].height, b.cameras[i].height);
    EXPECT_EQ(a.cameras[i].params, b.cameras[i].params);
  }
  ASSERT_EQ(a.images.size(), b.images.size());
  for (size_t i = 0; i < a.images.size(); ++i) {
    EXPECT_EQ(a.images[i].name, b.images[i].name);
    EXPECT_EQ(a.images[i].camera, b.images[i].camera);
    EXPECT_EQ(a.images[i].pose.rotation.m, b.images[i].pose.rotation.m);
    EXPECT_EQ(a.images[i].pose.translation, b.images[i].pose.translation);
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (size_t i = 0; i < a.points.size(); ++i) {
    EXPECT_EQ(a.points[i].position, b.points[i].position);
    EXPECT_EQ(a.points[i].error, b.points[i].error);
    EXPECT_EQ(a.points[i].views, b.points[i].views);
  }
  ASSERT_EQ(a.observations.size(), b.observations.size());
  for (size_t i = 0; i < a.observations.size(); ++i) {
    EXPECT_EQ(a.observations[i].image, b.observations[i].image);
    EXPECT_EQ(a.observations[i].point, b.observations[i].point);
    if (std::isnan(a.keypoints[i].x))
      EXPECT_TRUE(std::isnan(b.keypoints[i].x));
    else
      EXPECT_EQ(a.keypoints[i], b.keypoints[i]);
  }
}

TEST(Colmap, ReadsABinaryModel) {
  TempFolder folder;
  write_binary(ring_model(4, 3), folder.path());
  const ColmapModel model = read_colmap_model(folder.path());
  EXPECT_EQ(model.format, "COLMAP binary");
  ASSERT_EQ(model.cameras.size(), 1u);
  EXPECT_EQ(model.cameras[0].model, CameraModel::kPinhole);
  EXPECT_EQ(model.cameras[0].width, 40);
  EXPECT_EQ(model.cameras[0].cy(), 15);
  ASSERT_EQ(model.images.size(), 4u);
  for (int i = 0; i < 4; ++i) {
    const Pose expected = ring_pose(i, 4), &read = model.images[static_cast<size_t>(i)].pose;
    EXPECT_LT(length(read.translation - expected.translation), 1e-12);
    for (int c = 0; c < 3; ++c) {
      EXPECT_LT(length(read.rotation.column(c) - expected.rotation.column(c)), 1e-12);
    }
  }
  ASSERT_EQ(model.points.size(), 3u);
  EXPECT_EQ(model.points[1].error, 0.5);
  EXPECT_EQ(model.points[1].views, 3);
  ASSERT_EQ(model.observations.size(), 9u);
  ASSERT_EQ(model.keypoints.size(), 9u);
  for (size_t i = 0; i < 9; ++i) {  // where the test's own pinhole sees the points
    const Observation& o = model.observations[i];
    const Vec3d d =
        ring_pose(o.image, 4).inverse() * model.points[static_cast<size_t>(o.point)].position;
    EXPECT_NEAR(model.keypoints[i].x, 50 * d.x / d.z + 20, 1e-12);
    EXPECT_NEAR(model.keypoints[i].y, 50 * d.y / d.z + 15, 1e-12);
  }
  EXPECT_TRUE(model.warnings.empty());
}

TEST(Colmap, TextGivesTheSameAsBinary) {
  TestModel model = ring_model(5, 4);
  model.cameras.push_back({9, 4, 64, 48, {60, 61, 32, 24, 0.01, -0.02, 0.001, 0.002}});
  model.images[2].camera = 9;
  model.images[1].points2d.clear();  // an empty second line
  model.images[4].points2d.clear();  // also at the end of the file
  model.points[2].track.clear();
  TempFolder folder;
  write_binary(model, folder / "bin");
  write_colmap_text(model, folder / "txt");
  const ColmapModel text = read_colmap_model(folder / "txt");
  EXPECT_EQ(text.format, "COLMAP text");
  EXPECT_TRUE(text.warnings.empty());
  expect_same(read_colmap_model(folder / "bin"), text);
}

TEST(Colmap, TextTakesWindowsLineEndsAndNamesWithSpaces) {
  TestModel model = ring_model();
  model.images[0].name = "day 1/my photo.png";
  TempFolder folder;
  write_colmap_text(model, folder.path());
  std::string text = read_text_file(folder / "images.txt"), windows;
  for (char c : text) windows += c == '\n' ? std::string("\r\n") : std::string(1, c);
  write_text(folder / "images.txt", windows);
  EXPECT_EQ(read_colmap_model(folder.path()).images[0].name, "day 1/my photo.png");
}

TEST(Colmap, RigsAndFramesDoNotChangeThePosesOfImages) {
  const TestModel model = ring_model();
  TempFolder folder;
  write_binary(model, folder / "old");
  write_binary(model, folder / "new");
  write_rigs_and_frames(model, folder / "new");
  const ColmapModel read = read_colmap_model(folder / "new");
  EXPECT_EQ(read.format, "COLMAP binary, with rigs and frames");
  expect_same(read_colmap_model(folder / "old"), read);
}

// COLMAP 4's model 17 says width and height once more.
TEST(Colmap, PanoramasAreTheWholeSphere) {
  TestModel model = ring_model();
  model.cameras[0] = {1, 17, 80, 40, {80, 40}};
  TempFolder folder;
  write_binary(model, folder / "bin");
  write_colmap_text(model, folder / "txt");
  for (const char* kind : {"bin", "txt"}) {
    const ColmapModel read = read_colmap_model(folder / kind);
    ASSERT_EQ(read.cameras.size(), 1u);
    EXPECT_EQ(read.cameras[0].model, CameraModel::kEquirectangular);
    EXPECT_EQ(read.cameras[0].params, panorama(80, 40).params);
  }
  model.cameras[0].height = 60;
  write_binary(model, folder / "bin");
  EXPECT_TRUE(contains(error_of([&] { read_colmap_model(folder / "bin"); }),
                       "camera 1 is EQUIRECTANGULAR of 80 x 60 pixels"));
}

TEST(Colmap, IdsMayHaveGapsAndAnyOrder) {
  TestModel model = ring_model(3, 2);
  model.cameras[0].id = 4000000000u;
  model.cameras.insert(model.cameras.begin(), {17, 0, 8, 6, {10, 4, 3}});
  model.images[0].id = 900;
  model.images[1].id = 3;
  model.images[2].id = 77;
  for (TestImage& image : model.images) image.camera = 4000000000u;
  model.points[0].track = {{77, 0}, {900, 0}, {5, 0}};  // 5 was taken out of the model
  model.points[1].track = {{3, 1}};
  TempFolder folder;
  write_binary(model, folder.path());
  const ColmapModel read = read_colmap_model(folder.path());
  EXPECT_EQ(read.images[0].camera, 1);
  EXPECT_EQ(read.points[0].views, 2);
  ASSERT_EQ(read.observations.size(), 3u);
  EXPECT_EQ(read.observations[0].image, 2);
  EXPECT_EQ(read.observations[1].image, 0);
  EXPECT_EQ(read.observations[2].image, 1);
  EXPECT_EQ(read.observations[2].point, 1);
}

TEST(Colmap, UnknownCameraModelIsNamedWithTheWayOut) {
  TestModel model = ring_model();
  model.cameras[0].model = 12;
  std::string error = read_error(model);
  EXPECT_TRUE(contains(error, "camera model id 12 (SIMPLE_DIVISION)"));
  EXPECT_TRUE(contains(error, "colmap image_undistorter"));
  EXPECT_TRUE(contains(error, "cameras.bin, byte 8"));
  model.cameras[0].model = -3;
  EXPECT_TRUE(contains(read_error(model), "camera model id -3 is not supported"));
  error = text_error("cameras.txt", "\n# x\n1 MEGA_LENS 40 30 50 50 20 15\n");
  EXPECT_TRUE(contains(error, "camera model MEGA_LENS is not supported"));
  EXPECT_TRUE(contains(error, "cameras.txt, line 3"));
  EXPECT_TRUE(contains(error, "colmap image_undistorter"));
}

TEST(Colmap, QuaternionsNearUnitAreNormalised) {
  TestModel model = ring_model();
  for (int k = 0; k < 4; ++k) model.images[0].pose[static_cast<size_t>(k)] *= 1.05;
  TempFolder folder;
  write_binary(model, folder.path());
  const Mat3d r = read_colmap_model(folder.path()).images[0].pose.rotation;
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(length(r.column(c)), 1, 1e-12);
  for (int k = 0; k < 4; ++k) model.images[0].pose[static_cast<size_t>(k)] *= 1.2;
  EXPECT_TRUE(contains(read_error(model), "rotation quaternion of length 1.26"));
}

TEST(Colmap, PosesThatAreNotFiniteLeaveTheirImagesOut) {
  for (size_t k = 0; k < 8; ++k) {
    TestModel model = ring_model();
    if (k < 7)
      model.images[1].pose[k] = kNan;
    else
      model.images[1].pose[5] = 1e30;
    TempFolder folder;
    write_binary(model, folder.path());
    const ColmapModel read = read_colmap_model(folder.path());
    ASSERT_EQ(read.images.size(), 3u) << k;
    EXPECT_EQ(read.images[1].name, "02.png");
    EXPECT_TRUE(any_contains(read.warnings, "1 of 4 images are left out")) << k;
    EXPECT_TRUE(any_contains(read.warnings, ": 01.png")) << k;
    // The points that it saw are seen by the others alone.
    EXPECT_EQ(read.points[0].views, 2) << k;
  }
  TestModel model = ring_model(1, 0);
  model.images[0].pose[0] = kNan;
  EXPECT_TRUE(contains(read_error(model), "image 1 (00.png) has a pose that is not finite"));
  model = ring_model();
  model.images[1].pose = {0, 0, 0, 0, 1, 2, 3};
  EXPECT_TRUE(contains(read_error(model), "rotation quaternion of length 0"));
}

TEST(Colmap, CamerasWithAbsurdNumbersAreErrors) {
  const auto with = [](uint64_t width, uint64_t height, double focal) {
    TestModel model = ring_model();
    model.cameras[0].width = width;
    model.cameras[0].height = height;
    model.cameras[0].params[0] = focal;
    return read_error(model);
  };
  EXPECT_EQ(with(40, 30, 50), "");
  EXPECT_TRUE(contains(with(0, 30, 50), "camera 1 says 0 x 30 pixels"));
  EXPECT_TRUE(contains(with(40, 0, 50), "40 x 0 pixels"));
  EXPECT_TRUE(contains(with(65537, 30, 50), "65537 x 30 pixels"));
  EXPECT_TRUE(contains(with(uint64_t{1} << 40, 30, 50), "1099511627776 x 30 pixels"));
  EXPECT_TRUE(contains(with((uint64_t{1} << 32) + 40, 30, 50), "4294967336 x 30 pixels"));
  EXPECT_TRUE(contains(with(65536, 65536, 50), "65536 x 65536 pixels"));
  EXPECT_TRUE(contains(with(40, 30, 0), "focal length that is not positive"));
  EXPECT_TRUE(contains(with(40, 30, -50), "focal length that is not positive"));
  EXPECT_TRUE(contains(with(40, 30, kNan), "parameter that is not finite"));
}

TEST(Colmap, ContradictionsAreErrors) {
  TestModel model = ring_model();
  model.images[2].camera = 5;
  EXPECT_TRUE(contains(read_error(model), "image 3 (02.png) refers to camera 5"));
  model = ring_model();
  model.images[2].id = 1;
  EXPECT_TRUE(contains(read_error(model), "image id 1 appears twice"));
  model = ring_model();
  model.images[2].name = "00.png";
  EXPECT_TRUE(contains(read_error(model), "its name appears twice"));
  model = ring_model();
  model.images[2].name = "";
  EXPECT_TRUE(contains(read_error(model), "image 3 has no name"));
  model = ring_model();
  model.cameras.push_back(model.cameras[0]);
  EXPECT_TRUE(contains(read_error(model), "camera id 1 appears twice"));
}

TEST(Colmap, PointsThatAreNotFiniteAreLeftOutWithAWarning) {
  TestModel model = ring_model(4, 5);
  model.points[1].position.y = kNan;
  model.points[3].position.x = std::numeric_limits<double>::infinity();
  model.points[4].error = -1;  // COLMAP's "no error known"
  TempFolder folder;
  write_binary(model, folder.path());
  const ColmapModel read = read_colmap_model(folder.path());
  ASSERT_EQ(read.points.size(), 3u);
  EXPECT_EQ(read.points[2].error, 0);
  EXPECT_EQ(read.observations.size(), 9u);
  ASSERT_EQ(read.warnings.size(), 1u);
  EXPECT_TRUE(contains(read.warnings[0], "2 points"));
}

TEST(Colmap, MissingFilesAreNamed) {
  TempFolder folder;
  write_binary(ring_model(), folder.path());
  std::filesystem::remove(folder / "points3D.bin");
  const ColmapModel model = read_colmap_model(folder.path());
  EXPECT_TRUE(model.points.empty());
  ASSERT_EQ(model.warnings.size(), 1u);
  EXPECT_TRUE(contains(model.warnings[0], "points3D.bin is missing"));
  std::filesystem::remove(folder / "images.bin");
  EXPECT_TRUE(contains(error_of([&] { read_colmap_model(folder.path()); }), "no images.bin"));
}

TEST(Colmap, CountsWithoutRoomForThemAreErrorsWithTheirPlace) {
  TempFolder folder;
  write_binary(ring_model(), folder.path());
  const auto damaged = [&](const std::string& file, size_t at, uint64_t count) {
    const auto good = read_file(folder / file);
    std::vector<char> bad(good.begin(), good.end());
    std::memcpy(bad.data() + at, &count, 8);
    write_bytes(folder / file, bad);
    const std::string error = error_of([&] { read_colmap_model(folder.path()); });
    write_bytes(folder / file, {good.begin(), good.end()});
    return error;
  };
  for (const char* file : {"cameras.bin", "images.bin", "points3D.bin"}) {
    for (uint64_t count : {uint64_t{5} << 20, uint64_t{1} << 40, ~uint64_t{0}}) {
      const std::string error = damaged(file, 0, count);
      EXPECT_TRUE(contains(error, std::string(file) + ", byte 0: the number of"));
      EXPECT_TRUE(contains(error, std::to_string(count)));
    }
    EXPECT_TRUE(contains(damaged(file, 0, 0), file));  // bytes are left over
  }
  // 2D points of the first image: 8 + 4 + 56 + 4 + "00.png\0".
  EXPECT_TRUE(contains(damaged("images.bin", 79, uint64_t{1} << 61), "byte 79"));
  // Track of the first point: 8 + 8 + 24 + 3 + 8.
  EXPECT_TRUE(contains(damaged("points3D.bin", 51, uint64_t{1} << 61), "byte 51"));
}

TEST(Colmap, TextWithWrongCountsIsAnErrorWithItsLine) {
  EXPECT_TRUE(contains(text_error("cameras.txt", "1 PINHOLE 40 30 50 50 20\n"),
                       "cameras.txt, line 1: the line ends where a camera parameter"));
  EXPECT_TRUE(contains(text_error("cameras.txt", "1 PINHOLE 40 30 50 50 20 15 0.1\n"),
                       "PINHOLE has 4 parameters, the line has more"));
  EXPECT_TRUE(contains(text_error("cameras.txt", "1 PINHOLE 40 30 50 fifty 20 15\n"),
                       "\"fifty\" is not a camera parameter"));
  EXPECT_TRUE(contains(text_error("cameras.txt", "1 PINHOLE -40 30 50 50 20 15\n"),
                       "\"-40\" is not an image width"));
  EXPECT_TRUE(contains(text_error("images.txt", "1 1 0 0 0 0 0 0 1 a.png\n1 2 -1 3 4\n"),
                       "images.txt, line 2: 5 values of 2D points"));
  EXPECT_TRUE(contains(text_error("images.txt", "# c\n1 1 0 0 0 0 0 0 1\n\n"),
                       "images.txt, line 2: the line ends where an image name"));
  // Without its second line the next image is taken for 2D points.
  EXPECT_TRUE(
      contains(text_error("images.txt", "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 1 0 0 1 b.png\n"),
               "not a multiple of 3"));
  EXPECT_TRUE(contains(text_error("images.txt", "1 1 0 0 0 0 0 0 1 a.png\n2 3 -1 4 b 7\n"),
                       "images.txt, line 2: \"b\" is not a 2D point's y"));
  EXPECT_TRUE(contains(text_error("points3D.txt", "1 0 0 0 9 9 9 0.5 1\n"),
                       "points3D.txt, line 1: the line ends where a 2D point index"));
  EXPECT_TRUE(contains(text_error("points3D.txt", "1 0 0 1e999 9 9 9 0.5\n"), "1e999"));
}

TEST(Colmap, TextShorterThanItsHeaderSaysIsWarnedOf) {
  TempFolder folder;
  write_colmap_text(ring_model(4, 6), folder.path());
  const std::string text = read_text_file(folder / "points3D.txt");
  const size_t last_line = text.rfind('\n', text.size() - 2);
  write_text(folder / "points3D.txt", text.substr(0, last_line + 1));
  const ColmapModel model = read_colmap_model(folder.path());
  ASSERT_EQ(model.warnings.size(), 1u);
  EXPECT_TRUE(contains(model.warnings[0], "announces 6 records and has 5"));
}

TEST(Colmap, CleanImageNames) {
  EXPECT_EQ(clean_image_name("a/b.png"), "a/b.png");
  EXPECT_EQ(clean_image_name("./a//b.png"), "a/b.png");
  EXPECT_EQ(clean_image_name("../../etc/x.png"), "etc/x.png");
  EXPECT_EQ(clean_image_name("/abs/x.png"), "abs/x.png");
  EXPECT_EQ(clean_image_name("cam\\1.png"), "cam/1.png");
  EXPECT_EQ(clean_image_name(".."), "");
  EXPECT_EQ(printable(std::string("a\x1b[31m\n")), "a\\x1b[31m\\x0a");
}

}  // namespace
}  // namespace nerf::internal
