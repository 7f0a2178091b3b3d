// Does a JPEG or PNG in memory have its end? Decoders fill what is missing with grey and may not
// say.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace nerf::internal {

enum class ImageFileKind { kJpeg, kPng, kOther };

// By the first 8 bytes (fewer give kOther), whatever the file's name says.
ImageFileKind image_file_kind(std::span<const uint8_t> bytes);

// What is wrong, as the end of the sentence "the image ...", with the byte; nothing where the file
// is complete. Walks JPEG's marker segments up to EOI, so that the end of an embedded thumbnail
// does not count. Bytes behind the end are allowed.
std::optional<std::string> jpeg_problem(std::span<const uint8_t> bytes);

// The same for PNG: walks its chunks up to IEND, with their checksums. `bytes` may be the beginning
// (8 bytes and more) of a file of file_size bytes; what lies behind it is not judged.
std::optional<std::string> png_problem(std::span<const uint8_t> bytes, uint64_t file_size);

}  // namespace nerf::internal
