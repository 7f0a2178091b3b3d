#include "report_pictures.h"

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"
#include "nerf/io/depth_image.h"
#include "nerf/train/evaluation.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

constexpr int kQuality = 85;
constexpr int kLeastWidth = 160;  // pixels; smaller pictures show nothing
constexpr uint8_t kMasked = 128;

Image8 part_of(const Image8& row, int x0, int width) {
  Image8 part{width, row.height, 3, {}};
  part.pixels.resize(3 * static_cast<size_t>(width) * static_cast<size_t>(row.height));
  const size_t bytes = 3 * static_cast<size_t>(width);
  for (size_t y = 0; y < static_cast<size_t>(row.height); ++y) {
    const size_t from = 3 * (y * static_cast<size_t>(row.width) + static_cast<size_t>(x0));
    std::copy_n(row.pixels.begin() + static_cast<ptrdiff_t>(from), bytes,
                part.pixels.begin() + static_cast<ptrdiff_t>(y * bytes));
  }
  return part;
}

std::vector<uint8_t> read_mask(const fs::path& file, int width, int height) {
  std::error_code ignored;
  if (!fs::exists(file, ignored)) return {};
  Image8 mask = read_image_8bit(file);
  if (mask.width != width || mask.height != height || mask.channels != 1)
    throw Error("is no mask of the picture's size", file.string());
  return std::move(mask.pixels);
}

}  // namespace

Image8 error_picture(const Image8& truth, const Image8& rendering,
                     const std::vector<uint8_t>& mask) {
  NERF_CHECK(truth.width == rendering.width && truth.height == rendering.height);
  NERF_CHECK(truth.channels == 3 && rendering.channels == 3);
  const size_t pixels = truth.pixels.size() / 3;
  NERF_CHECK(mask.empty() || mask.size() == pixels);
  // A table of the colours: of three channels there are 3 x 255 + 1 sums.
  std::vector<uint8_t> colours(3 * (3 * 255 + 1));
  for (size_t sum = 0; sum * 3 < colours.size(); ++sum) {
    const Vec3 c = turbo_color(static_cast<Real>(static_cast<double>(sum) / 765 / kLargestError));
    for (int k = 0; k < 3; ++k)
      colours[3 * sum + static_cast<size_t>(k)] =
          static_cast<uint8_t>(std::lround(255 * std::clamp<double>(c[k], 0, 1)));
  }
  Image8 out{truth.width, truth.height, 3, {}};
  out.pixels.assign(3 * pixels, kMasked);
  for (size_t i = 0; i < pixels; ++i) {
    if (!mask.empty() && mask[i] == 0) continue;
    size_t sum = 0;
    for (size_t k = 3 * i; k < 3 * i + 3; ++k)
      sum += static_cast<size_t>(std::abs(int{truth.pixels[k]} - int{rendering.pixels[k]}));
    std::copy_n(colours.begin() + static_cast<ptrdiff_t>(3 * sum), 3,
                out.pixels.begin() + static_cast<ptrdiff_t>(3 * i));
  }
  return out;
}

Image8 reduced(const Image8& image, int factor) {
  NERF_CHECK(factor >= 1 && factor <= image.width && factor <= image.height);
  if (factor == 1) return image;
  Image8 out{image.width / factor, image.height / factor, image.channels, {}};
  const size_t channels = static_cast<size_t>(image.channels), f = static_cast<size_t>(factor);
  const size_t stride = channels * static_cast<size_t>(image.width), area = f * f;
  for (size_t y = 0; y < static_cast<size_t>(out.height); ++y)
    for (size_t x = 0; x < static_cast<size_t>(out.width); ++x)
      for (size_t k = 0; k < channels; ++k) {
        size_t sum = area / 2;
        for (size_t i = 0; i < f; ++i)
          for (size_t j = 0; j < f; ++j)
            sum += image.pixels[(y * f + i) * stride + (x * f + j) * channels + k];
        out.pixels.push_back(static_cast<uint8_t>(sum / area));
      }
  return out;
}

ViewPictures view_pictures(const fs::path& file, const fs::path& mask, uint64_t bytes) {
  const Image8 row = read_image_8bit(file);
  const int width = (row.width - 2 * kPictureGap) / 3;
  if (row.channels != 3 || width < 1 || row.width != 3 * width + 2 * kPictureGap)
    throw Error("does not show photo, rendering and depth in a row", file.string());
  const Image8 photo = part_of(row, 0, width);
  const Image8 rendering = part_of(row, width + kPictureGap, width);
  const Image8 depth = part_of(row, 2 * (width + kPictureGap), width);
  const Image8 error = error_picture(photo, rendering, read_mask(mask, width, row.height));
  ViewPictures out;
  out.width = width;
  out.height = row.height;
  const int most = std::min(width, row.height);
  out.factor = std::min(most, (width + kMostPictureWidth - 1) / kMostPictureWidth);
  while (true) {
    const auto jpeg = [&](const Image8& i) { return jpeg_bytes(reduced(i, out.factor), kQuality); };
    out.photo = jpeg(photo);
    out.rendering = jpeg(rendering);
    out.error = jpeg(error);
    out.depth = jpeg(depth);
    const size_t taken =
        out.photo.size() + out.rendering.size() + out.error.size() + out.depth.size();
    if (taken <= bytes || width / (out.factor + 1) < kLeastWidth || out.factor >= most) return out;
    ++out.factor;
  }
}

}  // namespace nerf::apps
