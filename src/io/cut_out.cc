#include "cut_out.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "half.h"

namespace nerf::internal {
namespace {

// Levels of 255 by which a background's pixel may differ in some channel, and those of a speck.
constexpr int kTolerance = 6, kSpeckTolerance = 32;
constexpr size_t kSpeckPixels = 64;
constexpr int kEdge = 2;            // pixels from the background whose colour may be mixed
constexpr int kLeastContrast = 24;  // of matter with its background, to tell how much is mixed

float number(const StoredImage& image, size_t pixel, size_t channel) {
  const size_t in = static_cast<size_t>(image.channels);
  return image.sample(pixel * in + (in < 3 ? 0 : channel));
}

// Of each pixel, levels: the largest difference from the colour of any channel.
std::vector<uint8_t> differences(const StoredImage& image, const Rgb8& colour) {
  const size_t count = static_cast<size_t>(image.width) * static_cast<size_t>(image.height);
  std::vector<uint8_t> out(count);
  for (size_t i = 0; i < count; ++i) {
    float most = 0;
    for (size_t c = 0; c < 3; ++c)
      most = std::max(most, std::fabs(255 * number(image, i, c) - static_cast<float>(colour[c])));
    out[i] = static_cast<uint8_t>(std::min(std::round(most), 255.0f));
  }
  return out;
}

// Marks what `joins` joins to the pixel `from` through neighbours in rows and columns, and that
// pixel itself; returns the marked ones.
template <class Joins>
std::vector<size_t> flood(int width, int height, size_t from, std::vector<uint8_t>& marks,
                          uint8_t mark, Joins&& joins) {
  std::vector<size_t> reached{from};
  marks[from] = mark;
  const size_t w = static_cast<size_t>(width), h = static_cast<size_t>(height);
  for (size_t next = 0; next < reached.size(); ++next) {
    const size_t at = reached[next], x = at % w, y = at / w;
    const auto step = [&](bool inside, size_t to) {
      if (!inside || marks[to] == mark || !joins(to)) return;
      marks[to] = mark;
      reached.push_back(to);
    };
    step(x > 0, at - 1);
    step(x + 1 < w, at + 1);
    step(y > 0, at - w);
    step(y + 1 < h, at + w);
  }
  return reached;
}

std::vector<uint8_t> background_of(const StoredImage& image,
                                   const std::vector<uint8_t>& difference) {
  constexpr uint8_t kMatter = 0, kBackground = 1, kVisited = 2;
  const size_t w = static_cast<size_t>(image.width), h = static_cast<size_t>(image.height);
  std::vector<uint8_t> marks(w * h, kMatter);
  const auto is_like = [&](size_t i) { return difference[i] <= kTolerance; };
  const auto begin_at = [&](size_t i) {
    if (marks[i] == kMatter && is_like(i))
      flood(image.width, image.height, i, marks, kBackground, is_like);
  };
  for (size_t x = 0; x < w; ++x) {
    begin_at(x);
    begin_at((h - 1) * w + x);
  }
  for (size_t y = 0; y < h; ++y) {
    begin_at(y * w);
    begin_at(y * w + w - 1);
  }
  for (size_t i = 0; i < marks.size(); ++i) {
    if (marks[i] != kMatter) continue;
    const std::vector<size_t> part = flood(image.width, image.height, i, marks, kVisited,
                                           [&](size_t to) { return marks[to] == kMatter; });
    if (part.size() > kSpeckPixels) continue;
    const bool is_speck =
        std::ranges::all_of(part, [&](size_t at) { return difference[at] <= kSpeckTolerance; });
    // One in the background, not a part of it that matter encloses.
    if (is_speck && std::ranges::any_of(part, [&](size_t at) { return !is_like(at); }))
      for (const size_t at : part) marks[at] = kBackground;
  }
  for (uint8_t& m : marks) m = m == kBackground ? 1 : 0;
  return marks;
}

// Share of matter in the pixel's colour. Its own is taken to be that of what differs most nearby.
float share_of_matter(const StoredImage& image, const std::vector<uint8_t>& background,
                      const std::vector<uint8_t>& difference, const Rgb8& colour, int x, int y) {
  const int w = image.width, h = image.height;
  bool at_edge = false;
  int most = 0;
  for (int v = std::max(0, y - kEdge); v <= std::min(h - 1, y + kEdge); ++v)
    for (int u = std::max(0, x - kEdge); u <= std::min(w - 1, x + kEdge); ++u) {
      const size_t at = static_cast<size_t>(v) * static_cast<size_t>(w) + static_cast<size_t>(u);
      at_edge = at_edge || background[at];
      if (!background[at]) most = std::max(most, static_cast<int>(difference[at]));
    }
  if (!at_edge || most < kLeastContrast) return 1;
  const size_t pixel = static_cast<size_t>(y) * static_cast<size_t>(w) + static_cast<size_t>(x);
  float share = static_cast<float>(difference[pixel]) / static_cast<float>(most);
  // No less than what leaves the matter's colour between black and white.
  for (size_t c = 0; c < 3; ++c) {
    const float b = static_cast<float>(colour[c]) / 255, off = number(image, pixel, c) - b;
    if (off > 0) share = std::max(share, b < 1 ? off / (1 - b) : 1.0f);
    if (off < 0) share = std::max(share, b > 0 ? -off / b : 1.0f);
  }
  return std::min(share, 1.0f);
}

void put(StoredImage& image, size_t i, float value) {
  value = std::max(value, 0.0f);
  if (image.type == SampleType::k8)
    image.samples8[i] = static_cast<uint8_t>(std::lround(255 * std::min(value, 1.0f)));
  else if (image.type == SampleType::k16)
    image.samples16[i] = static_cast<uint16_t>(std::lround(65535 * std::min(value, 1.0f)));
  else
    image.samples16[i] = float_to_half(value);
}

}  // namespace

std::vector<uint8_t> background_of(const StoredImage& image, const Rgb8& colour) {
  return background_of(image, differences(image, colour));
}

void cut_out(StoredImage& image, const Rgb8& colour) {
  const size_t in = static_cast<size_t>(image.channels);
  if (image.has_alpha())
    for (size_t i = in - 1; i < image.samples8.size() + image.samples16.size(); i += in)
      if (image.sample(i) < 1) return;
  const std::vector<uint8_t> difference = differences(image, colour);
  const std::vector<uint8_t> background = background_of(image, difference);
  StoredImage out;
  out.width = image.width;
  out.height = image.height;
  out.channels = 4;
  out.type = image.type;
  const size_t count = 4 * difference.size();
  image.type == SampleType::k8 ? out.samples8.resize(count) : out.samples16.resize(count);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const size_t i =
          static_cast<size_t>(y) * static_cast<size_t>(image.width) + static_cast<size_t>(x);
      const float share =
          background[i] ? 0 : share_of_matter(image, background, difference, colour, x, y);
      for (size_t c = 0; c < 3; ++c) {
        const float b = static_cast<float>(colour[c]) / 255, stored = number(image, i, c);
        put(out, 4 * i + c, share > 0 ? b + (stored - b) / share : stored);
      }
      put(out, 4 * i + 3, share);
    }
  image = std::move(out);
}

}  // namespace nerf::internal
