// What cameras write beside the pixels, and which photos it makes one camera's.
#include "io/cameras/photo_tags.h"

#include <array>
#include <fstream>

#include "io/cameras/capture_photos.h"
#include "io/test_images.h"

namespace nerf::internal {
namespace {

namespace fs = std::filesystem;
using test::contains;
using test::error_of;
using test::make_image;
using test::TempFolder;

struct Exif {
  std::string make, model, lens;
  float focal = 0;
  int orientation = 1;
};

class PhotoTagsTest : public ::testing::Test {
 protected:
  fs::path photo(const std::string& name, const Exif& exif, int width = 32, int height = 24,
                 const std::function<void(OIIO::ImageSpec&)>& more = {}) {
    const fs::path path = folder_ / name;
    fs::create_directories(path.parent_path());
    const auto adjust = [&](OIIO::ImageSpec& spec) {
      if (!exif.make.empty()) spec.attribute("Make", exif.make);
      if (!exif.model.empty()) spec.attribute("Model", exif.model);
      if (!exif.lens.empty()) spec.attribute("Exif:LensModel", exif.lens);
      if (exif.focal > 0) spec.attribute("Exif:FocalLength", exif.focal);
      spec.attribute("Orientation", exif.orientation);
      if (more) more(spec);
    };
    make_image(path, {width, height, 3, OIIO::TypeDesc::UINT8, adjust}, test::texture);
    return path;
  }
  TempFolder folder_;
};

TEST_F(PhotoTagsTest, AreReadFromTheHeader) {
  const OIIO::TypeDesc three(OIIO::TypeDesc::FLOAT, 3);
  const PhotoTags tags = read_photo_tags(
      photo("a.jpg", {"Maker", "One", "wide", 4.2f, 6}, 40, 30, [&](OIIO::ImageSpec& spec) {
        const std::array<float, 3> south{33, 30, 36}, east{18, 15, 0};
        spec.attribute("GPS:LatitudeRef", "S");
        spec.attribute("GPS:Latitude", three, south.data());
        spec.attribute("GPS:LongitudeRef", "E");
        spec.attribute("GPS:Longitude", three, east.data());
      }));
  EXPECT_EQ(tags.width, 40);
  EXPECT_EQ(tags.height, 30);
  EXPECT_EQ(tags.orientation, 6);
  EXPECT_TRUE(contains(tags.device, "Maker|One"));
  ASSERT_TRUE(tags.place);
  EXPECT_NEAR((*tags.place)[0], -33.51, 1e-4);
  EXPECT_NEAR((*tags.place)[1], 18.25, 1e-4);

  const PhotoTags none = read_photo_tags(photo("b.png", {}));
  EXPECT_EQ(none.device, "");
  EXPECT_EQ(none.orientation, 1);
  EXPECT_FALSE(none.place);
  EXPECT_TRUE(contains(error_of([&] { read_photo_tags(folder_ / "none.jpg"); }), "none.jpg"));
}

// One camera for each device, lens, zoom and size, wherever its photos lie.
TEST_F(PhotoTagsTest, PhotosOfOneDeviceAndLensAreOneCameras) {
  const Exif wide{"Maker", "One", "wide", 4.2f}, tele{"Maker", "One", "tele", 9};
  photo("0.jpg", wide);
  photo("1.jpg", tele);
  photo("2.jpg", wide, 24, 32);  // held upright and stored so
  photo("3.jpg", {"Maker", "Two", "wide", 4.2f});
  photo("day 2/4.jpg", wide);
  photo("day 2/5.jpg", {});
  photo("6.jpg", {});
  photo("7.jpg", {});
  photo("8.jpg", {"Maker", "One", "wide", 4.2f, 6});  // a program may turn it
  const CapturePhotos photos = look_at_photos(folder_.path(), {folder_ / "none", {}});
  std::vector<std::vector<std::string>> groups;
  for (const std::vector<int>& camera : photos.cameras()) {
    groups.emplace_back();
    for (const int i : camera) groups.back().push_back(photos.photos[static_cast<size_t>(i)].name);
  }
  const auto has = [&](const std::vector<std::string>& names) {
    return std::ranges::find(groups, names) != groups.end();
  };
  EXPECT_EQ(groups.size(), 7u);
  EXPECT_TRUE(has({"0.jpg", "day 2/4.jpg"}));
  EXPECT_TRUE(has({"6.jpg", "7.jpg"}));
  for (const char* alone : {"1.jpg", "2.jpg", "3.jpg", "8.jpg", "day 2/5.jpg"})
    EXPECT_TRUE(has({alone})) << alone;
}

}  // namespace
}  // namespace nerf::internal
