#include "image_complete.h"

#include <zlib.h>

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

uint32_t big_endian(const uint8_t* p) {
  return uint32_t{p[0]} << 24 | uint32_t{p[1]} << 16 | uint32_t{p[2]} << 8 | uint32_t{p[3]};
}

std::string truncated(uint64_t size) {
  return "is truncated: it ends at byte " + std::to_string(size) + ", before its end marker";
}

}  // namespace

ImageFileKind image_file_kind(std::span<const uint8_t> bytes) {
  if (bytes.size() >= 8 && bytes[0] == 0xff && bytes[1] == 0xd8 && bytes[2] == 0xff) {
    return ImageFileKind::kJpeg;
  }
  // Three letters are enough: png_problem looks at the rest, which copying as text would damage.
  if (bytes.size() >= 8 && std::memcmp(bytes.data() + 1, "PNG", 3) == 0) return ImageFileKind::kPng;
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

std::optional<std::string> png_problem(std::span<const uint8_t> bytes, uint64_t file_size) {
  if (!std::equal(kPngSignature, kPngSignature + 8, bytes.begin())) {
    return "is corrupt: its first 8 bytes are not those of a PNG file";
  }
  for (uint64_t at = 8;;) {
    // Length, type, data, checksum.
    if (file_size < 12 || at > file_size - 12) return truncated(file_size);
    if (at > bytes.size() || bytes.size() - at < 8) return std::nullopt;  // not here
    const uint8_t* chunk = bytes.data() + at;
    const uint32_t length = big_endian(chunk);
    if (length > file_size - at - 12) return truncated(file_size);
    const auto is_letter = [](uint8_t c) { return (c | 0x20) >= 'a' && (c | 0x20) <= 'z'; };
    if (!std::all_of(chunk + 4, chunk + 8, is_letter)) {
      return "is corrupt: a part of unknown kind at byte " + std::to_string(at);
    }
    if (length > bytes.size() - at || bytes.size() - at - length < 12) return std::nullopt;
    // Of chunks that can be left out (small first letter) decoders forgive damage.
    const bool needed = (chunk[4] & 0x20) == 0;
    if (needed && ::crc32_z(0, chunk + 4, size_t{length} + 4) != big_endian(chunk + 8 + length)) {
      return "is corrupt: the checksum of the part at byte " + std::to_string(at) + " is wrong";
    }
    if (std::memcmp(chunk + 4, "IEND", 4) == 0) return std::nullopt;
    at += uint64_t{length} + 12;
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
      problem = internal::png_problem(bytes, bytes.size());
      break;
    case internal::ImageFileKind::kOther:
      break;
  }
  if (problem) {
    throw Error("the image " + *problem, path.string(), "copy it again from its source");
  }
}

}  // namespace nerf
