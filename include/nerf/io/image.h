// Images in memory and on disk (through OpenImageIO).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace nerf {

// Float image, rows from the top, channels interleaved.
struct ImageF {
  int width = 0, height = 0, channels = 0;
  std::vector<float> pixels;
  float* at(int x, int y) {
    return pixels.data() + (static_cast<size_t>(y) * width + x) * channels;
  }
  const float* at(int x, int y) const {
    return pixels.data() + (static_cast<size_t>(y) * width + x) * channels;
  }
};

// 8-bit image, rows from the top, channels interleaved.
struct Image8 {
  int width = 0, height = 0, channels = 0;
  std::vector<uint8_t> pixels;
};

struct ImageInfo {
  int width = 0, height = 0, channels = 0;
  bool half_or_16bit = false;  // anything that 8 bits would cut
};

// Reads only the header. Throws Error.
ImageInfo read_image_info(const std::filesystem::path& path);

// Round to nearest, values clamped to [0, 1].
Image8 to_8bit(const ImageF& image);

// PNG or JPEG by extension, written atomically. Throws Error.
void write_image(const std::filesystem::path& path, const Image8& image);

}  // namespace nerf
