// A file of named sections behind a JSON header, with a checksum over all of it: the model file and
// the checkpoint (docs/model_file.md gives every byte).
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "nerf/base/error.h"

namespace nerf::internal {

// What kind of file it is; version is that of the header's and the sections' meaning.
struct ContainerFormat {
  std::string_view magic;  // 8 characters
  uint32_t version;
  std::string_view kind;    // for messages: "model file"
  std::string_view remedy;  // what to do about a damaged one
};

enum class SectionEncoding : uint32_t { kRaw = 0, kZlib = 1 };

// Numbers that lie apart in memory and side by side in a file: `rows` times `count` of them, from
// one row's first to the next one's `stride`.
template <class T>
struct Strided {
  T* data;
  size_t rows, count, stride;
};

// Collects sections and writes them. Raw sections are not copied: their arrays must live until
// save().
class ContainerWriter {
 public:
  explicit ContainerWriter(std::string header = {}) : header_(std::move(header)) {}
  void set_header(std::string header) { header_ = std::move(header); }

  // `name`: 1 to 16 ASCII characters.
  template <class T>
  void add(const std::string& name, std::span<const T> values,
           SectionEncoding encoding = SectionEncoding::kRaw) {
    static_assert(std::is_arithmetic_v<T>);
    add_bytes(name, {reinterpret_cast<const uint8_t*>(values.data()), values.size_bytes()},
              encoding);
  }

  template <class T>
  void add(const std::string& name, const Strided<T>& values) {
    static_assert(std::is_arithmetic_v<T>);
    add_rows(name, {reinterpret_cast<const uint8_t*>(values.data), values.rows,
                    values.count * sizeof(T), values.stride * sizeof(T)});
  }

  // Writes atomically (write_file_atomically) without a second copy in memory. Throws Error.
  void save(const std::filesystem::path& path, const ContainerFormat& format) const;

 private:
  struct Section {
    std::string name;
    SectionEncoding encoding;
    uint64_t decoded_bytes;
    std::span<const uint8_t> stored;  // of raw sections
    std::vector<uint8_t> compressed;  // of others
    Strided<const uint8_t> apart{};   // of raw sections in rows that lie apart
    std::span<const uint8_t> bytes() const {
      return encoding == SectionEncoding::kRaw ? stored : std::span<const uint8_t>(compressed);
    }
    uint64_t stored_bytes() const { return bytes().size() + apart.rows * apart.count; }
  };
  void add_rows(const std::string& name, const Strided<const uint8_t>& rows);
  void add_bytes(const std::string& name, std::span<const uint8_t> bytes, SectionEncoding encoding);

  std::string header_;
  std::vector<Section> sections_;
};

// Reads a file whole and checks its length, checksum and structure before anything is used. Every
// failure is an Error that names `where` (the file).
class ContainerReader {
 public:
  ContainerReader(const std::filesystem::path& path, const ContainerFormat& format);
  ContainerReader(std::vector<uint8_t> bytes, std::string where, const ContainerFormat& format);

  const std::string& where() const { return where_; }
  std::string_view header() const { return header_; }

  // Bytes of a section after decoding, as the file states them; Error where there is none of that
  // name. Compare it with what is expected before allocating.
  uint64_t decoded_bytes(const std::string& name) const { return find(name).decoded_bytes; }

  // Decodes a section into `out`, whose size must be the section's exactly.
  template <class T>
  void read(const std::string& name, std::span<T> out) const {
    static_assert(std::is_arithmetic_v<T>);
    read_bytes(name, {reinterpret_cast<uint8_t*>(out.data()), out.size_bytes()});
  }
  // The same for a raw section, into rows that lie apart.
  template <class T>
  void read(const std::string& name, const Strided<T>& out) const {
    static_assert(std::is_arithmetic_v<T>);
    read_rows(name, {reinterpret_cast<uint8_t*>(out.data), out.rows, out.count * sizeof(T),
                     out.stride * sizeof(T)});
  }

 private:
  struct Section {
    SectionEncoding encoding;
    uint64_t decoded_bytes;
    std::span<const uint8_t> stored;
  };
  void parse(const ContainerFormat& format);
  const Section& find(const std::string& name) const;
  const Section& find(const std::string& name, uint64_t bytes) const;  // of that size exactly
  void read_bytes(const std::string& name, std::span<uint8_t> out) const;
  void read_rows(const std::string& name, const Strided<uint8_t>& out) const;

  std::vector<uint8_t> bytes_;
  std::string where_;
  Error damaged(const std::string& what) const;

  std::string kind_, remedy_;
  std::string_view header_;
  std::map<std::string, Section> sections_;
};

}  // namespace nerf::internal
