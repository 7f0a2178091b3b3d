// Readers over a whole file in memory that know where they are, so that every error names the file
// and the byte offset or line. Nothing is allocated from a count that the file has no room for.
#pragma once

#include <fmt/format.h>

#include <array>
#include <bit>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <utility>

#include "nerf/base/error.h"

namespace nerf::internal {

class Cursor {
 public:
  explicit Cursor(std::filesystem::path file) : file_(std::move(file)) {}
  virtual ~Cursor() = default;

  virtual std::string where() const = 0;
  [[noreturn]] void fail(const std::string& what, const std::string& hint = "") const {
    throw Error(what, where(), hint);
  }
  const std::filesystem::path& file() const { return file_; }

 private:
  std::filesystem::path file_;
};

// Little-endian values from the bytes of a file.
class ByteCursor : public Cursor {
 public:
  ByteCursor(std::filesystem::path file, std::span<const uint8_t> bytes)
      : Cursor(std::move(file)), bytes_(bytes) {}

  std::string where() const override {
    return fmt::format("{}, byte {}", file().string(), record_);
  }
  // From here on errors name this offset: where the record starts that is being read.
  void begin_record() { record_ = offset_; }

  size_t remaining() const { return bytes_.size() - offset_; }

  template <class T>
  T read(const char* what) {
    static_assert(std::is_arithmetic_v<T>);
    need(sizeof(T), what);
    std::array<uint8_t, sizeof(T)> raw;
    for (size_t i = 0; i < sizeof(T); ++i) {
      raw[std::endian::native == std::endian::little ? i : sizeof(T) - 1 - i] = bytes_[offset_ + i];
    }
    offset_ += sizeof(T);
    return std::bit_cast<T>(raw);
  }

  // A 64-bit number of records that take at least `bytes_each` bytes each.
  uint64_t read_count(const char* what, uint64_t bytes_each) {
    begin_record();
    const auto count = read<uint64_t>(what);
    if (count > remaining() / bytes_each) {
      fail(fmt::format("{} is {}, but only {} bytes follow", what, count, remaining()), kDamaged);
    }
    return count;
  }

  void skip(uint64_t count, const char* what) {
    need(count, what);
    offset_ += count;
  }

  // Text up to a zero byte, which is consumed.
  std::string read_text(const char* what) {
    const auto* begin = bytes_.data() + offset_;
    const void* end = remaining() == 0 ? nullptr : std::memchr(begin, 0, remaining());
    if (end == nullptr) fail(fmt::format("the file ends inside {}", what), kDamaged);
    const auto size = static_cast<size_t>(static_cast<const uint8_t*>(end) - begin);
    offset_ += size + 1;
    return {reinterpret_cast<const char*>(begin), size};
  }

  void expect_end() {
    if (remaining() == 0) return;
    begin_record();
    fail(fmt::format("{} bytes follow the last record", remaining()), kDamaged);
  }

  static constexpr const char* kDamaged =
      "the file is truncated or damaged: copy it again or export the model again";

 private:
  void need(uint64_t count, const char* what) {
    if (count > remaining()) fail(fmt::format("the file ends inside {}", what), kDamaged);
  }

  std::span<const uint8_t> bytes_;
  size_t offset_ = 0, record_ = 0;
};

// Lines of a text file and the words of the current one.
class LineCursor : public Cursor {
 public:
  LineCursor(std::filesystem::path file, std::string_view text)
      : Cursor(std::move(file)), rest_(text) {}

  std::string where() const override { return fmt::format("{}, line {}", file().string(), line_); }

  // Goes to the next line, also an empty one; false at the end of the file.
  bool next_line() {
    if (rest_.empty()) return false;
    const size_t end = rest_.find('\n');
    words_ = rest_.substr(0, end);
    rest_ = end == std::string_view::npos ? std::string_view{} : rest_.substr(end + 1);
    ++line_;
    return true;
  }

  // Goes to the next line that holds data. Comments (#) are given to `comment`.
  template <class Fn>
  bool next_data_line(Fn&& comment) {
    while (next_line()) {
      skip_space();
      if (words_.empty()) continue;
      if (words_.front() != '#') return true;
      comment(words_.substr(1));
    }
    return false;
  }

  bool at_line_end() {
    skip_space();
    return words_.empty();
  }

  std::string_view word(const char* what) {
    if (at_line_end()) fail(fmt::format("the line ends where {} should be", what));
    size_t end = 0;
    while (end < words_.size() && !is_space(words_[end])) ++end;
    const std::string_view w = words_.substr(0, end);
    words_.remove_prefix(end);
    return w;
  }

  template <class T>
  T number(const char* what) {
    std::string_view w = word(what);
    if (w.size() > 1 && w.front() == '+') w.remove_prefix(1);
    T value{};
    const auto [end, problem] = std::from_chars(w.data(), w.data() + w.size(), value);
    if constexpr (std::is_floating_point_v<T>) {
      // An underflow is zero; an overflow is not a number that a model holds.
      const bool tiny = w.find("e-") != w.npos || w.find("E-") != w.npos;
      if (problem == std::errc::result_out_of_range && tiny) return 0;
      // What older compilers' libraries print for no number: 1.#IND, -1.#QNAN0, 1.#INF00.
      if (w.find(".#") != w.npos) return std::numeric_limits<T>::quiet_NaN();
    }
    if (problem != std::errc() || end != w.data() + w.size()) {
      fail(fmt::format("\"{}\" is not {}", w.substr(0, 40), what));
    }
    return value;
  }

  // What is left of the line, without the space around it.
  std::string_view rest_of_line() {
    skip_space();
    while (!words_.empty() && is_space(words_.back())) words_.remove_suffix(1);
    return words_;
  }

 private:
  static bool is_space(char c) { return c == ' ' || c == '\t' || c == '\r'; }
  void skip_space() {
    while (!words_.empty() && is_space(words_.front())) words_.remove_prefix(1);
  }

  std::string_view rest_, words_;
  int64_t line_ = 0;
};

}  // namespace nerf::internal
