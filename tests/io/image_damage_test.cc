// Truncated and corrupt image files: an Error that names the file, or the whole picture.
#include <fstream>

#include "nerf/base/file.h"
#include "nerf/base/memory.h"
#include "nerf/io/image.h"
#include "test_images.h"

namespace nerf {
namespace {

using test::contains;
using test::error_of;
using test::make_image;
using test::TempFolder;
using test::texture;

struct Kind {
  const char* name;
  const char* file;
  OIIO::TypeDesc type = OIIO::TypeDesc::UINT8;
  const char* attribute = nullptr;
  int value = 0;
};

const Kind kJpeg{"jpeg", "a.jpg"};
const Kind kProgressiveJpeg{"progressive_jpeg", "a.jpg", OIIO::TypeDesc::UINT8, "jpeg:progressive",
                            1};
const Kind kPng{"png", "a.png"};
const Kind kPng16{"png16", "a.png", OIIO::TypeDesc::UINT16};
const Kind kKinds[] = {
    kJpeg,
    kProgressiveJpeg,
    kPng,
    kPng16,
    {"tiff", "a.tif"},
    {"exr", "a.exr", OIIO::TypeDesc::HALF},
    {"bmp", "a.bmp"},
    {"ppm", "a.ppm"},
    {"tga", "a.tga"},
    {"webp", "a.webp"},
    {"hdr", "a.hdr", OIIO::TypeDesc::FLOAT},
};

class Damage : public ::testing::TestWithParam<Kind> {
 protected:
  void SetUp() override {
    path_ = folder_ / GetParam().file;
    make_image(path_,
               {67, 43, 3, GetParam().type,
                [](OIIO::ImageSpec& spec) {
                  if (GetParam().attribute) spec.attribute(GetParam().attribute, GetParam().value);
                }},
               texture);
    bytes_ = read_file(path_);
    whole_ = read_image_8bit(path_).pixels;
    ASSERT_EQ(whole_.size(), 67u * 43 * 3);
    ASSERT_EQ(error_of([&] { check_image_complete(path_); }), "");
  }
  // Every length near both ends and some between.
  std::vector<size_t> lengths() const {
    std::vector<size_t> result;
    for (size_t n = 0; n < bytes_.size();) {
      result.push_back(n);
      const bool near_end = n < 64 || bytes_.size() - n <= 64;
      n = near_end ? n + 1 : std::min(n + 1 + bytes_.size() / 97, bytes_.size() - 64);
    }
    return result;
  }

  // Not atomically: syncing thousands of files takes minutes.
  void put(std::span<const uint8_t> bytes) const {
    std::ofstream(path_, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  }

  TempFolder folder_;
  std::filesystem::path path_;
  std::vector<uint8_t> bytes_, whole_;
};

class DamageToEnds : public Damage {};  // formats whose end is marked
class DamageToPng : public Damage {};
class DamageToJpeg : public Damage {};

TEST_P(Damage, EveryPrefixIsAnErrorOrTheWholePicture) {
  int errors = 0;
  for (const size_t length : lengths()) {
    put(std::span<const uint8_t>(bytes_).first(length));
    std::vector<uint8_t> pixels;
    const std::string error = error_of([&] { pixels = read_image_8bit(path_).pixels; });
    if (error.empty()) {
      ASSERT_EQ(pixels, whole_) << GetParam().name << ", first " << length << " of "
                                << bytes_.size() << " bytes";
    } else {
      ++errors;
      EXPECT_TRUE(contains(error, path_.string()));
    }
    error_of([&] { read_image_info(path_); });
  }
  EXPECT_GT(errors, 100);
}

TEST_P(DamageToEnds, AreErrors) {
  for (const size_t length : lengths()) {
    put(std::span<const uint8_t>(bytes_).first(length));
    EXPECT_NE(error_of([&] { read_image_8bit(path_); }), "") << length;
    if (length < 8) continue;  // no kind to recognise
    EXPECT_TRUE(contains(error_of([&] { check_image_complete(path_); }),
                         "is truncated: it ends at byte " + std::to_string(length)));
    // The header alone may be whole, but nothing is printed about a broken one.
    testing::internal::CaptureStderr();
    error_of([&] { read_image_info(path_); });
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  }
}

TEST_P(DamageToPng, EveryFlippedBitOfPixelsIsFound) {
  testing::internal::CaptureStderr();
  for (size_t at = 0; at < bytes_.size() - 12; at += at < 64 ? 1 : 37) {
    std::vector<uint8_t> damaged = bytes_;
    damaged[at] ^= static_cast<uint8_t>(1 << at % 8);
    put(damaged);
    std::vector<uint8_t> pixels = whole_;
    const std::string error = error_of([&] { pixels = read_image_8bit(path_).pixels; });
    EXPECT_TRUE(!error.empty() || pixels == whole_) << at;  // in what can be left out
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

// A JPEG cut in the middle and closed again has an end marker, but not the picture.
TEST_P(DamageToJpeg, AHoleIsAnError) {
  std::vector<uint8_t> cut(bytes_.begin(), bytes_.begin() + static_cast<long>(bytes_.size() / 2));
  while (cut.back() == 0xff) cut.pop_back();
  cut.push_back(0xff);
  cut.push_back(0xd9);
  put(cut);
  EXPECT_TRUE(contains(error_of([&] { read_image_8bit(path_); }), "cannot read the image"));
}

TEST_P(DamageToJpeg, EndOfAnEmbeddedThumbnailDoesNotCount) {
  // The same file as the content of an application segment of itself, then cut.
  std::vector<uint8_t> outer(bytes_.begin(), bytes_.begin() + 2);
  const size_t length = bytes_.size() + 2;
  ASSERT_LT(length, 65536u);
  for (const size_t v : {size_t{0xff}, size_t{0xe5}, length >> 8, length & 255}) {
    outer.push_back(static_cast<uint8_t>(v));
  }
  outer.insert(outer.end(), bytes_.begin(), bytes_.end());
  outer.insert(outer.end(), bytes_.begin() + 2, bytes_.end());
  put(outer);
  EXPECT_EQ(read_image_8bit(path_).pixels, whole_);
  for (const size_t cut : {size_t{1}, size_t{2}, bytes_.size() / 2, bytes_.size() - 2}) {
    put(std::span<const uint8_t>(outer).first(outer.size() - cut));
    EXPECT_TRUE(contains(error_of([&] { read_image_8bit(path_); }), "truncated")) << cut;
  }
  // Behind the end anything may follow: phones append films and depth.
  outer.insert(outer.end(), 1000, 0xff);
  put(outer);
  EXPECT_EQ(read_image_8bit(path_).pixels, whole_);
}

TEST_P(Damage, FlippedBytesNeverCrash) {
  const size_t step = std::max<size_t>(1, bytes_.size() / 400);
  for (size_t at = 0; at < bytes_.size(); at += at < 128 ? 1 : step) {
    std::vector<uint8_t> damaged = bytes_;
    damaged[at] ^= static_cast<uint8_t>(at % 3 == 0 ? 0xff : 1 << at % 8);
    put(damaged);
    try {
      const Image8 image = read_image_8bit(path_);
      EXPECT_EQ(image.pixels.size(), static_cast<size_t>(image.width) *
                                         static_cast<size_t>(image.height) *
                                         static_cast<size_t>(image.channels));
    } catch (const Error& error) {
      EXPECT_TRUE(contains(error.what(), path_.string()));
    }
  }
  EXPECT_LT(peak_memory_bytes(), uint64_t{1} << 30);
}

std::string kind_name(const ::testing::TestParamInfo<Kind>& info) { return info.param.name; }

INSTANTIATE_TEST_SUITE_P(All, Damage, ::testing::ValuesIn(kKinds), kind_name);
INSTANTIATE_TEST_SUITE_P(All, DamageToEnds,
                         ::testing::Values(kJpeg, kProgressiveJpeg, kPng, kPng16), kind_name);
INSTANTIATE_TEST_SUITE_P(All, DamageToPng, ::testing::Values(kPng), kind_name);
INSTANTIATE_TEST_SUITE_P(All, DamageToJpeg, ::testing::Values(kJpeg), kind_name);

TEST(DamagedHeader, AbsurdSizesAreRefusedBeforeMemoryIsAskedFor) {
  const TempFolder folder;
  // A PPM of a few bytes that claims 60000 x 60000, 1 x 2^30 and 17000 x 17000 pixels.
  for (const char* size : {"60000 60000", "1 1073741824", "17000 17000"}) {
    write_file_atomically(folder / "a.ppm", std::string("P6\n") + size + "\n255\n" + "abc");
    EXPECT_TRUE(contains(error_of([&] { read_image_info(folder / "a.ppm"); }), "the image says"));
    EXPECT_TRUE(contains(error_of([&] { read_image_8bit(folder / "a.ppm"); }), "the image says"));
  }
  EXPECT_LT(peak_memory_bytes(), uint64_t{1} << 30);
}

}  // namespace
}  // namespace nerf
