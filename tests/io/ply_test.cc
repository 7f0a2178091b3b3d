#include "io/ply.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "nerf/io/scene.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

constexpr const char* kHeader =
    "ply\nformat {} 1.0\ncomment made by hand\nelement vertex {}\nproperty float x\n"
    "property float y\nproperty double z\nproperty uchar red\nend_header\n";

class Ply : public ::testing::Test {
 protected:
  PlyPoints read(const std::string& bytes, size_t most = 500000) {
    write_bytes(folder_ / "a.ply", {bytes.begin(), bytes.end()});
    return read_ply_points(folder_ / "a.ply", most);
  }
  std::string error(const std::string& bytes) {
    return error_of([&] { read(bytes); });
  }
  TempFolder folder_;
};

template <class T>
std::string stored(T value, bool big) {
  std::string bytes(reinterpret_cast<const char*>(&value), sizeof(T));
  if (big) std::reverse(bytes.begin(), bytes.end());
  return bytes;
}

std::string binary(int count, bool big) {
  std::string body;
  for (int i = 0; i < count; ++i) {
    body += stored(static_cast<float>(i), big) + stored(-0.5f, big) + stored(1000000.25 + i, big) +
            stored(uint8_t{200}, big);
  }
  return body;
}

TEST_F(Ply, EveryEncoding) {
  for (const char* format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
    std::string text = fmt::format(fmt::runtime(kHeader), format, 3);
    const bool is_text = std::string(format) == "ascii";
    text += is_text ? "0 -0.5 1000000.25 200\r\n1 -5e-1 1000001.25 200\n+2 -.5 1000002.25 200\n"
                    : binary(3, std::string(format) == "binary_big_endian");
    const PlyPoints points = read(text);
    ASSERT_EQ(points.positions.size(), 3u) << format;
    EXPECT_EQ(points.positions[2].x, 2);
    EXPECT_EQ(points.positions[2].y, -0.5);
    EXPECT_EQ(points.positions[2].z, 1000002.25);
    EXPECT_FALSE(points.splats);
  }
}

TEST_F(Ply, OtherElementsAndListsAreSkipped) {
  const std::string header =
      "ply\nformat {} 1.0\nelement face 2\nproperty list uchar int vertex_indices\n"
      "element camera 1\nproperty float f\nelement vertex 1\nproperty list uchar float extra\n"
      "property int x\nproperty short y\nproperty uint z\nelement edge 7\nproperty int a\n"
      "end_header\n";
  PlyPoints points =
      read(fmt::format(fmt::runtime(header), "ascii") + "3 0 1 2\n0\n35.0\n2 9 9 -4 5 6\n");
  ASSERT_EQ(points.positions.size(), 1u);
  EXPECT_EQ(points.positions[0].x, -4);
  const std::string body =
      stored(uint8_t{1}, true) + stored(int32_t{8}, true) + stored(uint8_t{0}, true) +
      stored(35.0f, true) + stored(uint8_t{2}, true) + stored(9.0f, true) + stored(9.0f, true) +
      stored(int32_t{-4}, true) + stored(int16_t{-5}, true) + stored(uint32_t{4000000000u}, true);
  points = read(fmt::format(fmt::runtime(header), "binary_big_endian") + body);
  ASSERT_EQ(points.positions.size(), 1u);
  EXPECT_EQ(points.positions[0].x, -4);
  EXPECT_EQ(points.positions[0].y, -5);
  EXPECT_EQ(points.positions[0].z, 4e9);
}

TEST_F(Ply, ManyVerticesAreThinnedOutAndBadOnesLeftOut) {
  const std::string text = fmt::format(fmt::runtime(kHeader), "binary_little_endian", 1000);
  const PlyPoints points = read(text + binary(1000, false), 100);
  EXPECT_EQ(points.vertices, 1000u);
  ASSERT_EQ(points.positions.size(), 100u);
  EXPECT_EQ(points.positions[99].x, 990);
  EXPECT_EQ(
      read(fmt::format(fmt::runtime(kHeader), "ascii", 3) + "nan 0 0 0\n0 inf 0 0\n1 2 1e30 0\n")
          .positions.size(),
      0u);
}

TEST_F(Ply, HeadersThatLie) {
  EXPECT_TRUE(contains(error("no ply"), "a.ply"));
  EXPECT_TRUE(contains(error(""), "header has no end"));
  EXPECT_TRUE(contains(error("ply\nformat ascii 1.0\n"), "header line 3: the header has no end"));
  EXPECT_TRUE(contains(error("ply\n" + std::string(100000, 'x')), "the line is too long"));
  EXPECT_TRUE(contains(error("ply\nformat morse 1.0\nend_header\n"), "unknown format morse"));
  EXPECT_TRUE(contains(error("ply\nelement vertex 0\nend_header\n"), "there is no format"));
  EXPECT_TRUE(contains(error("ply\nformat ascii 1.0\nelement vertex\n"), "without a count"));
  EXPECT_TRUE(contains(error("ply\nformat ascii 1.0\nelement vertex -3\n"), "a.ply"));
  EXPECT_TRUE(contains(error("ply\nformat ascii 1.0\nproperty float x\n"), "before any element"));
  EXPECT_TRUE(contains(error("ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\n"),
                       "unknown type"));
  EXPECT_TRUE(
      contains(error("ply\nformat ascii 1.0\nelement face 0\nend_header\n"), "no vertices"));
  EXPECT_TRUE(
      contains(error("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                     "end_header\n0 0\n"),
               "have no z"));
  // More than the file can hold: told before anything is made of it.
  for (const char* format : {"ascii", "binary_little_endian"}) {
    for (const char* count : {"4", "4000000000", "18446744073709551615"}) {
      EXPECT_TRUE(contains(error(fmt::format(fmt::runtime(kHeader), format, count) + "0 0 0 0\n"),
                           "the file ends inside vertex"))
          << format << " " << count;
    }
  }
  EXPECT_TRUE(contains(error(fmt::format(fmt::runtime(kHeader), "ascii", 1) + "0 0 zero 0\n"),
                       "\"zero\" is no number"));
  EXPECT_TRUE(contains(
      error("ply\nformat binary_little_endian 1.0\nelement face 1\nproperty list uint uchar a\n"
            "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
            "end_header\n\xff\xff\xff\xff"),
      "the file ends inside face 0"));
}

TEST_F(Ply, EveryPrefixIsAnErrorOrFewerPoints) {
  const std::string whole =
      fmt::format(fmt::runtime(kHeader), "binary_little_endian", 5) + binary(5, false);
  for (size_t size = 0; size < whole.size(); ++size)
    EXPECT_NE(error(whole.substr(0, size)), "") << size;
  EXPECT_EQ(error(whole), "");
}

TEST(PointCloud, BesideACaptureWithoutPoints) {
  const auto cloud = [](const Vec3d& centre) {
    std::string text = fmt::format(fmt::runtime(kHeader), "ascii", 300);
    for (const TestPoint& p : ring_model(4, 300).points)
      text += fmt::format("{} {} {} 9\n", centre.x + p.position.x, centre.y + p.position.y,
                          centre.z + p.position.z);
    return text;
  };
  TempFolder folder;
  for (int i = 0; i < 12; ++i) write_picture(folder / fmt::format("{}.png", i));
  const auto write = [&](const char* head) {
    write_text(folder / "transforms.json", transforms_text(12, "", ".png", head));
  };
  write(R"("fl_x":50)");
  Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.report.points, 0);
  EXPECT_TRUE(any_contains(scene.report.warnings, "there are no 3D points"));

  write_text(folder / "lidar.ply", cloud({0, 0, 0}));
  scene = load_scene(folder.path());
  EXPECT_EQ(scene.report.points, 300);
  EXPECT_TRUE(any_contains(scene.report.notes, "points of lidar.ply"));
  EXPECT_FALSE(any_contains(scene.report.warnings, "there are no 3D points"));
  // Points in a ball of radius 1, cameras sqrt(17) from its middle.
  EXPECT_GT(scene.report.near, 0.4 * (std::sqrt(17.0) - 1));
  EXPECT_LT(scene.report.near, std::sqrt(17.0) - 1);
  EXPECT_GE(scene.report.far, std::sqrt(17.0) + 0.9);

  // In other coordinates, and broken.
  write_text(folder / "lidar.ply", cloud({5000, 0, 0}));
  scene = load_scene(folder.path());
  EXPECT_EQ(scene.report.points, 0);
  EXPECT_TRUE(any_contains(scene.report.warnings, "lidar.ply is not used"));
  write_text(folder / "lidar.ply", "ply\n");
  EXPECT_TRUE(any_contains(load_scene(folder.path()).report.warnings, "lidar.ply is not used"));

  write(R"("fl_x":50,"ply_file_path":"sub\\sparse_pc.ply")");
  EXPECT_TRUE(any_contains(load_scene(folder.path()).report.warnings, "does not exist"));
  write_text(folder / "sub" / "sparse_pc.ply", cloud({0, 0, 0}));
  scene = load_scene(folder.path());
  EXPECT_EQ(scene.report.points, 300);
  EXPECT_TRUE(any_contains(scene.report.ignored, "lidar.ply (there are points already)"));
}

TEST(PointCloud, OfGaussianSplattingsConverter) {
  TempFolder folder;
  TestModel model = ring_model(5, 0);
  write_capture(model, folder.path());
  write_text(folder / "sparse" / "0" / "points3D.ply",
             fmt::format(fmt::runtime(kHeader), "ascii", 2) + "0 0 0 1\n0.5 0 0 1\n");
  EXPECT_EQ(load_scene(folder.path()).report.points, 2);
}

}  // namespace
}  // namespace nerf::internal
