// Depth maps of every kind that captures bring, written here.
#include "io/depth_file.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>

#include "base/half.h"
#include "io/npy.h"
#include "nerf/io/photos.h"
#include "test_images.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;
namespace fs = std::filesystem;

// Metres: of pixel (x, y) of a 20 x 15 map.
double depth_at(int x, int y) { return 2 + 0.01 * x + 0.02 * y; }

void write_png(const fs::path& path, int width = 20, int height = 15, double units = 1000) {
  fs::create_directories(path.parent_path());
  make_image(path, {width, height, 1, OIIO::TypeDesc::UINT16, {}}, [&](int x, int y, int) {
    return static_cast<float>(std::round(depth_at(x, y) * units) / 65535);
  });
}

void write_floats(const fs::path& path, double units, int channels = 1) {
  fs::create_directories(path.parent_path());
  make_image(path, {20, 15, channels, OIIO::TypeDesc::FLOAT, {}},
             [&](int x, int y, int) { return static_cast<float>(depth_at(x, y) * units); });
}

template <class T>
void write_npy(const fs::path& path, const std::string& type, const std::string& shape,
               const std::vector<T>& values) {
  fs::create_directories(path.parent_path());
  std::string header =
      fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}", type, shape);
  header.resize((header.size() + 11 + 63) / 64 * 64 - 11, ' ');
  header += '\n';
  std::ofstream out(path, std::ios::binary);
  out.write("\x93NUMPY\x01\x00", 8);
  const auto length = static_cast<uint16_t>(header.size());
  out.write(reinterpret_cast<const char*>(&length), 2);
  out << header;
  out.write(reinterpret_cast<const char*>(values.data()),
            static_cast<std::streamsize>(values.size() * sizeof(T)));
}

template <class T>
std::vector<T> depths(double units) {
  std::vector<T> out;
  for (int y = 0; y < 15; ++y)
    for (int x = 0; x < 20; ++x) out.push_back(static_cast<T>(std::lround(depth_at(x, y) * units)));
  return out;
}

// The ring of test_scenes.h with depth_file_path "depth/0" + extension, ..., `head` in the file.
void write_ring(const fs::path& folder, const std::string& extension, const std::string& head = "",
                const std::string& key = "depth_file_path") {
  constexpr int kViews = 4;
  for (int i = 0; i < kViews; ++i) write_picture(folder / "images" / fmt::format("{}.png", i));
  std::string text = transforms_text(kViews, "images/", ".png", R"("fl_x":50)" + head);
  for (int i = 0; i < kViews; ++i) {
    const std::string name = fmt::format("\"images/{}.png\"", i);
    text.insert(text.find(name) + name.size(),
                fmt::format(",\"{}\":\"depth/{}{}\"", key, i, extension));
  }
  write_text(folder / "transforms.json", text);
}

PhotoSet photos_of(const Scene& scene) {
  ThreadPool pool(2);
  return load_photos(scene, pool);
}

// What the map of view 0 says, input units, beside what was written.
void expect_depths(const Scene& scene, double step) {
  const PhotoSet photos = photos_of(scene);
  for (const Photo& photo : photos.photos) {
    ASSERT_EQ(photo.depth.width, 20);
    ASSERT_EQ(photo.depth.height, 15);
    for (int y = 0; y < 15; ++y)
      for (int x = 0; x < 20; ++x)
        ASSERT_NEAR(photo.depth.pixel(x, y) / scene.to_engine.scale, depth_at(x, y),
                    step + 0x1p-11 * depth_at(x, y));
  }
}

TEST(DepthFiles, MillimetresInPng) {
  TempFolder folder;
  write_ring(folder.path(), ".png");
  for (int i = 0; i < 4; ++i) write_png(folder / "depth" / fmt::format("{}.png", i));
  const Scene scene = load_scene(folder.path());
  expect_depths(scene, 0.0005);
  EXPECT_TRUE(any_contains(scene.report.notes, "4 of 4 photos have a depth map"));
  EXPECT_FALSE(any_contains(scene.report.warnings, "no 3D points"));
  EXPECT_TRUE(scene.report.ignored.empty());
  EXPECT_GE(scene.report.memory_estimate_bytes, 4u * (40 * 30 * 3 + 20 * 15 * 2));
  const fs::path elsewhere = folder / "none";
  fs::rename(folder / "depth", elsewhere);
  const Scene without = load_scene(folder.path());
  EXPECT_TRUE(any_contains(without.report.warnings, "4 of 4 depth maps are missing: 0.png"));
  EXPECT_TRUE(photos_of(without).photos[0].depth.empty());
  EXPECT_LT(without.report.memory_estimate_bytes, scene.report.memory_estimate_bytes);
}

TEST(DepthFiles, UnitsThatTheFileSays) {
  TempFolder folder;
  for (int i = 0; i < 4; ++i) write_png(folder / "depth" / fmt::format("{}.png", i), 20, 15, 5000);
  write_ring(folder.path(), ".png", R"(,"depth_unit_scale_factor":0.0002)");
  expect_depths(load_scene(folder.path()), 0.0001);
  write_ring(folder.path(), ".png", R"(,"integer_depth_scale":0.0002)", "depth_path");
  expect_depths(load_scene(folder.path()), 0.0001);
  write_ring(folder.path(), ".png", R"(,"enable_depth_loading":false)", "depth_path");
  EXPECT_TRUE(photos_of(load_scene(folder.path())).photos[0].depth.empty());
  write_ring(folder.path(), ".png", R"(,"depth_unit_scale_factor":-1)");
  EXPECT_TRUE(contains(load_error(folder.path()), "\"depth_unit_scale_factor\" is not above 0"));
}

// nerfstudio multiplies by 0.001 whatever the type; but 0.002 units before cameras that stand 4
// units from the middle there is nothing.
TEST(DepthFiles, FloatsInMetresOrMillimetres) {
  for (const char* extension : {".exr", ".tif"}) {
    for (const double units : {1.0, 1000.0}) {
      TempFolder folder;
      write_ring(folder.path(), extension);
      for (int i = 0; i < 4; ++i)
        write_floats(folder / "depth" / fmt::format("{}{}", i, extension), units);
      const Scene scene = load_scene(folder.path());
      expect_depths(scene, 1e-6);
      EXPECT_EQ(any_contains(scene.report.notes, "in the capture's unit"), units == 1);
    }
  }
}

TEST(DepthFiles, ChannelZOfSeveral) {
  TempFolder folder;
  make_image(folder / "z.exr",
             {4, 3, 3, OIIO::TypeDesc::FLOAT,
              [](OIIO::ImageSpec& spec) { spec.channelnames = {"A", "Y", "Z"}; }},
             [](int, int, int c) { return static_cast<float>(c); });
  const DepthImage image = read_depth_image(folder / "z.exr");
  EXPECT_EQ(image.values, std::vector<float>(12, 2.0f));
  EXPECT_FALSE(image.integers);
}

TEST(DepthFiles, ArraysOfNumPy) {
  TempFolder folder;
  const auto shape_of = [](int i) { return i % 2 ? "(15, 20, 1)" : "(15, 20)"; };
  const auto files = [&](auto write) {
    for (int i = 0; i < 4; ++i) write(folder / "depth" / fmt::format("{}.npy", i), shape_of(i));
    expect_depths(load_scene(folder.path()), 0.001);
  };
  write_ring(folder.path(), ".npy");
  files([](const fs::path& p, const char* shape) {
    write_npy(p, "<u2", shape, depths<uint16_t>(1000));
  });
  files([](const fs::path& p, const char* shape) {
    write_npy(p, "<f4", shape, depths<float>(1000));
  });
  files([](const fs::path& p, const char* shape) {
    std::vector<uint16_t> halves;
    for (const double d : depths<double>(1000))
      halves.push_back(float_to_half(static_cast<float>(d)));
    write_npy(p, "<f2", shape, halves);
  });
}

TEST(DepthFiles, WhatIsUnknown) {
  TempFolder folder;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinite = std::numeric_limits<float>::infinity();
  write_npy<float>(folder / "a.npy", "<f4", "(2, 4)", {0, nan, infinite, -1, 1, 2, 3, 1e9f});
  Image8 confidence{4, 2, 1, {2, 2, 2, 2, 0, 1, 2, 2}};
  write_image(folder / "c.png", confidence);
  View view;
  view.depth_path = folder / "a.npy";
  view.depth_unit = 1;
  const auto known = [&] {
    const DepthMap map = read_depth_map(view, 1, 40, 20, 0.5);
    std::vector<double> out;
    for (int i = 0; i < 8; ++i) out.push_back(map.pixel(i % 4, i / 4));
    return out;
  };
  EXPECT_EQ(known(), (std::vector<double>{0, 0, 0, 0, 0.5, 1, 1.5, 0}));
  view.depth_reach = 2.5;
  EXPECT_EQ(known(), (std::vector<double>{0, 0, 0, 0, 0.5, 1, 0, 0}));
  view.depth_confidence_path = folder / "c.png";
  EXPECT_EQ(known(), (std::vector<double>{0, 0, 0, 0, 0, 1, 0, 0}));
  confidence.width = 2;
  confidence.pixels.resize(4);
  write_image(folder / "c.png", confidence);
  EXPECT_TRUE(contains(error_of(known), "c.png: is 2 x 2 pixels and its depth map 4 x 2"));
}

// A photo that is turned as EXIF says: its map may be stored as the photo is or as it is shown.
TEST(DepthFiles, MapsOfTurnedPhotos) {
  TempFolder folder;
  std::vector<float> values;
  for (int i = 0; i < 300; ++i) values.push_back(static_cast<float>(i + 1));
  write_npy<float>(folder / "stored.npy", "<f4", "(10, 30)", values);
  View view;
  view.depth_path = folder / "stored.npy";
  view.depth_unit = 1;
  const DepthMap map = read_depth_map(view, 6, 20, 60, 1);  // shown upright
  EXPECT_EQ(map.width, 10);
  EXPECT_EQ(map.height, 30);
  EXPECT_EQ(map.pixel(9, 0), 1);  // the first stored pixel is at the upper right
  EXPECT_EQ(map.pixel(9, 29), 30);
  EXPECT_EQ(read_depth_map(view, 6, 60, 20, 1).pixel(0, 0), 1);
}

TEST(DepthFiles, WhatIsNoDepthMap) {
  TempFolder folder;
  View view;
  view.depth_unit = 1;
  const auto error = [&](const std::string& name) {
    view.depth_path = folder / name;
    return error_of([&] { read_depth_map(view, 1, 40, 30, 1); });
  };
  write_picture(folder / "colour.png");
  EXPECT_TRUE(contains(error("colour.png"), "colour.png: has 3 channels: it is a picture"));
  write_picture(folder / "grey.png", 40, 30, 1);
  EXPECT_TRUE(contains(error("grey.png"), "grey.png: has 8 bits"));
  write_png(folder / "wide.png", 40, 15);
  EXPECT_TRUE(contains(error("wide.png"), "40 x 15 pixels and its photo 40 x 30"));
  write_png(folder / "upright.png", 15, 20);
  EXPECT_TRUE(contains(error("upright.png"), "do not show the same"));
  write_png(folder / "cut.png");
  fs::resize_file(folder / "cut.png", fs::file_size(folder / "cut.png") / 2);
  EXPECT_TRUE(contains(error("cut.png"), "cut.png: "));
  write_floats(folder / "cut.exr", 1);
  fs::resize_file(folder / "cut.exr", fs::file_size(folder / "cut.exr") / 2);
  EXPECT_TRUE(contains(error("cut.exr"), "cut.exr: "));
  write_text(folder / "text.png", "no picture");
  EXPECT_TRUE(contains(error("text.png"), "text.png: cannot read the image"));
  write_npy<float>(folder / "cut.npy", "<f4", "(30, 40)", std::vector<float>(7));
  EXPECT_TRUE(contains(error("cut.npy"), "28 bytes of numbers, but its shape asks for 4800"));
  write_npy<float>(folder / "deep.npy", "<f4", "(2, 3, 4)", std::vector<float>(24));
  EXPECT_TRUE(contains(error("deep.npy"), "shape (2, 3, 4), not of rows and columns"));
  write_npy<int16_t>(folder / "signed.npy", "<i2", "(30, 40)", std::vector<int16_t>(1200));
  EXPECT_TRUE(contains(error("signed.npy"), "type '<i2'"));
  // Through the whole capture: the file is named.
  write_ring(folder.path(), ".png");
  for (int i = 0; i < 4; ++i) write_png(folder / "depth" / fmt::format("{}.png", i), 10, 15);
  const Scene scene = load_scene(folder.path());
  EXPECT_TRUE(contains(error_of([&] { photos_of(scene); }), ".png: the depth map is 10 x 15"));
}

}  // namespace
}  // namespace nerf::internal
