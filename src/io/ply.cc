#include "ply.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>

#include "colmap.h"
#include "nerf/base/error.h"
#include "scene_limits.h"

namespace nerf::internal {
namespace {

namespace fs = std::filesystem;

enum class Encoding { kText, kLittle, kBig };
enum class Kind { kSigned, kUnsigned, kReal };
struct Type {
  Kind kind;
  size_t bytes;
};

struct Property {
  std::string name;
  Type type;
  std::optional<Type> count;  // of a list: what its length is stored as
};

struct Element {
  std::string name;
  uint64_t count = 0;
  std::vector<Property> properties;
  size_t fixed_bytes() const {  // 0 where records differ in length
    size_t bytes = 0;
    for (const Property& p : properties) {
      if (p.count) return 0;
      bytes += p.type.bytes;
    }
    return bytes;
  }
};

std::optional<Type> type_named(const std::string& name) {
  struct Named {
    const char *old_name, *name;
    Type type;
  };
  static constexpr std::array<Named, 8> kTypes{{{"char", "int8", {Kind::kSigned, 1}},
                                                {"uchar", "uint8", {Kind::kUnsigned, 1}},
                                                {"short", "int16", {Kind::kSigned, 2}},
                                                {"ushort", "uint16", {Kind::kUnsigned, 2}},
                                                {"int", "int32", {Kind::kSigned, 4}},
                                                {"uint", "uint32", {Kind::kUnsigned, 4}},
                                                {"float", "float32", {Kind::kReal, 4}},
                                                {"double", "float64", {Kind::kReal, 8}}}};
  for (const Named& t : kTypes)
    if (name == t.old_name || name == t.name) return t.type;
  return std::nullopt;
}

class PlyFile {
 public:
  explicit PlyFile(const fs::path& path) : path_(path), in_(path, std::ios::binary) {
    std::error_code failed;
    size_ = fs::file_size(path, failed);
    if (failed || !in_) fail("cannot read the point cloud", "");
  }

  void read_header() {
    if (next_line() != "ply") fail("is not a PLY file", "its first line is \"ply\"");
    bool has_format = false;
    for (;;) {
      std::istringstream words(next_line());
      std::string key;
      words >> key;
      if (key == "end_header") break;
      if (key.empty() || key == "comment" || key == "obj_info") continue;
      if (key == "format") {
        std::string name;
        words >> name;
        if (name != "ascii" && name != "binary_little_endian" && name != "binary_big_endian")
          fail_in_header("unknown format " + printable(name));
        encoding_ = name == "ascii"                  ? Encoding::kText
                    : name == "binary_little_endian" ? Encoding::kLittle
                                                     : Encoding::kBig;
        has_format = true;
      } else if (key == "element") {
        Element element;
        if (!(words >> element.name >> element.count)) fail_in_header("an element without a count");
        elements_.push_back(std::move(element));
      } else if (key == "property") {
        add_property(words);
      } else {
        fail_in_header("unknown entry " + printable(key));
      }
    }
    if (!has_format) fail_in_header("there is no format");
  }

  PlyPoints read_vertices(size_t most) {
    for (const Element& element : elements_) {
      if (element.name == "vertex") return vertices_of(element, most);
      skip(element);
    }
    fail("has no vertices", kHint);
  }

 private:
  static constexpr const char* kHint = "export the point cloud again";

  [[noreturn]] void fail(const std::string& what, const std::string& hint) const {
    throw Error(what, path_.string(), hint);
  }
  [[noreturn]] void fail_in_header(const std::string& what) const {
    throw Error(what, fmt::format("{}, header line {}", path_.string(), line_), kHint);
  }
  [[noreturn]] void truncated(const Element& element, uint64_t record) const {
    throw Error(fmt::format("the file ends inside {} {} of {}", printable(element.name), record,
                            element.count),
                path_.string(), "the file is truncated: copy it again or export it again");
  }

  std::string next_line() {
    constexpr size_t kLongest = 4096;
    constexpr int kMostLines = 10000;
    if (++line_ > kMostLines) fail_in_header("the header has no end");
    std::string line;
    for (int c; (c = in_.rdbuf()->sbumpc()) != '\n';) {
      if (c == std::char_traits<char>::eof()) fail_in_header("the header has no end");
      if (line.size() == kLongest) fail_in_header("the line is too long");
      line += static_cast<char>(c);
    }
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
    return line;
  }

  void add_property(std::istringstream& words) {
    if (elements_.empty()) fail_in_header("a property before any element");
    std::string type, name;
    Property property;
    words >> type;
    if (type == "list") {
      std::string count;
      words >> count >> type;
      property.count = type_named(count);
      if (!property.count || property.count->kind == Kind::kReal)
        fail_in_header("a list whose length is no whole number");
    }
    const auto known = type_named(type);
    if (!known || !(words >> property.name)) fail_in_header("a property of unknown type");
    property.type = *known;
    elements_.back().properties.push_back(std::move(property));
  }

  uint64_t left() { return size_ - std::min<uint64_t>(size_, static_cast<uint64_t>(in_.tellg())); }

  // One number of the body. False where the file ends.
  bool read(const Type& type, double* value) {
    return encoding_ == Encoding::kText ? read_word(value) : read_bytes(type, value);
  }

  bool read_word(double* value) {
    std::array<char, 64> word;
    size_t n = 0;
    std::streambuf& in = *in_.rdbuf();
    int c = in.sbumpc();
    while (c == ' ' || c == '\n' || c == '\r' || c == '\t') c = in.sbumpc();
    for (; c != std::char_traits<char>::eof() && c != ' ' && c != '\n' && c != '\r' && c != '\t';
         c = in.sbumpc()) {
      if (n == word.size()) fail("holds a word that is no number", kHint);
      word[n++] = static_cast<char>(c);
    }
    if (n == 0) return false;
    const char* begin = word.data() + (word[0] == '+' ? 1 : 0);
    const auto [end, problem] = std::from_chars(begin, word.data() + n, *value);
    if (problem == std::errc::result_out_of_range)
      *value = 0;
    else if (problem != std::errc() || end != word.data() + n)
      fail(fmt::format("\"{}\" is no number", printable({word.data(), n})), kHint);
    return true;
  }

  bool read_bytes(const Type& type, double* value) {
    std::array<char, 8> raw{};
    if (static_cast<size_t>(
            in_.rdbuf()->sgetn(raw.data(), static_cast<std::streamsize>(type.bytes))) != type.bytes)
      return false;
    *value = number(raw.data(), type);
    return true;
  }

  double number(const char* at, const Type& type) const {
    uint64_t bits = 0;
    for (size_t i = 0; i < type.bytes; ++i) {
      const size_t from = encoding_ == Encoding::kBig ? i : type.bytes - 1 - i;
      bits = bits << 8 | static_cast<uint8_t>(at[from]);
    }
    if (type.kind == Kind::kReal)
      return type.bytes == 4 ? std::bit_cast<float>(static_cast<uint32_t>(bits))
                             : std::bit_cast<double>(bits);
    if (type.kind == Kind::kUnsigned) return static_cast<double>(bits);
    const size_t unused = 64 - 8 * type.bytes;  // shifts bring the sign along
    return static_cast<double>(static_cast<int64_t>(bits << unused) >> unused);
  }

  // All properties of the next record; `values` gets those that are no lists. False at the end.
  bool read_record(const Element& element, std::vector<double>* values) {
    for (size_t i = 0; i < element.properties.size(); ++i) {
      const Property& property = element.properties[i];
      double value = 0;
      if (!read(property.count.value_or(property.type), &value)) return false;
      if (!property.count) {
        if (values != nullptr) (*values)[i] = value;
        continue;
      }
      if (!(value >= 0)) fail("holds a list of negative length", kHint);
      for (double k = 0, ignored; k < value; ++k)
        if (!read(property.type, &ignored)) return false;
    }
    return true;
  }

  void skip(const Element& element) {
    const size_t bytes = element.fixed_bytes();
    if (element.properties.empty()) return;
    if (encoding_ != Encoding::kText && bytes > 0) {
      if (element.count > left() / bytes) truncated(element, left() / bytes);
      in_.seekg(static_cast<std::streamoff>(element.count * bytes), std::ios::cur);
      return;
    }
    for (uint64_t i = 0; i < element.count; ++i)
      if (!read_record(element, nullptr)) truncated(element, i);
  }

  PlyPoints vertices_of(const Element& element, size_t most) {
    std::array<size_t, 3> axis{};
    PlyPoints points;
    for (size_t k = 0; k < 3; ++k) {
      const char name = static_cast<char>('x' + k);
      axis[k] = element.properties.size();
      for (size_t i = 0; i < element.properties.size(); ++i) {
        const Property& property = element.properties[i];
        if (property.name == std::string(1, name) && !property.count) axis[k] = i;
        points.splats = points.splats || property.name == "opacity";
      }
      if (axis[k] == element.properties.size())
        fail(fmt::format("its vertices have no {}", name), kHint);
    }
    // What the file has no room for, however it is stored, is not believed.
    const size_t bytes = element.fixed_bytes();
    const uint64_t least = encoding_ == Encoding::kText ? 2 * element.properties.size() - 1
                           : bytes > 0                  ? bytes
                                                        : element.properties.size();
    if (element.count > 0 && element.count - 1 > left() / least) truncated(element, left() / least);
    points.vertices = element.count;
    const uint64_t stride = std::max<uint64_t>(1, element.count / std::max<size_t>(1, most));
    std::vector<double> values(element.properties.size());
    for (uint64_t i = 0; i < element.count; ++i) {
      if (!read_record(element, &values)) truncated(element, i);
      const Vec3d p{values[axis[0]], values[axis[1]], values[axis[2]]};
      if (i % stride == 0 && coordinate_ok(p)) points.positions.push_back(p);
    }
    return points;
  }

  fs::path path_;
  std::ifstream in_;
  uint64_t size_ = 0;
  Encoding encoding_ = Encoding::kText;
  std::vector<Element> elements_;
  int line_ = 0;
};

}  // namespace

PlyPoints read_ply_points(const fs::path& path, size_t most) {
  PlyFile file(path);
  file.read_header();
  return file.read_vertices(most);
}

}  // namespace nerf::internal
