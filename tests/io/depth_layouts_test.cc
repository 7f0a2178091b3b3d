// Depth maps where phones' applications put them.
#include <gtest/gtest.h>

#include <cmath>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "test_images.h"
#include "test_scenes.h"

namespace nerf {
namespace {

using namespace nerf::test;
namespace fs = std::filesystem;

constexpr int kViews = 4;

void write_millimetres(const fs::path& path, int depth) {
  fs::create_directories(path.parent_path());
  make_image(path, {8, 6, 1, OIIO::TypeDesc::UINT16, {}},
             [&](int, int, int) { return static_cast<float>(depth) / 65535; });
}

// Of each view: the depth of its first pixel, input units.
std::vector<double> first_depths(const Scene& scene) {
  ThreadPool pool(1);
  std::vector<double> out;
  for (const Photo& photo : load_photos(scene, pool).photos)
    out.push_back(photo.depth.empty() ? -1 : photo.depth.pixel(0, 0) / scene.to_engine.scale);
  return out;
}

TEST(DepthLayouts, PolycamsDepthAndConfidence) {
  TempFolder folder;
  const fs::path keyframes = folder / "keyframes";
  for (int i = 0; i < kViews; ++i) {
    const Pose p = ring_pose(i, kViews);
    std::string text = R"({"fx":50,"fy":51,"cx":20,"cy":15,"width":40,"height":30)";
    for (size_t r = 0; r < 3; ++r) {
      const double row[] = {p.rotation.m[r][0], -p.rotation.m[r][1], -p.rotation.m[r][2],
                            p.translation[static_cast<int>(r)]};
      for (int c = 0; c < 4; ++c) text += fmt::format(",\"t_{}{}\":{}", r, c, row[c]);
    }
    write_picture(keyframes / "corrected_images" / fmt::format("{}.jpg", i));
    write_text(keyframes / "corrected_cameras" / fmt::format("{}.json", i), text + "}");
  }
  write_millimetres(keyframes / "depth" / "0.png", 1250);
  write_millimetres(keyframes / "depth" / "1.png", 5100);  // beyond what LiDAR reaches
  write_millimetres(keyframes / "depth" / "2.png", 2000);
  fs::create_directories(keyframes / "confidence");
  Image8 confidence{8, 6, 1, std::vector<uint8_t>(48, 54)};
  write_image(keyframes / "confidence" / "0.png", confidence);
  confidence.pixels[0] = 0;
  write_image(keyframes / "confidence" / "2.png", confidence);
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.report.format, "Polycam raw data");
  const std::vector<double> depths = first_depths(scene);
  EXPECT_NEAR(depths[0], 1.25, 1e-3);
  EXPECT_EQ(depths[1], 0);
  EXPECT_EQ(depths[2], 0);
  EXPECT_EQ(depths[3], -1);
}

TEST(DepthLayouts, Record3DsDepth) {
  TempFolder folder;
  std::vector<std::string> poses;
  for (int i = 0; i < kViews; ++i) {
    Pose p = ring_pose(i, kViews);
    for (int c : {1, 2}) p.rotation.set_column(c, -p.rotation.column(c));  // OpenGL's axes
    const auto q = colmap_pose(p.inverse());
    poses.push_back(fmt::format("[{},{},{},{},{},{},{}]", q[1], q[2], q[3], q[0], p.translation.x,
                                p.translation.y, p.translation.z));
    write_picture(folder / "rgb" / fmt::format("{}.jpg", i));
  }
  write_text(folder / "metadata.json",
             fmt::format(R"({{"w":40,"h":30,"K":[50,0,0,0,51,0,20,15,1],"poses":[{}]}})",
                         fmt::join(poses, ",")));
  fs::create_directories(folder / "depth");
  make_image(folder / "depth" / "0.exr", {8, 6, 1, OIIO::TypeDesc::FLOAT, {}},
             [](int, int, int) { return 1.75f; });
  write_millimetres(folder / "depth" / "1.png", 2500);
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.report.format, "Record3D");
  EXPECT_TRUE(scene.report.ignored.empty());
  const std::vector<double> depths = first_depths(scene);
  EXPECT_NEAR(depths[0], 1.75, 1e-3);
  EXPECT_NEAR(depths[1], 2.5, 2e-3);
  EXPECT_EQ(depths[2], -1);
  // As the application keeps them.
  fs::remove_all(folder / "depth");
  write_text(folder / "depth" / "0.depth", "bvx2");
  EXPECT_TRUE(any_contains(load_scene(folder.path()).report.ignored, "LZFSE"));
}

}  // namespace
}  // namespace nerf
