// Photos as phones store them: recognised, read, and converted for colmap.
#include "io/photo_conversion.h"

#include <gtest/gtest.h>

#include "io/scene_input.h"
#include "nerf/base/file.h"
#include "nerf/io/image.h"
#include "test_images.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;
namespace fs = std::filesystem;

float smooth(int x, int y, int c) {
  return c == 0 ? static_cast<float>(x) / 64 : c == 1 ? static_cast<float>(y) / 48 : 0.25f;
}

void make_photo(const fs::path& path, const std::function<void(OIIO::ImageSpec&)>& adjust = {}) {
  fs::create_directories(path.parent_path());
  make_image(path, {64, 48, 3, OIIO::TypeDesc::UINT8, adjust}, smooth);
}

class PhotoConversion : public ::testing::Test {
 protected:
  fs::path prepare() {
    notes_.clear();
    return prepared_photos(folder_ / "photos", {folder_ / "run" / "capture", folder_ / "run"}, {},
                           nullptr, notes_);
  }
  TempFolder folder_;
  std::vector<std::string> notes_;
};

TEST_F(PhotoConversion, PhonesFormatsArePhotosAndCanBeRead) {
  for (const char* name : {"a.HEIC", "b.avif"}) {
    make_photo(folder_ / name);
    EXPECT_TRUE(is_image_file(folder_ / name));
    const Image8 image = read_image_8bit(folder_ / name);
    ASSERT_EQ(image.width, 64);
    ASSERT_EQ(image.channels, 3);
    EXPECT_NEAR(image.pixels[(24 * 64 + 40) * 3], 255 * 40 / 64, 8) << name;
  }
  EXPECT_TRUE(is_image_file("x.dng") && is_image_file("x.CR2") && is_image_file("x.NEF"));
  EXPECT_FALSE(is_image_file("x.mov") || is_image_file("x.aae") || is_image_file(".x.heic"));
}

TEST_F(PhotoConversion, FoldersThatColmapReadsStayAsTheyAre) {
  make_photo(folder_ / "photos" / "a.jpg");
  make_photo(folder_ / "photos" / "b.png");
  EXPECT_EQ(prepare(), folder_ / "photos");
  EXPECT_TRUE(notes_.empty());
  EXPECT_FALSE(fs::exists(folder_ / "run"));
}

TEST_F(PhotoConversion, OthersAreConvertedOnceWithTheirFocalLength) {
  make_photo(folder_ / "photos" / "a.heic", [](OIIO::ImageSpec& spec) {
    spec.attribute("Make", "Phone");
    spec.attribute("Exif:FocalLength", 4.25f);
  });
  make_photo(folder_ / "photos" / "sub" / "b.heic");
  make_photo(folder_ / "photos" / "c.jpg");
  make_photo(folder_ / "run" / "eval" / "d.jpg");
  const fs::path prepared = prepare();
  EXPECT_EQ(prepared, folder_ / "run" / "capture" / "photos");
  EXPECT_EQ(list_images(prepared), (std::vector<std::string>{"a.jpg", "c.jpg", "sub/b.jpg"}));
  EXPECT_TRUE(any_contains(notes_, "2 of 3 photos were converted"));
  const Image8 image = read_image_8bit(prepared / "a.jpg");
  EXPECT_EQ(image.width, 64);
  EXPECT_NEAR(image.pixels[(24 * 64 + 40) * 3 + 1], 255 / 2, 8);
  const auto in = OIIO::ImageInput::open((prepared / "a.jpg").string());
  ASSERT_TRUE(in);
  EXPECT_NEAR(in->spec().get_float_attribute("Exif:FocalLength"), 4.25f, 1e-3f);
  EXPECT_EQ(in->spec().get_string_attribute("Make"), "Phone");
  EXPECT_TRUE(fs::is_symlink(prepared / "c.jpg"));

  const auto time = fs::last_write_time(prepared / "a.jpg");
  EXPECT_EQ(prepare(), prepared);
  EXPECT_EQ(fs::last_write_time(prepared / "a.jpg"), time);  // used again
  make_photo(folder_ / "photos" / "e.heic");
  prepare();
  EXPECT_EQ(list_images(prepared).size(), 4u);
}

TEST_F(PhotoConversion, AShotInTwoFormatsCountsOnce) {
  make_photo(folder_ / "photos" / "a.heic");
  make_photo(folder_ / "photos" / "a.jpg");
  make_photo(folder_ / "photos" / "b.heic");
  make_photo(folder_ / "photos" / "b.avif");
  const fs::path prepared = prepare();
  EXPECT_EQ(list_images(prepared), (std::vector<std::string>{"a.jpg", "b.jpg"}));
  EXPECT_TRUE(fs::is_symlink(prepared / "a.jpg"));
  EXPECT_TRUE(any_contains(notes_, "2 photos lie there in two formats"));
}

TEST_F(PhotoConversion, APhotoThatIsBrokenIsNamedAndNothingIsLeft) {
  make_photo(folder_ / "photos" / "a.heic");
  write_text(folder_ / "photos" / "b.heic", "no photo");
  EXPECT_TRUE(contains(error_of([&] { prepare(); }), "b.heic"));
  EXPECT_FALSE(fs::exists(folder_ / "run" / "capture" / "photos"));
  Cancel stopped;
  stopped.request();
  fs::remove(folder_ / "photos" / "b.heic");
  EXPECT_THROW(
      prepared_photos(folder_ / "photos", {folder_ / "run" / "capture", {}}, {}, &stopped, notes_),
      Cancelled);
}

TEST_F(PhotoConversion, WhatAGainMapAddsIsNotRead) {
  // A JPEG of a phone ends with a second picture, how much brighter a screen may show the first.
  make_photo(folder_ / "a.jpg");
  make_image(folder_ / "map.jpg", {16, 12, 1, OIIO::TypeDesc::UINT8, {}},
             [](int, int, int) { return 1.0f; });
  std::vector<uint8_t> both = read_file(folder_ / "a.jpg");
  const Image8 alone = read_image_8bit(folder_ / "a.jpg");
  const std::vector<uint8_t> map = read_file(folder_ / "map.jpg");
  both.insert(both.end(), map.begin(), map.end());
  write_bytes(folder_ / "a.jpg", {both.begin(), both.end()});
  EXPECT_EQ(read_image_8bit(folder_ / "a.jpg").pixels, alone.pixels);
  check_image_complete(folder_ / "a.jpg");
  EXPECT_EQ(read_image_info(folder_ / "a.jpg").width, 64);
}

}  // namespace
}  // namespace nerf::internal
