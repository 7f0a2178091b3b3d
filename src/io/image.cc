#include "nerf/io/image.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <type_traits>

#include "image_decode.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "paths.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;

std::string writer_for(const fs::path& path) {
  const std::string extension = internal::lower_extension(path);
  if (extension == ".png") return "png";
  if (extension == ".jpg" || extension == ".jpeg") return "jpeg";
  throw Error("cannot write an image of type '" + extension + "'", path.string(),
              "use .png, .jpg or .jpeg");
}

// Encoded in memory, so that what reaches the disk is one plain write with a plain errno.
template <class Image>
std::vector<unsigned char> encode(const std::string& format, const fs::path& path,
                                  const Image& image, int jpeg_quality = 95) {
  constexpr bool kDeep = std::is_same_v<Image, Image16>;
  constexpr auto kType = kDeep ? OIIO::TypeDesc::UINT16 : OIIO::TypeDesc::UINT8;
  // Before the writer, which may still write when it is closed by its destructor.
  std::vector<unsigned char> bytes;
  OIIO::Filesystem::IOVecOutput sink(bytes);
  const auto out = OIIO::ImageOutput::create(format);
  if (!out) throw Error("cannot write: " + OIIO::geterror(), path.string());
  const int channels =
      format == "jpeg" && image.channels % 2 == 0 ? image.channels - 1 : image.channels;
  OIIO::ImageSpec spec(image.width, image.height, channels, kType);
  if (channels % 2 == 0) {
    spec.alpha_channel = channels - 1;
    spec.attribute("oiio:UnassociatedAlpha", 1);
  }
  if (format == "jpeg") spec.attribute("Compression", "jpeg:" + std::to_string(jpeg_quality));
  // A tenth more bytes than zlib's usual 6, in a fifth of its time, which was a third of a film's.
  if (format == "png") spec.attribute("png:compressionLevel", 2);
  if (!out->set_ioproxy(&sink) || !out->open(path.string(), spec) ||
      !out->write_image(kType, image.pixels.data(),
                        image.channels * static_cast<int>(sizeof(image.pixels[0]))) ||
      !out->close()) {
    throw Error("cannot write: " + out->geterror(), path.string());
  }
  return bytes;
}

ImageF to_float(const internal::StoredImage& stored) {
  ImageF image{stored.width, stored.height, stored.channels, {}};
  const size_t count = std::max(stored.samples8.size(), stored.samples16.size());
  image.pixels.resize(count);
  for (size_t i = 0; i < count; ++i) image.pixels[i] = stored.sample(i);
  if (stored.premultiplied) {
    const auto channels = static_cast<size_t>(stored.channels);
    for (size_t i = 0; i < count; i += channels) {
      const Real alpha = image.pixels[i + channels - 1];
      for (size_t c = 0; alpha > 0 && c + 1 < channels; ++c) image.pixels[i + c] /= alpha;
    }
  }
  return image;
}

}  // namespace

Image8 read_image_8bit(const fs::path& path) {
  internal::StoredImage stored = internal::decode_image(path);
  Image8 image{stored.width, stored.height, stored.channels, {}};
  if (stored.type == internal::SampleType::k8 && !stored.premultiplied) {
    image.pixels = std::move(stored.samples8);
    return image;
  }
  return to_8bit(to_float(stored));
}

ImageF read_image_float(const fs::path& path) { return to_float(internal::decode_image(path)); }

Image8 to_8bit(const ImageF& image) {
  Image8 result{image.width, image.height, image.channels, {}};
  result.pixels.resize(image.pixels.size());
  std::transform(image.pixels.begin(), image.pixels.end(), result.pixels.begin(), [](Real v) {
    // Written so that a value that is not a number fails the first comparison.
    const Real clamped = v > 0 ? std::min(v, 1.0_r) : 0.0_r;
    return static_cast<uint8_t>(clamped * 255.0_r + 0.5_r);
  });
  return result;
}

namespace {

template <class Image>
void check_image(const Image& image) {
  NERF_CHECK_GT(image.width, 0);
  NERF_CHECK_GT(image.height, 0);
  NERF_CHECK(image.channels >= 1 && image.channels <= 4);
  NERF_CHECK_EQ(image.pixels.size(), static_cast<size_t>(image.width) *
                                         static_cast<size_t>(image.height) *
                                         static_cast<size_t>(image.channels));
}

template <class Image>
void write_encoded(const fs::path& path, const std::string& format, const Image& image) {
  check_image(image);
  write_file_atomically(path, std::span<const uint8_t>(encode(format, path, image)));
}

}  // namespace

void write_image(const fs::path& path, const Image8& image) {
  write_encoded(path, writer_for(path), image);
}

std::vector<uint8_t> jpeg_bytes(const Image8& image, int quality) {
  check_image(image);
  return encode("jpeg", "picture.jpg", image, quality);
}

void write_image(const fs::path& path, const Image16& image) {
  const std::string format = writer_for(path);
  if (format != "png") throw Error("only PNG holds 16 bits", path.string(), "use .png");
  write_encoded(path, format, image);
}

}  // namespace nerf
