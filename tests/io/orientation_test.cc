// Photos with an EXIF orientation: turned where their camera has the size of the picture as shown.
#include "io/orientation.h"

#include <gtest/gtest.h>

#include <utility>

#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "test_images.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

// Where the stored pixel (column c, row r) of a picture of w x h is shown, from the words of the
// standard: which side of the picture the first row is, and which the first column.
std::pair<int, int> shown_at(int orientation, int c, int r, int w, int h) {
  switch (orientation) {
    case 1:
      return {c, r};  // top, left
    case 2:
      return {w - 1 - c, r};  // top, right
    case 3:
      return {w - 1 - c, h - 1 - r};  // bottom, right
    case 4:
      return {c, h - 1 - r};  // bottom, left
    case 5:
      return {r, c};  // left, top
    case 6:
      return {h - 1 - r, c};  // right, top
    case 7:
      return {h - 1 - r, w - 1 - c};  // right, bottom
    default:
      return {r, w - 1 - c};  // left, bottom
  }
}

TEST(Orientation, EveryStoredPixelIsShownWhereTheStandardSays) {
  constexpr int kWidth = 5, kHeight = 3;
  for (int orientation = 1; orientation <= 8; ++orientation) {
    const ShownPixels shown = shown_pixels(orientation, kWidth, kHeight);
    EXPECT_EQ(shown.width, orientation < 5 ? kWidth : kHeight);
    EXPECT_EQ(shown.height, orientation < 5 ? kHeight : kWidth);
    for (int r = 0; r < kHeight; ++r) {
      for (int c = 0; c < kWidth; ++c) {
        const auto [x, y] = shown_at(orientation, c, r, kWidth, kHeight);
        EXPECT_EQ(shown.at(x, y), r * kWidth + c) << orientation;
      }
    }
  }
}

TEST(Orientation, TheCamerasSizeDecides) {
  const auto of = [](int w, int h, int orientation, int camera_w, int camera_h) {
    Camera camera;
    camera.width = camera_w;
    camera.height = camera_h;
    ImageInfo info;
    info.width = w;
    info.height = h;
    info.orientation = orientation;
    return orientation_for(camera, info);
  };
  EXPECT_EQ(of(40, 30, 6, 30, 40), 6);
  EXPECT_EQ(of(40, 30, 6, 40, 30), 1);
  EXPECT_EQ(of(40, 30, 8, 60, 80), 8);  // resized
  EXPECT_EQ(of(40, 30, 8, 80, 60), 1);
  EXPECT_EQ(of(40, 30, 3, 30, 40), 1);  // upside down is no turn by 90 degrees
  EXPECT_EQ(of(40, 30, 6, 40, 40), 1);
  EXPECT_EQ(of(40, 40, 6, 40, 40), 1);      // square: as stored
  EXPECT_EQ(of(400, 404, 6, 404, 400), 6);  // nearly square: the exact size is meant
  EXPECT_EQ(of(400, 404, 6, 400, 404), 1);
}

class TurnedPhotos : public ::testing::Test {
 protected:
  // A photo stored with 12 x 8 pixels, whose camera has camera_width x camera_height.
  Photo load(int orientation, int camera_width, int camera_height, int downscale = 1,
             OIIO::TypeDesc type = OIIO::TypeDesc::UINT8) {
    make_image(folder_ / "a.tif",
               {12, 8, 3, type,
                [&](OIIO::ImageSpec& spec) { spec.attribute("Orientation", orientation); }},
               texture);
    Scene scene;
    scene.options.downscale = downscale;
    Camera camera;
    camera.width = camera_width;
    camera.height = camera_height;
    camera.params = {100, 100, camera_width / 2.0, camera_height / 2.0};
    scene.cameras.push_back(camera);
    View view;
    view.name = "a.tif";
    view.image_path = folder_ / "a.tif";
    view.mask_path = mask_;
    scene.views.push_back(view);
    ThreadPool pool(1);
    PhotoSet set = load_photos(scene, pool);
    EXPECT_EQ(set.cameras[0].width, set.photos[0].width);
    EXPECT_EQ(set.cameras[0].height, set.photos[0].height);
    return std::move(set.photos[0]);
  }
  TempFolder folder_;
  std::filesystem::path mask_;
};

TEST_F(TurnedPhotos, PixelsStandUpright) {
  for (const auto type : {OIIO::TypeDesc::UINT8, OIIO::TypeDesc::UINT16}) {
    for (int orientation = 5; orientation <= 8; ++orientation) {
      const Photo photo = load(orientation, 8, 12, 1, type);
      ASSERT_EQ(photo.width, 8);
      ASSERT_EQ(photo.height, 12);
      for (int r = 0; r < 8; ++r) {
        for (int c = 0; c < 12; ++c) {
          const auto [x, y] = shown_at(orientation, c, r, 12, 8);
          Real rgba[4];
          photo.pixel(x, y, rgba);
          for (int k = 0; k < 3; ++k) {
            ASSERT_NEAR(static_cast<float>(rgba[k]), texture(c, r, k), 3e-3) << orientation;
          }
        }
      }
    }
  }
}

TEST_F(TurnedPhotos, OfTheStoredSizeStayAsStored) {
  const Photo photo = load(6, 12, 8);
  ASSERT_EQ(photo.width, 12);
  Real rgba[4];
  photo.pixel(11, 2, rgba);
  EXPECT_NEAR(static_cast<float>(rgba[0]), texture(11, 2, 0), 3e-3);
}

TEST_F(TurnedPhotos, AreReducedAfterwards) {
  const Photo photo = load(6, 8, 12, 2);
  ASSERT_EQ(photo.width, 4);
  ASSERT_EQ(photo.height, 6);
  double sum = 0;  // the stored pixels that are shown at x 0 and 1, y 0 and 1
  for (int c = 0; c < 2; ++c)
    for (int r = 6; r < 8; ++r) sum += texture(c, r, 1);
  Real rgba[4];
  photo.pixel(0, 0, rgba);
  EXPECT_NEAR(static_cast<double>(rgba[1]), sum / 4, 4e-3);
}

TEST_F(TurnedPhotos, MasksMayLieEitherWay) {
  mask_ = folder_ / "m.png";
  // Masked out: the stored pixel (0, 7), which orientation 6 shows at (0, 0).
  make_image(mask_, {12, 8, 1, OIIO::TypeDesc::UINT8, {}},
             [](int x, int y, int) { return x == 0 && y == 7 ? 0.0f : 1.0f; });
  Photo photo = load(6, 8, 12);
  EXPECT_TRUE(photo.masked_out(0, 0));
  EXPECT_EQ(std::count(photo.mask.begin(), photo.mask.end(), 0), 1);
  make_image(mask_, {8, 12, 1, OIIO::TypeDesc::UINT8, {}},
             [](int x, int y, int) { return x == 3 && y == 5 ? 0.0f : 1.0f; });
  photo = load(6, 8, 12);
  EXPECT_TRUE(photo.masked_out(3, 5));
  EXPECT_EQ(std::count(photo.mask.begin(), photo.mask.end(), 0), 1);
}

TEST(Orientation, OfPortraitPhotosInACapture) {
  TempFolder folder;
  TestModel model = ring_model(4);
  model.cameras[0] = {1, 1, 30, 40, {50, 50, 15, 20}};
  for (TestImage& image : model.images) image.name.replace(2, 4, ".jpg");
  write_binary(model, folder / "sparse" / "0");
  std::filesystem::create_directories(folder / "images");
  for (const TestImage& image : model.images) {
    make_image(folder / "images" / image.name,
               {40, 30, 3, OIIO::TypeDesc::UINT8,
                [](OIIO::ImageSpec& spec) { spec.attribute("Orientation", 6); }},
               texture);
    EXPECT_EQ(read_image_info(folder / "images" / image.name).orientation, 6);
  }
  const Scene scene = load_scene(folder.path());
  EXPECT_EQ(scene.cameras[0].width, 30);
  EXPECT_EQ(scene.cameras[0].height, 40);
  EXPECT_TRUE(any_contains(scene.report.notes, "4 of 4 photos are turned"));
  ThreadPool pool(1);
  EXPECT_EQ(load_photos(scene, pool).photos[0].height, 40);
}

}  // namespace
}  // namespace nerf::internal
