// For tests: image files of any type, made through OpenImageIO.
#pragma once

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "support/temp_folder.h"

namespace nerf::test {

struct ImageFile {
  int width = 0, height = 0, channels = 3;
  OIIO::TypeDesc type = OIIO::TypeDesc::UINT8;
  std::function<void(OIIO::ImageSpec&)> adjust;  // attributes, channel names
};

// pixel(x, y, channel) in [0, 1] (or any number for float types); integers are rounded from it.
// Alpha is written as straight.
inline void make_image(const std::filesystem::path& path, const ImageFile& file,
                       const std::function<float(int x, int y, int c)>& pixel) {
  OIIO::ImageSpec spec(file.width, file.height, file.channels, file.type);
  if (file.channels == 2) spec.alpha_channel = 1;
  spec.attribute("oiio:UnassociatedAlpha", 1);
  spec.attribute("Compression", "jpeg:98");
  if (path.extension() == ".exr") spec.attribute("Compression", "zip");
  if (path.extension() == ".tif") spec.attribute("Compression", "lzw");
  if (file.adjust) file.adjust(spec);
  std::vector<float> pixels;
  for (int y = 0; y < file.height; ++y) {
    for (int x = 0; x < file.width; ++x) {
      for (int c = 0; c < file.channels; ++c) pixels.push_back(pixel(x, y, c));
    }
  }
  const auto out = OIIO::ImageOutput::create(path.string());
  ASSERT_TRUE(out) << OIIO::geterror();
  ASSERT_TRUE(out->open(path.string(), spec)) << out->geterror();
  ASSERT_TRUE(out->write_image(OIIO::TypeDesc::FLOAT, pixels.data())) << out->geterror();
  ASSERT_TRUE(out->close()) << out->geterror();
}

// Some picture with fine and coarse detail, different in every channel.
inline float texture(int x, int y, int c) {
  const int mixed = (x * 7 + y * 13 + c * 31 + (x * y) % 17 + (x ^ y)) % 256;
  return static_cast<float>(mixed) / 255.0f;
}

}  // namespace nerf::test
