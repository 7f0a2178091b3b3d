#include "image_complete.h"

#include <algorithm>
#include <cstring>
#include <filesystem>

#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/io/image.h"

namespace nerf {
namespace internal {
namespace {

constexpr uint8_t kPngSignature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};

std::string truncated(size_t size) {
  return "is truncated: it ends at byte " + std::to_string(size) + ", before its end marker";
}

}  // namespace

ImageFileKind image_file_kind(std::span<const uint8_t> bytes) {
  if (bytes.size() >= 3 && bytes[0] == 0xff && bytes[1] == 0xd8 && bytes[2] == 0xff) {
    return ImageFileKind::kJpeg;
  }
  if (bytes.size() >= 8 && std::equal(kPngSignature, kPngSignature + 8, bytes.begin())) {
    return ImageFileKind::kPng;
  }
  return ImageFileKind::kOther;
}

std::optional<std::string> jpeg_problem(std::span<const uint8_t> bytes) {
  size_t at = 2;  // behind SOI
  bool has_scan = false;
  for (;;) {
    // Between segments: a marker, possibly after fill bytes 0xff. Anything else is skipped, as
    // decoders do. Within the coded data of a scan this same search finds the next marker.
    const void* found =
        at < bytes.size() ? std::memchr(bytes.data() + at, 0xff, bytes.size() - at) : nullptr;
    if (found == nullptr) return truncated(bytes.size());
    at = static_cast<size_t>(static_cast<const uint8_t*>(found) - bytes.data());
    while (at < bytes.size() && bytes[at] == 0xff) ++at;
    if (at >= bytes.size()) return truncated(bytes.size());
    const uint8_t marker = bytes[at++];
    // 0 is an escaped 0xff of the data, 0xd0-0xd7 are restarts, 1 is TEM: none has a length.
    if (marker <= 0x01 || (marker >= 0xd0 && marker <= 0xd8)) continue;
    if (marker == 0xd9) {
      if (has_scan) return std::nullopt;
      return "is corrupt: it ends at byte " + std::to_string(at) + " before any picture";
    }
    if (bytes.size() - at < 2) return truncated(bytes.size());
    const size_t length = static_cast<size_t>(bytes[at] << 8 | bytes[at + 1]);
    if (length < 2) {
      return "is corrupt: a segment of impossible length at byte " + std::to_string(at);
    }
    if (length > bytes.size() - at) return truncated(bytes.size());
    has_scan = has_scan || marker == 0xda;
    at += length;
  }
}

std::optional<std::string> png_problem(std::span<const uint8_t> bytes) {
  for (size_t at = 8;;) {
    // Length, type, data, checksum (which libpng verifies).
    if (bytes.size() - at < 12) return truncated(bytes.size());
    const uint8_t* chunk = bytes.data() + at;
    const uint32_t length = uint32_t{chunk[0]} << 24 | uint32_t{chunk[1]} << 16 |
                            uint32_t{chunk[2]} << 8 | uint32_t{chunk[3]};
    if (length > bytes.size() - at - 12) return truncated(bytes.size());
    if (std::memcmp(chunk + 4, "IEND", 4) == 0) return std::nullopt;
    at += size_t{length} + 12;
  }
}

}  // namespace internal

void check_image_complete(const std::filesystem::path& path) {
  const std::vector<uint8_t> bytes = read_file(path);
  std::optional<std::string> problem;
  switch (internal::image_file_kind(bytes)) {
    case internal::ImageFileKind::kJpeg:
      problem = internal::jpeg_problem(bytes);
      break;
    case internal::ImageFileKind::kPng:
      problem = internal::png_problem(bytes);
      break;
    case internal::ImageFileKind::kOther:
      break;
  }
  if (problem) {
    throw Error("the image " + *problem, path.string(), "copy it again from its source");
  }
}

}  // namespace nerf
