#include "nerf/io/exr.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDeepFrameBuffer.h>
#include <OpenEXR/ImfDeepScanLineOutputFile.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfTiledOutputFile.h>

#include <algorithm>
#include <cstring>
#include <exception>

#include "exr_header.h"
#include "half.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"

namespace nerf {

namespace {

namespace fs = std::filesystem;

// Encoded in memory, so that what reaches the disk is one plain write with a plain errno.
class Bytes final : public Imf::OStream {
 public:
  Bytes() : Imf::OStream("memory") {}
  void write(const char data[], int n) override {
    const size_t end = at_ + static_cast<size_t>(n);
    if (bytes_.size() < end) bytes_.resize(end);
    std::memcpy(bytes_.data() + at_, data, static_cast<size_t>(n));
    at_ = end;
  }
  uint64_t tellp() override { return at_; }
  void seekp(uint64_t at) override { at_ = static_cast<size_t>(at); }
  std::span<const uint8_t> bytes() const { return bytes_; }

 private:
  std::vector<uint8_t> bytes_;
  size_t at_ = 0;
};

// One channel's numbers as the file holds them.
struct Plane {
  std::string name;
  Imf::PixelType type = Imf::FLOAT;
  std::vector<char> data;

  size_t size() const { return type == Imf::HALF ? 2 : 4; }
};

void put(float value, Imf::PixelType type, char* at) {
  if (type == Imf::HALF) {
    const uint16_t half = internal::float_to_half(value);
    std::memcpy(at, &half, sizeof half);
  } else {
    std::memcpy(at, &value, sizeof value);
  }
}

std::vector<Plane> planes_of(const LayerImage& image, ExrType type) {
  std::vector<Plane> planes;
  const size_t pixels = static_cast<size_t>(image.width) * static_cast<size_t>(image.height);
  for (const ImageLayer& layer : image.layers) {
    const size_t channels = layer.channels.size();
    NERF_CHECK_EQ(layer.values.size(), pixels * channels);
    const bool exact = layer.kind == LayerKind::kLength || layer.kind == LayerKind::kCount;
    for (size_t c = 0; c < channels; ++c) {
      Plane& plane = planes.emplace_back();
      plane.name = layer.channels[c];
      plane.type = type == ExrType::kHalf && !exact ? Imf::HALF : Imf::FLOAT;
      plane.data.resize(pixels * plane.size());
      for (size_t i = 0; i < pixels; ++i)
        put(static_cast<float>(layer.values[i * channels + c]), plane.type,
            plane.data.data() + i * plane.size());
    }
  }
  return planes;
}

// Whatever the library throws is the user's to know of.
template <class Write>
void write_encoded(const fs::path& path, const Write& write) {
  Bytes bytes;
  try {
    write(bytes);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& problem) {
    throw Error(std::string("cannot write: ") + problem.what(), path.string());
  }
  write_file_atomically(path, bytes.bytes());
}

}  // namespace

void write_exr(const fs::path& path, const LayerImage& image, const ExrHeader& given,
               const ExrOptions& options) {
  Imf::Header header = internal::exr_header(image.width, image.height, given);
  std::vector<Plane> planes = planes_of(image, options.type);
  Imf::FrameBuffer buffer;
  for (Plane& plane : planes) {
    header.channels().insert(plane.name, Imf::Channel(plane.type));
    buffer.insert(plane.name, Imf::Slice(plane.type, plane.data.data(), plane.size(),
                                         plane.size() * static_cast<size_t>(image.width)));
  }
  write_encoded(path, [&](Bytes& bytes) {
    if (options.tiled) {
      header.setTileDescription(Imf::TileDescription(64, 64));
      Imf::TiledOutputFile file(bytes, header, /*numThreads=*/0);
      file.setFrameBuffer(buffer);
      file.writeTiles(0, file.numXTiles() - 1, 0, file.numYTiles() - 1);
    } else {
      Imf::OutputFile file(bytes, header, /*numThreads=*/0);
      file.setFrameBuffer(buffer);
      file.writePixels(image.height);
    }
  });
}

void write_deep_exr(const fs::path& path, const Frame& frame, double stops, const ExrHeader& given,
                    const ExrOptions& options) {
  const size_t pixels = static_cast<size_t>(frame.width) * static_cast<size_t>(frame.height);
  NERF_CHECK_EQ(frame.layers.deep.size(), pixels);
  Imf::Header header = internal::exr_header(frame.width, frame.height, given);
  header.setType(Imf::DEEPSCANLINE);
  header.compression() = Imf::ZIPS_COMPRESSION;  // deep files know no larger blocks
  const Imf::PixelType colour = options.type == ExrType::kHalf ? Imf::HALF : Imf::FLOAT;
  std::vector<Plane> planes;
  for (const char* name : {"R", "G", "B", "A"}) planes.push_back({name, colour, {}});
  for (const char* name : {"Z", "ZBack"}) planes.push_back({name, Imf::FLOAT, {}});

  std::vector<uint32_t> counts(pixels);
  std::vector<size_t> begin(pixels + 1);
  for (size_t i = 0; i < pixels; ++i) {
    const auto samples = deep_pixel(frame, i, stops);
    counts[i] = static_cast<uint32_t>(samples.size());
    begin[i + 1] = begin[i] + samples.size();
    for (size_t p = 0; p < planes.size(); ++p) {
      Plane& plane = planes[p];
      plane.data.resize(begin[i + 1] * plane.size());
      for (size_t s = 0; s < samples.size(); ++s)
        put(p < 4    ? samples[s].rgba[p]
            : p == 4 ? samples[s].z
                     : samples[s].z_back,
            plane.type, plane.data.data() + (begin[i] + s) * plane.size());
    }
  }

  Imf::DeepFrameBuffer buffer;
  const size_t width = static_cast<size_t>(frame.width);
  buffer.insertSampleCountSlice(Imf::Slice(Imf::UINT, reinterpret_cast<char*>(counts.data()),
                                           sizeof(uint32_t), sizeof(uint32_t) * width));
  std::vector<std::vector<const char*>> pointers(planes.size());
  for (size_t p = 0; p < planes.size(); ++p) {
    const Plane& plane = planes[p];
    header.channels().insert(plane.name, Imf::Channel(plane.type));
    pointers[p].resize(pixels);
    for (size_t i = 0; i < pixels; ++i)
      pointers[p][i] = plane.data.data() + begin[i] * plane.size();
    buffer.insert(plane.name,
                  Imf::DeepSlice(plane.type, reinterpret_cast<char*>(pointers[p].data()),
                                 sizeof(char*), sizeof(char*) * width, plane.size()));
  }
  write_encoded(path, [&](Bytes& bytes) {
    Imf::DeepScanLineOutputFile file(bytes, header, /*numThreads=*/0);
    file.setFrameBuffer(buffer);
    file.writePixels(frame.height);
  });
}

}  // namespace nerf
