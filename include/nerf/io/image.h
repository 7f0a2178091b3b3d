// Images in memory and on disk (through OpenImageIO). Pixels are taken as stored: EXIF orientation
// is told and not applied (HEIF's and raw files' own turning is part of their decoding), colour is
// not converted, alpha stays straight (not premultiplied).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "nerf/base/real.h"

namespace nerf {

// Image of numbers, rows from the top, channels interleaved.
struct ImageF {
  int width = 0, height = 0, channels = 0;
  std::vector<Real> pixels;
  Real* at(int x, int y) { return pixels.data() + (static_cast<size_t>(y) * width + x) * channels; }
  const Real* at(int x, int y) const {
    return pixels.data() + (static_cast<size_t>(y) * width + x) * channels;
  }
};

// 8-bit image, rows from the top, channels interleaved.
struct Image8 {
  int width = 0, height = 0, channels = 0;
  std::vector<uint8_t> pixels;
};

// 16-bit image, likewise.
struct Image16 {
  int width = 0, height = 0, channels = 0;
  std::vector<uint16_t> pixels;
};

// What a camera says (EXIF) of how much light it let in, and what it was. 0 or empty: not said.
struct ShotTags {
  double seconds = 0;      // of exposure
  double aperture = 0;     // f-number
  double sensitivity = 0;  // ISO
  std::string camera;      // "Maker Model, lens, 4.2 mm", for a person
  std::string nonsense;    // the first of what was said and cannot be: "an exposure time of -1 s"
};

struct ImageInfo {
  // Channels that are used: 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha.
  int width = 0, height = 0, channels = 0;
  bool half_or_16bit = false;  // anything that 8 bits would cut
  // EXIF's: where the first row and column belong when the image is shown. 1 as stored, 2 mirrored,
  // 3 upside down, 6 and 8 to be turned clockwise and counterclockwise, 5 and 7 mirrored as well.
  int orientation = 1;
  bool lies_on_its_side() const { return orientation >= 5; }
  ShotTags shot = {};
};

// Reads only the header. Throws Error: missing, not an image, sizes that no photo has.
ImageInfo read_image_info(const std::filesystem::path& path);

// Reads an image with the channels of its ImageInfo. 8-bit: deeper files are rounded, values
// clamped to [0, 1]. Float: integers are scaled to [0, 1]. Throws Error: missing, not an image,
// truncated or corrupt, a size that no photo has or that the file's length cannot hold.
Image8 read_image_8bit(const std::filesystem::path& path);
ImageF read_image_float(const std::filesystem::path& path);

// Whether a JPEG or PNG ends where its format says it must (other formats are not looked at):
// OpenImageIO can return half of a photo without an error. Throws Error for a truncated file.
// Decodes nothing, so it is fast.
void check_image_complete(const std::filesystem::path& path);

// Round to nearest, values clamped to [0, 1] (not a number gives 0).
Image8 to_8bit(const ImageF& image);

// PNG or JPEG by extension, written atomically, 1 to 4 channels. JPEG has no alpha: it is left out.
// Throws Error.
void write_image(const std::filesystem::path& path, const Image8& image);
// The bytes of a JPEG of `quality` 1 to 100, for a picture within another file. Alpha is left out.
std::vector<uint8_t> jpeg_bytes(const Image8& image, int quality);
// PNG alone, 16 bits a channel, written likewise.
void write_image(const std::filesystem::path& path, const Image16& image);

}  // namespace nerf
