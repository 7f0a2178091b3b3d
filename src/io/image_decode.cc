#include "image_decode.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <exception>
#include <memory>
#include <optional>
#include <span>

#include "half.h"
#include "image_complete.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/io/image.h"
#include "scene_limits.h"
#include "shot_tags.h"

namespace nerf {
namespace internal {
namespace {

namespace fs = std::filesystem;

constexpr const char* kBrokenHint =
    "the file is damaged or not an image: copy it again from its source";

std::string first_line(std::string text) {
  text.resize(std::min(text.find('\n'), text.size()));
  return text;
}

Error cannot_read(const fs::path& path, const std::string& reason) {
  return Error("cannot read the image" + (reason.empty() ? "" : ": " + first_line(reason)),
               path.string(), kBrokenHint);
}

Error damaged(const fs::path& path, const std::string& problem) {
  return Error("the image " + problem, path.string(), "copy it again from its source");
}

// Libraries below OpenImageIO may throw anything; here it becomes an Error that names the file.
template <class Body>
auto name_the_file(const fs::path& path, Body body) {
  try {
    return body();
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw Error("not enough memory to decode the image", path.string(),
                "use smaller photos or fewer --threads");
  } catch (const std::exception& error) {
    throw cannot_read(path, error.what());
  }
}

OIIO::ImageSpec reading_config() {
  OIIO::ImageSpec config;
  config.attribute("oiio:UnassociatedAlpha", 1);  // do not premultiply
  config.attribute("oiio:reorient", 0);           // do not turn
  return config;
}

// Which of the file's channels are used, in the order of colour, alpha.
struct Layout {
  std::array<int, 4> source{};
  int channels = 0;
  bool consecutive() const {
    for (int c = 0; c < channels; ++c) {
      if (source[static_cast<size_t>(c)] != c) return false;
    }
    return true;
  }
};

Layout layout_of(const OIIO::ImageSpec& spec) {
  // OpenEXR files may hold any channels in any order: those named R, G, B are meant.
  const int r = spec.channelindex("R"), g = spec.channelindex("G"), b = spec.channelindex("B");
  Layout layout;
  if (r >= 0 && g >= 0 && b >= 0) {
    layout.source = {r, g, b};
    layout.channels = 3;
  } else if (spec.nchannels >= 3) {
    layout.source = {0, 1, 2};
    layout.channels = 3;
  } else {
    layout.source = {0};
    layout.channels = 1;
  }
  const auto used = std::span(layout.source).first(static_cast<size_t>(layout.channels));
  if (spec.alpha_channel >= 0 && spec.alpha_channel < spec.nchannels &&
      std::find(used.begin(), used.end(), spec.alpha_channel) == used.end()) {
    layout.source[static_cast<size_t>(layout.channels++)] = spec.alpha_channel;
  }
  return layout;
}

SampleType type_of(const OIIO::ImageSpec& spec) {
  if (spec.format.basesize() == 1) return SampleType::k8;
  // Integers of 32 bits and more than 16 bits of precision have no use here.
  return spec.format.is_floating_point() ? SampleType::kHalf : SampleType::k16;
}

size_t bytes_per_sample(SampleType type) { return type == SampleType::k8 ? 1 : 2; }

// `file_bytes` is the file's length. Before anything is allocated for the pixels.
void check_spec(const OIIO::ImageSpec& spec, const fs::path& path, uint64_t file_bytes) {
  const int64_t w = spec.width, h = spec.height;
  if (w < 1 || h < 1 || w > kMaxImageSide || h > kMaxImageSide || w * h > kMaxImagePixels) {
    throw Error(fmt::format("the image says {} x {} pixels", w, h), path.string(), kImageSizeHint);
  }
  if (spec.depth > 1 || spec.deep || spec.nchannels < 1) {
    throw Error("is a volume, a deep image or without channels", path.string(),
                "store it as a flat picture");
  }
  // No format packs a picture by more than deflate's 1032 : 1 or so. A large picture in a tiny file
  // is damage, and would cost its whole memory before that shows.
  constexpr uint64_t kMaxPacking = 1100, kHarmless = uint64_t{256} << 20;
  const uint64_t bytes = static_cast<uint64_t>(w) * static_cast<uint64_t>(h) *
                         static_cast<uint64_t>(layout_of(spec).channels) *
                         bytes_per_sample(type_of(spec));
  if (bytes > kHarmless && bytes / kMaxPacking > file_bytes) {
    throw Error(fmt::format("the image says {} x {} pixels, more than its {} bytes can hold", w, h,
                            file_bytes),
                path.string(), kBrokenHint);
  }
}

uint64_t length_of(const fs::path& path) {
  std::error_code failed;
  const auto bytes = fs::file_size(path, failed);
  return failed ? 0 : bytes;
}

std::unique_ptr<OIIO::ImageInput> open_by_path(const fs::path& path) {
  std::error_code failed;
  const fs::file_status status = fs::status(path, failed);
  if (!fs::exists(status)) throw errno_error(ENOENT, "cannot read the image", path);
  if (fs::is_directory(status)) throw errno_error(EISDIR, "cannot read the image", path);
  const OIIO::ImageSpec config = reading_config();
  auto in = OIIO::ImageInput::open(path.string(), &config);
  if (!in) throw cannot_read(path, OIIO::geterror());
  in->threads(1);  // callers are parallel over images
  return in;
}

// A decoder that reads from memory, for the two formats that are checked there.
struct MemoryInput {
  std::vector<uint8_t> bytes;
  std::unique_ptr<OIIO::Filesystem::IOMemReader> reader;
  std::unique_ptr<OIIO::ImageInput> in;
};

void open_in_memory(MemoryInput& input, const fs::path& path, const char* format) {
  input.reader =
      std::make_unique<OIIO::Filesystem::IOMemReader>(input.bytes.data(), input.bytes.size());
  input.in = OIIO::ImageInput::create(format);
  if (!input.in) throw cannot_read(path, OIIO::geterror());
  input.in->threads(1);
  OIIO::ImageSpec spec;
  if (!input.in->set_ioproxy(input.reader.get()) ||
      !input.in->open(path.string(), spec, reading_config())) {
    throw cannot_read(path, input.in->geterror());
  }
}

std::vector<uint8_t> first_bytes(const fs::path& path, size_t count) {
  std::vector<uint8_t> head(count);
  const size_t n = OIIO::Filesystem::read_bytes(path.string(), head.data(), head.size());
  head.resize(n);
  return head;
}

// Complete, with a size that its bytes can hold. Of a PNG or a JPEG.
MemoryInput open_bytes(std::vector<uint8_t> bytes, ImageFileKind kind, const fs::path& path) {
  MemoryInput memory;
  memory.bytes = std::move(bytes);
  const auto problem = kind == ImageFileKind::kJpeg
                           ? jpeg_problem(memory.bytes)
                           : png_problem(memory.bytes, memory.bytes.size());
  if (problem) throw damaged(path, *problem);
  open_in_memory(memory, path, kind == ImageFileKind::kJpeg ? "jpeg" : "png");
  check_spec(memory.in->spec(), path, memory.bytes.size());
  return memory;
}

MemoryInput open_whole(const fs::path& path) {
  const ImageFileKind kind = image_file_kind(first_bytes(path, 8));
  if (kind != ImageFileKind::kOther) return open_bytes(read_file(path), kind, path);
  MemoryInput memory;
  memory.in = open_by_path(path);
  check_spec(memory.in->spec(), path, length_of(path));
  return memory;
}

void read_samples(OIIO::ImageInput& in, const fs::path& path, const Layout& layout,
                  OIIO::TypeDesc type, size_t sample_bytes, void* out) {
  bool good = true;
  if (layout.consecutive()) {
    good = in.read_image(0, 0, 0, layout.channels, type, out);
  } else {
    const auto step = static_cast<OIIO::stride_t>(sample_bytes) * layout.channels;
    for (int c = 0; good && c < layout.channels; ++c) {
      const int from = layout.source[static_cast<size_t>(c)];
      good =
          in.read_image(0, 0, from, from + 1, type,
                        static_cast<uint8_t*>(out) + static_cast<size_t>(c) * sample_bytes, step);
    }
  }
  // Decoders may report damage, fill the rest with grey and return success.
  if (!good || in.has_error()) throw cannot_read(path, in.geterror());
}

void read_channel(OIIO::ImageInput& in, const fs::path& path, int channel, OIIO::TypeDesc type,
                  void* out) {
  if (!in.read_image(0, 0, channel, channel + 1, type, out) || in.has_error())
    throw cannot_read(path, in.geterror());
}

}  // namespace

float StoredImage::sample(size_t i) const {
  switch (type) {
    case SampleType::k8:
      return static_cast<float>(samples8[i]) / 255.0f;
    case SampleType::k16:
      return static_cast<float>(samples16[i]) / 65535.0f;
    case SampleType::kHalf:
      break;
  }
  return half_to_float(samples16[i]);
}

std::set<std::string> readable_camera_formats() {
  // "format:ext,ext;format:ext", of the formats that this library was built with.
  std::string list = fmt::format(",{},", std::string(OIIO::get_string_attribute("extension_list")));
  std::replace(list.begin(), list.end(), ':', ',');
  std::replace(list.begin(), list.end(), ';', ',');
  std::set<std::string> found;
  for (const char* extension :
       {"heic", "heif", "heics", "hif", "avif", "jxl", "dng", "cr2", "cr3", "nef",
        "nrw",  "arw",  "raf",   "rw2", "orf",  "pef", "srw", "3fr", "iiq", "erf"}) {
    if (list.find(fmt::format(",{},", extension)) != list.npos)
      found.insert(fmt::format(".{}", extension));
  }
  return found;
}

namespace {

StoredImage stored_image(const MemoryInput& memory, const fs::path& path) {
  const OIIO::ImageSpec& spec = memory.in->spec();
  const Layout layout = layout_of(spec);
  StoredImage image;
  image.width = spec.width;
  image.height = spec.height;
  image.channels = layout.channels;
  image.type = type_of(spec);
  image.premultiplied =
      image.has_alpha() && spec.get_int_attribute("oiio:UnassociatedAlpha", 0) == 0;
  const size_t count = static_cast<size_t>(image.width) * static_cast<size_t>(image.height) *
                       static_cast<size_t>(image.channels);
  if (image.type == SampleType::k8) {
    image.samples8.resize(count);
    read_samples(*memory.in, path, layout, OIIO::TypeDesc::UINT8, 1, image.samples8.data());
  } else {
    image.samples16.resize(count);
    const bool half = image.type == SampleType::kHalf;
    read_samples(*memory.in, path, layout, half ? OIIO::TypeDesc::HALF : OIIO::TypeDesc::UINT16, 2,
                 image.samples16.data());
  }
  return image;
}

}  // namespace

StoredImage decode_image(const fs::path& path) {
  return name_the_file(path, [&] { return stored_image(open_whole(path), path); });
}

StoredImage decode_image(std::vector<uint8_t> bytes, const std::string& name) {
  return name_the_file(name, [&] {
    const ImageFileKind kind =
        image_file_kind(std::span(bytes).first(std::min<size_t>(8, bytes.size())));
    if (kind == ImageFileKind::kOther)
      throw Error("the image is neither PNG nor JPEG", name, "convert it");
    return stored_image(open_bytes(std::move(bytes), kind, name), name);
  });
}

StoredChannel decode_channel(const fs::path& path) {
  return name_the_file(path, [&] {
    const MemoryInput memory = open_whole(path);
    const OIIO::ImageSpec& spec = memory.in->spec();
    StoredChannel out{spec.width,
                      spec.height,
                      spec.nchannels,
                      static_cast<int>(8 * spec.format.basesize()),
                      !spec.format.is_floating_point(),
                      {}};
    const int z = std::max(spec.channelindex("Z"), spec.channelindex("z"));
    const int channel = std::max(z, 0);
    const size_t count = static_cast<size_t>(out.width) * static_cast<size_t>(out.height);
    out.values.resize(count);
    if (!out.integers) {
      read_channel(*memory.in, path, channel, OIIO::TypeDesc::FLOAT, out.values.data());
      return out;
    }
    std::vector<uint16_t> samples(count);
    read_channel(*memory.in, path, channel, OIIO::TypeDesc::UINT16, samples.data());
    std::copy(samples.begin(), samples.end(), out.values.begin());
    return out;
  });
}

}  // namespace internal

ImageInfo read_image_info(const std::filesystem::path& path) {
  return internal::name_the_file(path, [&] {
    // libpng would print what is wrong with a header instead of only reporting it.
    const auto head = internal::first_bytes(path, 1 << 16);
    if (internal::image_file_kind(head) == internal::ImageFileKind::kPng) {
      const auto problem = internal::png_problem(head, internal::length_of(path));
      if (problem) throw internal::damaged(path, *problem);
    }
    const auto in = internal::open_by_path(path);
    const OIIO::ImageSpec& spec = in->spec();
    internal::check_spec(spec, path, internal::length_of(path));
    ImageInfo info;
    info.width = spec.width;
    info.height = spec.height;
    info.channels = internal::layout_of(spec).channels;
    info.half_or_16bit = internal::type_of(spec) != internal::SampleType::k8;
    const int orientation = spec.get_int_attribute("Orientation", 1);
    if (orientation >= 1 && orientation <= 8) info.orientation = orientation;
    info.shot = internal::shot_tags(spec);
    return info;
  });
}

}  // namespace nerf
