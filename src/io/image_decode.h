// A whole image file in memory in the precision that it is stored in.
#pragma once

#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

namespace nerf::internal {

enum class SampleType {
  k8,     // integers, 255 = 1
  k16,    // integers, 65535 = 1
  kHalf,  // half floats
};

struct StoredImage {
  int width = 0, height = 0;
  int channels = 0;            // 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha
  bool premultiplied = false;  // colour is multiplied by alpha
  SampleType type = SampleType::k8;
  std::vector<uint8_t> samples8;    // k8
  std::vector<uint16_t> samples16;  // k16, kHalf: integers or bits

  bool has_alpha() const { return channels == 2 || channels == 4; }
  float sample(size_t i) const;  // as a number, 1 = full
};

// Extensions (".heic", ".dng") of the formats that only cameras and phones write, HEIF, AVIF, JPEG
// XL and raw data: those of them that this OpenImageIO reads.
std::set<std::string> readable_camera_formats();

// Throws Error: see read_image_8bit in nerf/io/image.h.
StoredImage decode_image(const std::filesystem::path& path);
// The same of a PNG or JPEG file's bytes; `name` is what an Error calls it.
StoredImage decode_image(std::vector<uint8_t> bytes, const std::string& name);

// One channel as numbers, integers as they are: of several the one named Z (any case), else the
// first.
struct StoredChannel {
  int width = 0, height = 0;
  int channels = 0;  // of the file
  int bits = 0;      // of a number in the file
  bool integers = false;
  std::vector<float> values;
};
StoredChannel decode_channel(const std::filesystem::path& path);

}  // namespace nerf::internal
