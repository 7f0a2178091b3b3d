#include "nerf/io/photos.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>

#include "io/photo_plan.h"
#include "nerf/base/file.h"
#include "test_images.h"

namespace nerf {
namespace {

using test::contains;
using test::error_of;
using test::ImageFile;
using test::make_image;
using test::TempFolder;
using test::texture;

class Photos : public ::testing::Test {
 protected:
  // A view of a new image of the given kind, whose camera says camera_width x camera_height (the
  // image's own size where 0).
  void add(const std::string& name, const ImageFile& file,
           const std::function<float(int, int, int)>& pixel, int camera_width = 0,
           int camera_height = 0) {
    make_image(folder_ / name, file, pixel);
    Camera camera;
    camera.width = camera_width > 0 ? camera_width : file.width;
    camera.height = camera_height > 0 ? camera_height : file.height;
    camera.params = {100, 100, camera.width / 2.0, camera.height / 2.0};
    View view;
    view.name = name;
    view.image_path = folder_ / name;
    view.camera = static_cast<int>(scene_.cameras.size());
    scene_.cameras.push_back(camera);
    scene_.views.push_back(view);
  }
  PhotoSet load(int downscale = 1, int threads = 2) {
    scene_.options.downscale = downscale;
    ThreadPool pool(threads);
    return load_photos(scene_, pool);
  }
  std::string error(int downscale = 1) {
    return error_of([&] { load(downscale); });
  }

  TempFolder folder_;
  Scene scene_;
};

std::array<float, 4> pixel_of(const Photo& photo, int x, int y) {
  Real rgba[4];
  photo.pixel(x, y, rgba);
  std::array<float, 4> out;
  std::transform(rgba, rgba + 4, out.begin(), [](Real v) { return static_cast<float>(v); });
  return out;
}

TEST_F(Photos, EightBitsStayEightBits) {
  add("a.png", {20, 12, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  const PhotoSet set = load();
  ASSERT_EQ(set.photos.size(), 1u);
  const Photo& photo = set.photos[0];
  EXPECT_EQ(photo.width, 20);
  EXPECT_EQ(photo.height, 12);
  EXPECT_EQ(photo.channels, 3);
  EXPECT_EQ(photo.pixels8.size(), 20u * 12 * 3);
  EXPECT_TRUE(photo.pixels16.empty());
  for (int y = 0; y < 12; ++y) {
    for (int x = 0; x < 20; ++x) {
      const auto rgba = pixel_of(photo, x, y);
      for (int c = 0; c < 3; ++c) ASSERT_EQ(rgba[static_cast<size_t>(c)], texture(x, y, c));
      ASSERT_EQ(rgba[3], 1);
      ASSERT_FALSE(photo.masked_out(x, y));
    }
  }
  EXPECT_EQ(set.fraction_masked, 0);
  EXPECT_GE(set.decode_seconds, 0);
}

TEST_F(Photos, GreyBecomesColour) {
  add("a.png", {9, 7, 1, OIIO::TypeDesc::UINT8, {}}, texture);
  add("b.png", {9, 7, 1, OIIO::TypeDesc::UINT16, {}}, texture);
  const PhotoSet set = load();
  for (const Photo& photo : set.photos) {
    EXPECT_EQ(photo.channels, 3);
    const auto rgba = pixel_of(photo, 4, 5);
    for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(rgba[c], texture(4, 5, 0), 5e-4);
  }
}

TEST_F(Photos, SixteenBitsAndExrAreKeptAsHalf) {
  const auto fine = [](int x, int y, int) { return 0.5f + static_cast<float>(y * 30 + x) / 4096; };
  add("a.png", {30, 20, 3, OIIO::TypeDesc::UINT16, {}}, fine);
  add("a.tif", {30, 20, 3, OIIO::TypeDesc::UINT16, {}}, fine);
  add("a.exr", {30, 20, 3, OIIO::TypeDesc::HALF, {}}, fine);
  add("b.exr", {30, 20, 3, OIIO::TypeDesc::FLOAT, {}}, fine);
  for (const Photo& photo : load().photos) {
    EXPECT_TRUE(photo.pixels8.empty());
    ASSERT_EQ(photo.pixels16.size(), 30u * 20 * 3);
    for (int y = 0; y < 20; ++y) {
      for (int x = 0; x < 30; ++x) {
        // Half has 11 bits: 2^-12 is half of the last place between 0.5 and 1.
        ASSERT_NEAR(pixel_of(photo, x, y)[1], fine(x, y, 1), 0x1p-12 + 1e-5);
      }
    }
  }
}

TEST_F(Photos, ExrMayExceedOneAndBeInfinite) {
  add("a.exr", {8, 8, 3, OIIO::TypeDesc::FLOAT, {}}, [](int x, int, int) {
    return x == 0 ? 12.5f : x == 1 ? std::numeric_limits<float>::infinity() : x == 2 ? 1e9f : -0.5f;
  });
  const PhotoSet set = load();
  EXPECT_EQ(pixel_of(set.photos[0], 0, 3)[0], 12.5f);
  EXPECT_EQ(pixel_of(set.photos[0], 1, 3)[0], 65504.0f);
  EXPECT_EQ(pixel_of(set.photos[0], 2, 3)[0], 65504.0f);
  EXPECT_EQ(pixel_of(set.photos[0], 3, 3)[0], -0.5f);
}

TEST_F(Photos, NotANumberIsAnErrorThatSaysWhere) {
  add("a.exr", {8, 8, 3, OIIO::TypeDesc::FLOAT, {}},
      [](int x, int y, int) { return x == 5 && y == 2 ? std::nanf("") : 0.5f; });
  EXPECT_TRUE(contains(error(), "a.exr: the pixel at column 5, row 2 is not a number"));
}

TEST_F(Photos, AlphaIsKeptWhereThereIsAny) {
  const auto glass = [](int x, int y, int c) {
    return c == 3 ? (x < 4 ? 0.2f : 1.0f) : texture(x, y, c);
  };
  add("a.png", {8, 6, 4, OIIO::TypeDesc::UINT8, {}}, glass);
  add("b.png", {8, 6, 4, OIIO::TypeDesc::UINT8, {}},
      [](int x, int y, int c) { return c == 3 ? 1.0f : texture(x, y, c); });
  add("c.png", {8, 6, 2, OIIO::TypeDesc::UINT8, {}},
      [](int x, int y, int c) { return c == 1 ? 0.4f : texture(x, y, 0); });
  add("d.png", {8, 6, 4, OIIO::TypeDesc::UINT16, {}}, glass);
  const PhotoSet set = load();
  EXPECT_EQ(set.photos[0].channels, 4);
  EXPECT_EQ(set.photos[1].channels, 3);  // opaque everywhere
  EXPECT_EQ(set.photos[2].channels, 4);
  EXPECT_EQ(set.photos[3].channels, 4);
  for (size_t i : {size_t{0}, size_t{3}}) {
    EXPECT_NEAR(pixel_of(set.photos[i], 2, 3)[3], 0.2f, 1e-3);
    EXPECT_NEAR(pixel_of(set.photos[i], 2, 3)[1], texture(2, 3, 1), 1e-3);  // straight
  }
  EXPECT_EQ(pixel_of(set.photos[1], 2, 3)[2], texture(2, 3, 2));
  EXPECT_NEAR(pixel_of(set.photos[2], 2, 3)[2], texture(2, 3, 0), 1e-6);
  EXPECT_NEAR(pixel_of(set.photos[2], 2, 3)[3], 0.4f, 1e-6);
}

TEST_F(Photos, PremultipliedExrBecomesStraight) {
  add("a.exr", {8, 8, 4, OIIO::TypeDesc::HALF, {}},
      [](int x, int, int c) { return c == 3 ? (x < 4 ? 0.25f : 0.0f) : 0.125f; });
  const PhotoSet set = load();
  EXPECT_EQ(pixel_of(set.photos[0], 0, 0), (std::array{0.5f, 0.5f, 0.5f, 0.25f}));
  EXPECT_EQ(pixel_of(set.photos[0], 7, 0)[3], 0);
}

TEST_F(Photos, DownscaleAveragesAreas) {
  add("a.png", {8, 6, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  add("a.exr", {8, 6, 3, OIIO::TypeDesc::FLOAT, {}}, texture);
  const PhotoSet set = load(2);
  for (const Photo& photo : set.photos) {
    ASSERT_EQ(photo.width, 4);
    ASSERT_EQ(photo.height, 3);
    for (int y = 0; y < 3; ++y) {
      for (int x = 0; x < 4; ++x) {
        for (int c = 0; c < 3; ++c) {
          const float mean = (texture(2 * x, 2 * y, c) + texture(2 * x + 1, 2 * y, c) +
                              texture(2 * x, 2 * y + 1, c) + texture(2 * x + 1, 2 * y + 1, c)) /
                             4;
          const float tolerance = photo.pixels8.empty() ? 5e-4f : 0.5f / 255 + 1e-5f;
          ASSERT_NEAR(pixel_of(photo, x, y)[static_cast<size_t>(c)], mean, tolerance);
        }
      }
    }
  }
  // The camera goes with it: pixel (x, y) of the full size is at half of both.
  EXPECT_EQ(set.cameras[0].width, 4);
  EXPECT_EQ(set.cameras[0].fx(), 50);
  EXPECT_EQ(set.cameras[0].cy(), 1.5);
}

TEST_F(Photos, DownscaleThatDoesNotDivide) {
  add("a.png", {10, 7, 3, OIIO::TypeDesc::UINT8, {}}, [](int, int, int) { return 1.0f; });
  const PhotoSet set = load(3);
  EXPECT_EQ(set.photos[0].width, 3);
  EXPECT_EQ(set.photos[0].height, 2);
  EXPECT_EQ(set.photos[0].pixels8, std::vector<uint8_t>(18, 255));  // weights sum to 1
  EXPECT_NEAR(set.cameras[0].fx(), 30, 1e-9);
  EXPECT_NEAR(set.cameras[0].fy(), 100 * 2 / 7.0, 1e-9);
  EXPECT_TRUE(contains(error(8), "--downscale 8 leaves nothing of 10 x 7 pixels"));
  EXPECT_TRUE(contains(error(0), "--downscale 0"));
}

// Invisible colours must not bleed into visible ones.
TEST_F(Photos, DownscaleWeighsColourByAlpha) {
  add("a.png", {4, 2, 4, OIIO::TypeDesc::UINT8, {}}, [](int x, int, int c) {
    if (c == 3) return x % 2 == 0 ? 1.0f : 0.0f;
    return x % 2 == 0 ? 0.6f : 0.0f;  // black where transparent
  });
  const PhotoSet set = load(2);
  const auto rgba = pixel_of(set.photos[0], 1, 0);
  EXPECT_NEAR(rgba[0], 0.6, 1e-3);
  EXPECT_NEAR(rgba[3], 0.5, 3e-3);
}

TEST_F(Photos, MasksKeepFrom128AndAreResizedToThePhoto) {
  add("a.png", {8, 8, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  add("b.png", {8, 8, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  add("c.png", {8, 8, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  const auto halves = [](int x, int, int) { return (x < 4 ? 127.0f : 128.0f) / 255; };
  make_image(folder_ / "ma.png", {8, 8, 1, OIIO::TypeDesc::UINT8, {}}, halves);
  // Another size and more channels: the first decides.
  make_image(folder_ / "mb.png", {2, 2, 3, OIIO::TypeDesc::UINT8, {}},
             [](int x, int y, int c) { return c == 0 && x == 1 && y == 1 ? 0.0f : 1.0f; });
  scene_.views[0].mask_path = folder_ / "ma.png";
  scene_.views[1].mask_path = folder_ / "mb.png";
  const PhotoSet set = load();
  for (int y = 0; y < 8; ++y) {
    for (int x = 0; x < 8; ++x) {
      EXPECT_EQ(set.photos[0].masked_out(x, y), x < 4);
      EXPECT_EQ(set.photos[1].masked_out(x, y), x >= 4 && y >= 4);
      EXPECT_FALSE(set.photos[2].masked_out(x, y));
    }
  }
  for (const uint8_t m : set.photos[0].mask) EXPECT_TRUE(m == 0 || m == 255);
  EXPECT_TRUE(set.photos[2].mask.empty());
  EXPECT_NEAR(set.fraction_masked, (32 + 16) / 192.0, 1e-12);
  const PhotoSet half = load(2);
  EXPECT_EQ(half.photos[0].mask.size(), 16u);
  EXPECT_TRUE(half.photos[0].masked_out(1, 3));
  EXPECT_FALSE(half.photos[0].masked_out(2, 0));
}

TEST_F(Photos, MasksThatCannotBeMeant) {
  add("a.png", {12, 6, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  scene_.views[0].mask_path = folder_ / "m.png";
  EXPECT_TRUE(contains(error(), "m.png"));  // does not exist
  make_image(folder_ / "m.png", {12, 6, 1, OIIO::TypeDesc::UINT8, {}},
             [](int x, int, int) { return x < 4 ? 1.0f / 255 : 0.0f; });
  EXPECT_TRUE(contains(error(), "multiply the mask by 255"));
  make_image(folder_ / "m.png", {6, 12, 1, OIIO::TypeDesc::UINT8, {}},
             [](int, int, int) { return 1.0f; });
  EXPECT_TRUE(contains(error(), "turned by 90 degrees"));
  make_image(folder_ / "m.png", {12, 6, 1, OIIO::TypeDesc::UINT8, {}},
             [](int, int, int) { return 0.0f; });
  EXPECT_EQ(load().fraction_masked, 1);  // a view may be masked out whole
}

TEST_F(Photos, ResizedPhotoScalesItsCamera) {
  add("a.png", {40, 30, 3, OIIO::TypeDesc::UINT8, {}}, texture, 80, 61);
  const PhotoSet set = load();
  EXPECT_EQ(set.cameras[0].width, 40);
  EXPECT_EQ(set.cameras[0].height, 30);
  EXPECT_NEAR(set.cameras[0].fx(), 50, 1e-12);
  EXPECT_NEAR(set.cameras[0].fy(), 100 * 30 / 61.0, 1e-12);
}

TEST_F(Photos, TransposedPhotoIsAnErrorThatSaysSo) {
  add("a.png", {30, 40, 3, OIIO::TypeDesc::UINT8, {}}, texture, 80, 60);
  const std::string message = error();
  EXPECT_TRUE(contains(message,
                       "a.png: the photo is 30 x 40 pixels and its camera 80 x 60: one of "
                       "them is turned by 90 degrees"));
  EXPECT_TRUE(contains(message, "has no EXIF orientation that says so"));
}

TEST_F(Photos, CroppedPhotoIsAnError) {
  add("a.png", {400, 280, 3, OIIO::TypeDesc::UINT8, {}}, texture, 400, 300);
  EXPECT_TRUE(contains(error(), "it was cropped or belongs to another model"));
}

TEST_F(Photos, TwoPercentOfRatioAreRounding) {
  add("a.png", {400, 295, 3, OIIO::TypeDesc::UINT8, {}}, texture, 400, 300);
  EXPECT_EQ(error(), "");
}

TEST_F(Photos, TruncatedPhotoAmongManyIsNamed) {
  for (int i = 0; i < 8; ++i) {
    add(fmt::format("p{}.jpg", i), {64, 48, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  }
  EXPECT_EQ(error(), "");
  const auto path = folder_ / "p5.jpg";
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 200);
  const std::string message = error();
  EXPECT_TRUE(contains(message, "p5.jpg"));
  EXPECT_TRUE(contains(message, "truncated"));
}

TEST_F(Photos, ResultDoesNotDependOnThreads) {
  for (int i = 0; i < 6; ++i) {
    add(fmt::format("p{}.jpg", i), {61, 47, 3, OIIO::TypeDesc::UINT8, {}},
        [i](int x, int y, int c) { return texture(x + i, y, c); });
  }
  const PhotoSet one = load(2, 1), three = load(2, 3);
  for (size_t i = 0; i < 6; ++i) EXPECT_EQ(one.photos[i].pixels8, three.photos[i].pixels8);
}

TEST_F(Photos, ProgressCountsUpOneAtATime) {
  for (int i = 0; i < 5; ++i) {
    add(fmt::format("p{}.png", i), {16, 16, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  }
  ThreadPool pool(3);
  std::vector<int> calls;
  load_photos(scene_, pool, [&](int done, int total) {
    calls.push_back(done);
    EXPECT_EQ(total, 5);
  });
  EXPECT_EQ(calls, (std::vector<int>{1, 2, 3, 4, 5}));
  EXPECT_THROW(load_photos(scene_, pool, [](int, int) { throw Error("enough"); }), Error);
}

// Of every alpha in either storage.
TEST(Photo, TransparentIsAnAlphaNotAboveZero) {
  Photo bytes, halves, opaque;
  bytes.width = opaque.width = 16;
  bytes.height = opaque.height = 16;
  halves.width = halves.height = 256;
  bytes.channels = halves.channels = 4;
  for (size_t i = 0; i < 256; ++i) {
    bytes.pixels8.insert(bytes.pixels8.end(), {9, 9, 9, static_cast<uint8_t>(i)});
    opaque.pixels8.insert(opaque.pixels8.end(), {0, 0, 0});
  }
  for (size_t i = 0; i < 0x10000; ++i)
    halves.pixels16.insert(halves.pixels16.end(),
                           {0x3c00, 0x3c00, 0x3c00, static_cast<uint16_t>(i)});
  for (const Photo* photo : {&bytes, &halves, &opaque})
    for (int y = 0; y < photo->height; ++y)
      for (int x = 0; x < photo->width; ++x) {
        Real rgba[4];
        photo->pixel(x, y, rgba);
        ASSERT_EQ(photo->transparent(x, y), !(rgba[3] > 0)) << x << ' ' << y;
      }
}

TEST(PhotoMemory, TooManyPhotosAreAnErrorThatSuggestsAScale) {
  internal::PhotoMemory memory;
  const ImageInfo photo{4000, 3000, 3, false};
  for (int i = 0; i < 100; ++i) internal::add_photo(memory, photo, false, 1);
  EXPECT_EQ(memory.kept, 100u * 4000 * 3000 * 3);
  EXPECT_EQ(memory.largest, 4000u * 3000 * 3);
  const uint64_t gigabyte = uint64_t{1} << 30;
  EXPECT_EQ(error_of([&] { internal::check_photo_memory(memory, 2, 4 * gigabyte, 1, "s"); }), "");
  const std::string message =
      error_of([&] { internal::check_photo_memory(memory, 2, gigabyte, 1, "scene"); });
  EXPECT_TRUE(contains(message,
                       "scene: the photos need 3434 MB and their decoding 69 MB, but this "
                       "process may use 1024 MB"));
  EXPECT_TRUE(contains(message, "--downscale 2"));
  // What is suggested fits.
  internal::PhotoMemory half;
  for (int i = 0; i < 100; ++i) internal::add_photo(half, photo, false, 2);
  EXPECT_EQ(error_of([&] { internal::check_photo_memory(half, 2, gigabyte, 2, "s"); }), "");
  // Where not even one photo per thread fits, no scale helps.
  EXPECT_TRUE(contains(
      error_of([&] { internal::check_photo_memory(memory, 64, gigabyte, 1, "s"); }), "--threads"));
}

TEST(PhotoMemory, DepthAlphaAndMasksCount) {
  internal::PhotoMemory memory;
  internal::add_photo(memory, {10, 10, 1, false}, true, 1);
  EXPECT_EQ(memory.kept, 400u);
  internal::add_photo(memory, {10, 10, 4, true}, false, 2);
  EXPECT_EQ(memory.kept, 400u + 25 * 8);
  EXPECT_EQ(memory.largest, 800u);
}

}  // namespace
}  // namespace nerf
