#include "base/container.h"

#include <fcntl.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <utility>

#include "nerf/base/error.h"
#include "nerf/base/file.h"

namespace nerf::internal {
namespace {

static_assert(std::endian::native == std::endian::little, "files hold little-endian numbers");

constexpr size_t kNameBytes = 16;
constexpr uint32_t kMostSections = 64;
constexpr uint64_t kMostDeflation = 1032;  // bytes that deflate can make of one
constexpr uint64_t kMostFileBytes = uint64_t{16} << 30;

// As they stand in the file.
struct FileHead {
  char magic[8];
  uint32_t version;
  uint32_t sections;
  uint64_t file_bytes;    // the checksum included
  uint64_t header_bytes;  // of the JSON text that follows
};
struct SectionHead {
  char name[kNameBytes];  // padded with zeros
  uint32_t encoding;
  uint32_t reserved;  // 0
  uint64_t stored_bytes;
  uint64_t decoded_bytes;
};
static_assert(sizeof(FileHead) == 32 && sizeof(SectionHead) == 40);
constexpr size_t kChecksumBytes = 4;

uint32_t crc_of(uint32_t crc, std::span<const uint8_t> bytes) {
  return static_cast<uint32_t>(::crc32_z(crc, bytes.data(), bytes.size()));
}

template <class T>
std::span<const uint8_t> bytes_of(const T& value) {
  static_assert(std::is_trivially_copyable_v<T>);
  return {reinterpret_cast<const uint8_t*>(&value), sizeof(T)};
}

// Writes to an open file and keeps the checksum of what went through it.
class Sink {
 public:
  Sink(const std::filesystem::path& path, const std::filesystem::path& shown)
      : shown_(shown), fd_(::open(path.c_str(), O_WRONLY | O_TRUNC | O_CREAT | O_CLOEXEC, 0666)) {
    if (fd_ < 0) throw errno_error(errno, "cannot write", shown_);
  }
  ~Sink() {
    if (fd_ >= 0) ::close(fd_);
  }
  Sink(const Sink&) = delete;
  Sink& operator=(const Sink&) = delete;

  void write(std::span<const uint8_t> bytes) {
    if (bytes.empty()) return;  // zlib takes no bytes at null for a new checksum
    crc_ = crc_of(crc_, bytes);
    while (!bytes.empty()) {
      const ssize_t n = ::write(fd_, bytes.data(), std::min<size_t>(bytes.size(), 1u << 30));
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) throw errno_error(errno, "cannot write", shown_);
      bytes = bytes.subspan(static_cast<size_t>(n));
    }
  }
  void close() {
    if (::close(std::exchange(fd_, -1)) != 0) throw errno_error(errno, "cannot write", shown_);
  }
  uint32_t crc() const { return crc_; }

 private:
  const std::filesystem::path& shown_;
  int fd_;
  uint32_t crc_ = 0;
};

void write_rows(const Strided<const uint8_t>& rows, Sink& sink) {
  constexpr size_t kPiece = size_t{1} << 20;
  std::vector<uint8_t> piece;
  piece.reserve(std::min(kPiece + rows.count, rows.rows * rows.count));
  for (size_t i = 0; i < rows.rows; ++i) {
    const uint8_t* from = rows.data + i * rows.stride;
    piece.insert(piece.end(), from, from + rows.count);
    if (piece.size() < kPiece && i + 1 < rows.rows) continue;
    sink.write(piece);
    piece.clear();
  }
}

}  // namespace

void ContainerWriter::add_bytes(const std::string& name, std::span<const uint8_t> bytes,
                                SectionEncoding encoding) {
  NERF_CHECK(!name.empty() && name.size() <= kNameBytes);
  NERF_CHECK_LT(sections_.size(), size_t{kMostSections});
  Section section{name, encoding, bytes.size(), bytes, {}, {}};
  if (encoding == SectionEncoding::kZlib) {
    uLongf size = ::compressBound(bytes.size());
    section.compressed.resize(size);
    NERF_CHECK_EQ(::compress2(section.compressed.data(), &size, bytes.data(), bytes.size(),
                              Z_DEFAULT_COMPRESSION),
                  Z_OK);
    section.compressed.resize(size);
  }
  sections_.push_back(std::move(section));
}

void ContainerWriter::add_rows(const std::string& name, const Strided<const uint8_t>& rows) {
  add_bytes(name, {}, SectionEncoding::kRaw);
  sections_.back().apart = rows;
  sections_.back().decoded_bytes = rows.rows * rows.count;
}

void ContainerWriter::save(const std::filesystem::path& path, const ContainerFormat& format) const {
  FileHead head{};
  NERF_CHECK_EQ(format.magic.size(), sizeof(head.magic));
  std::memcpy(head.magic, format.magic.data(), sizeof(head.magic));
  head.version = format.version;
  head.sections = static_cast<uint32_t>(sections_.size());
  head.header_bytes = header_.size();
  head.file_bytes = sizeof(FileHead) + header_.size() + kChecksumBytes;
  for (const Section& s : sections_) head.file_bytes += sizeof(SectionHead) + s.stored_bytes();

  write_file_atomically(path, [&](const std::filesystem::path& temporary) {
    Sink sink(temporary, path);
    sink.write(bytes_of(head));
    sink.write({reinterpret_cast<const uint8_t*>(header_.data()), header_.size()});
    for (const Section& s : sections_) {
      SectionHead section{};
      std::memcpy(section.name, s.name.data(), s.name.size());
      section.encoding = static_cast<uint32_t>(s.encoding);
      section.stored_bytes = s.stored_bytes();
      section.decoded_bytes = s.decoded_bytes;
      sink.write(bytes_of(section));
      sink.write(s.bytes());
      write_rows(s.apart, sink);
    }
    const uint32_t crc = sink.crc();
    sink.write(bytes_of(crc));
    sink.close();
  });
}

ContainerReader::ContainerReader(const std::filesystem::path& path, const ContainerFormat& format)
    : ContainerReader(read_file(path, kMostFileBytes), path.string(), format) {}

ContainerReader::ContainerReader(std::vector<uint8_t> bytes, std::string where,
                                 const ContainerFormat& format)
    : bytes_(std::move(bytes)),
      where_(std::move(where)),
      kind_(format.kind),
      remedy_(format.remedy) {
  parse(format);
}

Error ContainerReader::damaged(const std::string& what) const {
  return Error("is a damaged " + kind_ + ": " + what, where_, remedy_);
}

void ContainerReader::parse(const ContainerFormat& format) {
  FileHead head;
  const std::span<const uint8_t> all(bytes_);
  const size_t magic_seen = std::min(all.size(), sizeof(head.magic));
  if (all.empty() || std::memcmp(all.data(), format.magic.data(), magic_seen) != 0)
    throw Error("is not a " + kind_ + " of this program", where_,
                "check that it is the right file");
  if (all.size() < sizeof(head) + kChecksumBytes)
    throw damaged("it is truncated after " + std::to_string(all.size()) + " bytes");
  std::memcpy(&head, all.data(), sizeof(head));
  if (head.version != format.version)
    throw Error("is a " + kind_ + " of version " + std::to_string(head.version) +
                    "; this program reads version " + std::to_string(format.version),
                where_, "use the program that wrote it, or train again");
  if (head.file_bytes != all.size())
    throw damaged((all.size() < head.file_bytes ? "truncated, " : "too long, ") +
                  std::to_string(all.size()) + " bytes instead of " +
                  std::to_string(head.file_bytes));
  uint32_t stored_crc;
  const auto content = all.first(all.size() - kChecksumBytes);
  std::memcpy(&stored_crc, all.data() + content.size(), kChecksumBytes);
  if (crc_of(0, content) != stored_crc) throw damaged("its checksum is wrong");

  auto rest = content.subspan(sizeof(head));
  const auto take = [&](uint64_t n, const char* what) {
    if (n > rest.size())
      throw damaged(std::string(what) + " runs over its end at byte " +
                    std::to_string(content.size() - rest.size()));
    const auto part = rest.first(static_cast<size_t>(n));
    rest = rest.subspan(static_cast<size_t>(n));
    return part;
  };
  const auto text = take(head.header_bytes, "the header");
  header_ = {reinterpret_cast<const char*>(text.data()), text.size()};
  if (head.sections > kMostSections) throw damaged("it states too many sections");
  for (uint32_t i = 0; i < head.sections; ++i) {
    SectionHead s;
    std::memcpy(&s, take(sizeof(s), "a section").data(), sizeof(s));
    const std::string name(s.name, ::strnlen(s.name, kNameBytes));
    Section section{static_cast<SectionEncoding>(s.encoding), s.decoded_bytes,
                    take(s.stored_bytes, "a section")};
    if (s.encoding > static_cast<uint32_t>(SectionEncoding::kZlib) || s.reserved != 0)
      throw damaged("section '" + name + "' has an unknown encoding");
    if (section.encoding == SectionEncoding::kRaw && s.stored_bytes != s.decoded_bytes)
      throw damaged("section '" + name + "' states two sizes");
    if (s.decoded_bytes / kMostDeflation > s.stored_bytes)
      throw damaged("section '" + name + "' states more than it can hold");
    if (!sections_.emplace(name, section).second)
      throw damaged("section '" + name + "' is there twice");
  }
  if (!rest.empty()) throw damaged("bytes follow the last section");
}

const ContainerReader::Section& ContainerReader::find(const std::string& name) const {
  const auto found = sections_.find(name);
  if (found == sections_.end()) throw damaged("section '" + name + "' is missing");
  return found->second;
}

const ContainerReader::Section& ContainerReader::find(const std::string& name,
                                                      uint64_t bytes) const {
  const Section& section = find(name);
  if (section.decoded_bytes != bytes)
    throw damaged("section '" + name + "' holds " + std::to_string(section.decoded_bytes) +
                  " bytes, its options ask for " + std::to_string(bytes));
  return section;
}

void ContainerReader::read_rows(const std::string& name, const Strided<uint8_t>& out) const {
  const Section& section = find(name, out.rows * out.count);
  if (section.encoding != SectionEncoding::kRaw)
    throw damaged("section '" + name + "' is compressed, which none of its kind is");
  const uint8_t* from = section.stored.data();
  for (size_t i = 0; i < out.rows; ++i, from += out.count)
    std::memcpy(out.data + i * out.stride, from, out.count);
}

void ContainerReader::read_bytes(const std::string& name, std::span<uint8_t> out) const {
  const Section& section = find(name, out.size());
  if (section.encoding == SectionEncoding::kRaw) {
    if (!out.empty()) std::memcpy(out.data(), section.stored.data(), out.size());
    return;
  }
  uLongf size = out.size();
  if (::uncompress(out.data(), &size, section.stored.data(), section.stored.size()) != Z_OK ||
      size != out.size())
    throw damaged("section '" + name + "' cannot be decompressed");
}

}  // namespace nerf::internal
