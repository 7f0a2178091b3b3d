#include "nerf/io/image.h"

#include <cmath>
#include <fstream>
#include <limits>

#include "io/half.h"
#include "nerf/base/file.h"
#include "nerf/base/threads.h"
#include "test_images.h"

namespace nerf {
namespace {

using test::contains;
using test::error_of;
using test::ImageFile;
using test::make_image;
using test::TempFolder;
using test::texture;

uint8_t byte(float value) { return static_cast<uint8_t>(value * 255 + 0.5f); }

TEST(Half, EveryValueSurvivesAndRoundingIsToNearestEven) {
  const FlushDenormals flush;  // as in the threads that decode
  for (uint32_t bits = 0; bits < 0x10000; ++bits) {
    const auto half = static_cast<uint16_t>(bits);
    const float value = internal::half_to_float(half);
    const int exponent = half >> 10 & 31, fraction = half & 1023;
    if (exponent == 31) {
      EXPECT_EQ(std::isnan(value), fraction != 0);
      continue;
    }
    const double expected =
        (half & 0x8000 ? -1 : 1) *
        (exponent ? std::ldexp(1024 + fraction, exponent - 25) : std::ldexp(fraction, -24));
    ASSERT_EQ(value, expected) << bits;
    ASSERT_EQ(internal::float_to_half(value), half) << bits;
    // Half way to the next value goes to the even one, anything beyond to the next.
    if ((half & 0x7fff) >= 0x7bff) continue;
    const float next = internal::half_to_float(static_cast<uint16_t>(half + 1));
    const float middle = (value + next) / 2;
    ASSERT_EQ(internal::float_to_half(middle), half + (half & 1)) << bits;
    ASSERT_EQ(internal::float_to_half(std::nextafter(middle, next)), half + 1) << bits;
    ASSERT_EQ(internal::float_to_half(std::nextafter(middle, value)), half) << bits;
  }
  const float infinity = std::numeric_limits<float>::infinity();
  EXPECT_EQ(internal::half_to_float(internal::float_to_half(1e6f)), 65504.0f);
  EXPECT_EQ(internal::half_to_float(internal::float_to_half(-infinity)), -65504.0f);
  EXPECT_TRUE(std::isnan(internal::half_to_float(internal::float_to_half(std::nanf("")))));
}

TEST(Image, JpegBytesAreAPictureOfTheirQuality) {
  const TempFolder folder;
  Image8 image{64, 48, 3, {}};
  for (int i = 0; i < 64 * 48; ++i)
    for (int k = 0; k < 3; ++k)
      image.pixels.push_back(static_cast<uint8_t>(128 + 100 * std::sin(0.1 * i + k)));
  const auto fine = jpeg_bytes(image, 95), coarse = jpeg_bytes(image, 40);
  EXPECT_LT(coarse.size(), 0.8 * static_cast<double>(fine.size()));
  write_file_atomically(folder / "a.jpg", std::span<const uint8_t>(fine));
  const Image8 read = read_image_8bit(folder / "a.jpg");
  ASSERT_EQ(read.pixels.size(), image.pixels.size());
  EXPECT_EQ(read.width, 64);
  double sum = 0;
  for (size_t i = 0; i < read.pixels.size(); ++i)
    sum += std::abs(int{read.pixels[i]} - int{image.pixels[i]});
  EXPECT_LT(sum / static_cast<double>(read.pixels.size()), 12);
}

TEST(Image, PngGivesBackWhatWasWritten) {
  const TempFolder folder;
  for (int channels = 1; channels <= 4; ++channels) {
    Image8 image{7, 5, channels, {}};
    for (int i = 0; i < 7 * 5 * channels; ++i) {
      image.pixels.push_back(static_cast<uint8_t>(i * 37 % 256));
    }
    write_image(folder / "a.png", image);
    const ImageInfo info = read_image_info(folder / "a.png");
    EXPECT_EQ(info.width, 7);
    EXPECT_EQ(info.height, 5);
    EXPECT_EQ(info.channels, channels);
    EXPECT_FALSE(info.half_or_16bit);
    const Image8 read = read_image_8bit(folder / "a.png");
    EXPECT_EQ(read.channels, channels);
    EXPECT_EQ(read.pixels, image.pixels) << channels;  // alpha straight: colour 37 at alpha 0 stays
  }
  EXPECT_EQ(folder.files(), 1);
}

TEST(Image, JpegIsNearAndDropsAlpha) {
  const TempFolder folder;
  Image8 image{32, 16, 4, {}};
  for (int i = 0; i < 32 * 16; ++i) {
    for (int v : {i % 32 * 6, 90, 200, 0}) image.pixels.push_back(static_cast<uint8_t>(v));
  }
  write_image(folder / "a.JPG", image);
  const Image8 read = read_image_8bit(folder / "a.JPG");
  ASSERT_EQ(read.channels, 3);
  for (size_t i = 0; i < 32 * 16; ++i) {
    for (size_t c = 0; c < 3; ++c) {
      ASSERT_NEAR(read.pixels[i * 3 + c], image.pixels[i * 4 + c], 12) << i;
    }
  }
}

TEST(Image, OrientationIsNotApplied) {
  const TempFolder folder;
  const auto sideways = [](OIIO::ImageSpec& spec) { spec.attribute("Orientation", 6); };
  for (const char* name : {"a.jpg", "a.tif"}) {
    make_image(folder / name, {24, 16, 3, OIIO::TypeDesc::UINT8, sideways},
               [](int x, int, int) { return x < 12 ? 1.0f : 0.0f; });
    EXPECT_EQ(read_image_info(folder / name).width, 24);
    const Image8 image = read_image_8bit(folder / name);
    EXPECT_EQ(image.width, 24);
    EXPECT_GT(image.pixels[0], 250);
    EXPECT_LT(image.pixels[23 * 3], 5);
  }
  // The tag is really in the file.
  const auto in = OIIO::ImageInput::open((folder / "a.jpg").string());
  EXPECT_EQ(in->spec().get_int_attribute("Orientation"), 6);
}

TEST(Image, SixteenBitsAndFloatAreRecognised) {
  const TempFolder folder;
  const auto ramp = [](int x, int y, int) { return static_cast<float>(y * 40 + x) / 1000; };
  for (const auto& [name, type] :
       {std::pair{"a.png", OIIO::TypeDesc::UINT16}, std::pair{"a.tif", OIIO::TypeDesc::UINT16},
        std::pair{"a.exr", OIIO::TypeDesc::HALF}, std::pair{"b.exr", OIIO::TypeDesc::FLOAT},
        std::pair{"b.tif", OIIO::TypeDesc::FLOAT}}) {
    make_image(folder / name, {40, 20, 3, type, {}}, ramp);
    EXPECT_TRUE(read_image_info(folder / name).half_or_16bit) << name;
    const ImageF image = read_image_float(folder / name);
    for (int y = 0; y < 20; ++y) {
      for (int x = 0; x < 40; ++x) {
        ASSERT_NEAR(image.at(x, y)[1], ramp(x, y, 1), 4e-4) << name;  // half's last place below 1
      }
    }
    EXPECT_EQ(read_image_8bit(folder / name).pixels[40 * 3], byte(0.04f)) << name;
  }
}

TEST(Image, ChannelsAreFoundByTheirNames) {
  const TempFolder folder;
  make_image(folder / "a.exr",
             {8, 8, 6, OIIO::TypeDesc::FLOAT,
              [](OIIO::ImageSpec& spec) {
                spec.channelnames = {"depth.Z", "B", "noise", "G", "A", "R"};
                spec.alpha_channel = 4;
                spec.attribute("oiio:UnassociatedAlpha", 0);
              }},
             [](int, int, int c) { return c == 4 ? 1.0f : static_cast<float>(c + 1) / 16; });
  EXPECT_EQ(read_image_info(folder / "a.exr").channels, 4);
  const ImageF image = read_image_float(folder / "a.exr");
  ASSERT_EQ(image.channels, 4);
  EXPECT_EQ(image.at(3, 3)[0], 6.0f / 16);
  EXPECT_EQ(image.at(3, 3)[1], 4.0f / 16);
  EXPECT_EQ(image.at(3, 3)[2], 2.0f / 16);
  EXPECT_EQ(image.at(3, 3)[3], 1.0f);
}

TEST(Image, AlphaIsStraightWhateverTheFileStores) {
  const TempFolder folder;
  const auto pixel = [](int x, int, int c) { return c == 3 ? (x < 4 ? 0.5f : 1.0f) : 0.75f; };
  // OpenEXR stores premultiplied colour, so the maker multiplies.
  make_image(folder / "a.exr", {8, 8, 4, OIIO::TypeDesc::HALF, {}}, [&](int x, int y, int c) {
    return c == 3 ? pixel(x, y, 3) : pixel(x, y, c) * pixel(x, y, 3);
  });
  for (const char* name : {"a.png", "a.tif"}) {
    make_image(folder / name, {8, 8, 4, OIIO::TypeDesc::UINT8, {}}, pixel);
  }
  make_image(folder / "b.tif",
             {8, 8, 4, OIIO::TypeDesc::UINT8,
              [](OIIO::ImageSpec& spec) { spec.erase_attribute("oiio:UnassociatedAlpha"); }},
             [&](int x, int y, int c) {
               return c == 3 ? pixel(x, y, 3) : pixel(x, y, c) * pixel(x, y, 3);
             });
  for (const char* name : {"a.exr", "a.png", "a.tif", "b.tif"}) {
    const Image8 image = read_image_8bit(folder / name);
    ASSERT_EQ(image.channels, 4) << name;
    EXPECT_NEAR(image.pixels[0], 191, 1) << name;
    EXPECT_NEAR(image.pixels[3], 128, 1) << name;
    EXPECT_NEAR(image.pixels[4 * 4], 191, 1) << name;
    EXPECT_EQ(image.pixels[4 * 4 + 3], 255) << name;
  }
}

TEST(Image, WrongExtensionIsNoProblem) {
  const TempFolder folder;
  make_image(folder / "a.jpg", {40, 24, 3, OIIO::TypeDesc::UINT8, {}}, texture);
  std::filesystem::rename(folder / "a.jpg", folder / "a.png");
  EXPECT_EQ(read_image_info(folder / "a.png").width, 40);
  EXPECT_EQ(read_image_8bit(folder / "a.png").width, 40);
}

TEST(Image, RoundsAndClamps) {
  ImageF image{6, 1, 1, {-1, 0.5f / 255 - 1e-4f, 0.5f / 255 + 1e-4f, 0.71f, 2, std::nanf("")}};
  EXPECT_EQ(to_8bit(image).pixels, (std::vector<uint8_t>{0, 0, 1, 181, 255, 0}));
}

TEST(Image, UnreadableFilesAreErrorsThatNameThem) {
  const TempFolder folder;
  write_file_atomically(folder / "text.png", "this is not a picture");
  write_file_atomically(folder / "empty.jpg", "");
  std::filesystem::create_directory(folder / "folder.png");
  for (const char* name : {"none.png", "text.png", "empty.jpg", "folder.png"}) {
    EXPECT_TRUE(contains(error_of([&] { read_image_info(folder / name); }), name));
    EXPECT_TRUE(contains(error_of([&] { read_image_8bit(folder / name); }), name));
  }
  EXPECT_TRUE(contains(error_of([&] { read_image_8bit(folder / "none.png"); }), "No such file"));
  EXPECT_TRUE(contains(error_of([&] { read_image_8bit(folder / "folder.png"); }), "is a folder"));
}

TEST(Image, UnwritableOutputIsAnErrorAndLeavesNothing) {
  const TempFolder folder;
  const Image8 image{2, 2, 3, std::vector<uint8_t>(12)};
  EXPECT_TRUE(
      contains(error_of([&] { write_image(folder / "no" / "a.png", image); }), "No such file"));
  EXPECT_TRUE(contains(error_of([&] { write_image(folder / "a.bmp", image); }), "use .png"));
  std::filesystem::create_directory(folder / "a.png");
  EXPECT_TRUE(contains(error_of([&] { write_image(folder / "a.png", image); }), "folder"));
  EXPECT_EQ(folder.files(), 1);
}

}  // namespace
}  // namespace nerf
