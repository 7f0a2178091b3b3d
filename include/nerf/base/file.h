// Whole-file reading and crash-safe writing, and how much memory this process may use.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "nerf/base/error.h"

namespace nerf {

// The Error for a failed system call on `path`: `what` + the system's reason, and a hint that fits
// the reason (disk full, no permission, a folder where a file is wanted, ...). `code` is an errno.
Error errno_error(int code, const std::string& what, const std::filesystem::path& path);

// Reads a regular file whole. Throws Error (missing, a folder, unreadable, over max_bytes).
std::vector<uint8_t> read_file(const std::filesystem::path& path,
                               uint64_t max_bytes = uint64_t{4} << 30);
std::string read_text_file(const std::filesystem::path& path,
                           uint64_t max_bytes = uint64_t{1} << 30);

// Replaces `path` with the bytes or not at all: written to a temporary file beside it, synced,
// renamed, and the folder synced. On any failure (disk full, no permission) the temporary file is
// removed, what stood at `path` stays, and Error says why. A temporary file that a killed process
// left behind is reused by the next write of the same path. Where `path` is a symbolic link, the
// file that it points to is replaced.
void write_file_atomically(const std::filesystem::path& path, std::span<const uint8_t> bytes);
void write_file_atomically(const std::filesystem::path& path, std::string_view text);

// The same for a writer that wants a path of its own (an image library, ffmpeg): `write` is given a
// temporary path with the same extension in the same folder (an empty file that it overwrites).
// What `write` throws is passed on; leaving the file empty or missing is an Error.
void write_file_atomically(const std::filesystem::path& path,
                           const std::function<void(const std::filesystem::path&)>& write);

// Creates the folder and its parents; Error when that fails or the folder cannot be written into.
void make_writable_folder(const std::filesystem::path& folder);

}  // namespace nerf
