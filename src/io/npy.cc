#include "npy.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <string>
#include <string_view>

#include "half.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"

namespace nerf::internal {

namespace {

constexpr size_t kPrefix = 10;  // magic, version and the header's length in version 1
constexpr uint64_t kMostBytes = uint64_t{1} << 30;
constexpr size_t kMostDimensions = 8;

// What stands behind 'key': in the header, a Python dictionary, up to its comma or closing bracket.
std::string_view value_of(std::string_view header, std::string_view key) {
  const size_t at = header.find(fmt::format("'{}'", key));
  if (at == header.npos) return {};
  const size_t begin = header.find_first_not_of(": ", at + key.size() + 2);
  if (begin == header.npos) return {};
  const char close = header[begin] == '(' ? ')' : ',';
  const size_t end = header.find(close, begin);
  return end == header.npos ? std::string_view() : header.substr(begin, end - begin);
}

std::vector<size_t> shape_of(std::string_view text, const std::string& where) {
  std::vector<size_t> shape;
  size_t at = 1;  // behind the bracket
  while (at < text.size()) {
    if (text[at] == ' ' || text[at] == ',') {
      ++at;
      continue;
    }
    size_t size = 0;
    const auto [end, problem] = std::from_chars(text.data() + at, text.data() + text.size(), size);
    if (problem != std::errc() || size > kMostBytes || shape.size() == kMostDimensions)
      throw Error("the shape of the array cannot be read", where, "write it anew with numpy.save");
    shape.push_back(size);
    at = static_cast<size_t>(end - text.data());
  }
  return shape;
}

template <class T>
T bits_at(const uint8_t* at) {
  T value;
  std::memcpy(&value, at, sizeof(value));
  return value;
}

double number(const uint8_t* at, size_t width, bool integer) {
  if (integer) return width == 2 ? bits_at<uint16_t>(at) : bits_at<uint32_t>(at);
  if (width == 2) return static_cast<double>(half_to_float(bits_at<uint16_t>(at)));
  return width == 4 ? static_cast<double>(bits_at<float>(at)) : bits_at<double>(at);
}

}  // namespace

NpyArray read_npy(const std::filesystem::path& path) {
  const std::string where = path.string();
  const std::vector<uint8_t> bytes = read_file(path, kMostBytes);
  const char* hint = "write it anew with numpy.save";
  if (bytes.size() < kPrefix || std::memcmp(bytes.data(), "\x93NUMPY", 6) != 0)
    throw Error("is no NumPy array", where, hint);
  const int version = bytes[6];
  if (version < 1 || version > 3)
    throw Error(fmt::format("is a NumPy array of format {}", version), where, hint);
  const size_t begin = version == 1 ? kPrefix : kPrefix + 2;
  if (bytes.size() < begin) throw Error("is cut off in its header", where, hint);
  size_t length = bytes[8] | static_cast<size_t>(bytes[9]) << 8;
  if (version > 1)
    length |= static_cast<size_t>(bytes[10]) << 16 | static_cast<size_t>(bytes[11]) << 24;
  if (bytes.size() - begin < length) throw Error("is cut off in its header", where, hint);
  const std::string_view header(reinterpret_cast<const char*>(bytes.data()) + begin, length);

  const std::string_view type = value_of(header, "descr");
  const bool known =
      type == "'<f8'" || type == "'<f4'" || type == "'<f2'" || type == "'<u2'" || type == "'<u4'";
  if (!known)
    throw Error(fmt::format("holds numbers of type {}, not floats or unsigned integers", type),
                where, "write array.astype('<f8')");
  const size_t width = static_cast<size_t>(type[3] - '0');
  if (value_of(header, "fortran_order") != "False")
    throw Error("is stored column by column", where, "write numpy.ascontiguousarray(array)");
  NpyArray out;
  out.integers = type[2] == 'u';
  out.shape = shape_of(value_of(header, "shape"), where);
  uint64_t count = 1;
  for (const size_t n : out.shape) {
    count *= n;
    if (count > kMostBytes) throw Error("is larger than any capture", where);
  }
  const size_t data = begin + length;
  if (bytes.size() - data != count * width)
    throw Error(fmt::format("holds {} bytes of numbers, but its shape asks for {}",
                            bytes.size() - data, count * width),
                where, "the file is damaged or was cut off: copy it again");
  static_assert(std::endian::native == std::endian::little);
  for (size_t i = 0; i < count; ++i) {
    out.values.push_back(number(bytes.data() + data + i * width, width, out.integers));
  }
  return out;
}

void write_npy(const std::filesystem::path& path, std::span<const size_t> shape,
               std::span<const Real> values) {
  std::string text = fmt::format("{{'descr': '<f4', 'fortran_order': False, 'shape': ({},), }}",
                                 fmt::join(shape, ", "));
  // The header ends in a line break, and the numbers begin at a multiple of 64.
  text.append(63 - (kPrefix + text.size()) % 64, ' ');
  text += '\n';
  std::vector<uint8_t> bytes(kPrefix + text.size() + values.size() * sizeof(float));
  std::memcpy(bytes.data(), "\x93NUMPY\x01\x00", 8);
  bytes[8] = static_cast<uint8_t>(text.size() & 0xff);
  bytes[9] = static_cast<uint8_t>(text.size() >> 8);
  std::ranges::copy(text, bytes.begin() + kPrefix);
  uint8_t* at = bytes.data() + kPrefix + text.size();
  for (const Real v : values) {
    const uint32_t bits = std::bit_cast<uint32_t>(static_cast<float>(v));
    for (int k = 0; k < 4; ++k) *at++ = static_cast<uint8_t>(bits >> 8 * k);
  }
  write_file_atomically(path, std::span<const uint8_t>(bytes));
}

}  // namespace nerf::internal
