#include "nerf/io/depth_legend.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>

#include "nerf/base/error.h"

namespace nerf {

namespace {

// Letters are 5 x 7 dots; a row's bits from the left.
constexpr int kLetterWidth = 5, kLetterHeight = 7, kAdvance = 6;

struct Letter {
  char name;
  std::array<uint8_t, kLetterHeight> rows;
};
constexpr Letter kLetters[] = {{'0', {0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e}},
                               {'1', {0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e}},
                               {'2', {0x0e, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1f}},
                               {'3', {0x1f, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0e}},
                               {'4', {0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02}},
                               {'5', {0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e}},
                               {'6', {0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e}},
                               {'7', {0x1f, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08}},
                               {'8', {0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e}},
                               {'9', {0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c}},
                               {'.', {0x00, 0x00, 0x00, 0x00, 0x00, 0x0c, 0x0c}},
                               {'-', {0x00, 0x00, 0x00, 0x1f, 0x00, 0x00, 0x00}},
                               {'+', {0x00, 0x04, 0x04, 0x1f, 0x04, 0x04, 0x00}},
                               {'e', {0x00, 0x00, 0x0e, 0x11, 0x1f, 0x10, 0x0e}},
                               {'d', {0x01, 0x01, 0x0d, 0x13, 0x11, 0x11, 0x0f}},
                               {'p', {0x00, 0x00, 0x1e, 0x11, 0x1e, 0x10, 0x10}},
                               {'t', {0x08, 0x08, 0x1c, 0x08, 0x08, 0x09, 0x06}},
                               {'h', {0x10, 0x10, 0x16, 0x19, 0x11, 0x11, 0x11}},
                               {'u', {0x00, 0x00, 0x11, 0x11, 0x11, 0x13, 0x0d}},
                               {'n', {0x00, 0x00, 0x16, 0x19, 0x11, 0x11, 0x11}},
                               {'i', {0x04, 0x00, 0x0c, 0x04, 0x04, 0x04, 0x0e}},
                               {'s', {0x00, 0x00, 0x0e, 0x10, 0x0e, 0x01, 0x1e}}};

constexpr int kColumns = 9;  // of text: a number of three digits with sign and exponent
constexpr int kBar = 10, kGap = 3, kTicks = 5;

// Dots of a letter's dot.
int scale_of(int height) { return std::max(1, height / 360); }

void fill(Image8& image, int x, int y, int width, int height, const std::array<uint8_t, 3>& color) {
  for (int v = std::max(0, y); v < std::min(y + height, image.height); ++v)
    for (int u = std::max(0, x); u < std::min(x + width, image.width); ++u)
      std::copy_n(color.data(), 3,
                  image.pixels.data() + 3 * (static_cast<size_t>(v) * image.width + u));
}

void write(Image8& image, int x, int y, int scale, std::string_view text) {
  for (const char c : text) {
    const auto* const letter = std::ranges::find(kLetters, c, &Letter::name);
    if (letter != std::end(kLetters))
      for (int row = 0; row < kLetterHeight; ++row)
        for (int column = 0; column < kLetterWidth; ++column)
          if (letter->rows[static_cast<size_t>(row)] >> (kLetterWidth - 1 - column) & 1)
            fill(image, x + column * scale, y + row * scale, scale, scale, {255, 255, 255});
    x += kAdvance * scale;
  }
}

}  // namespace

int legend_width(int height) { return (kBar + 3 * kGap + kColumns * kAdvance) * scale_of(height); }

Image8 with_legend(const Image8& picture, const DepthRange& range, DepthLook map) {
  NERF_CHECK_EQ(picture.channels, 3);
  const int scale = scale_of(picture.height), line = (kLetterHeight + kGap) * scale;
  Image8 out{picture.width + legend_width(picture.height), picture.height, 3, {}};
  out.pixels.resize(3 * static_cast<size_t>(out.width) * static_cast<size_t>(out.height));
  const size_t row = 3 * static_cast<size_t>(picture.width);
  for (int y = 0; y < out.height; ++y)
    std::copy_n(picture.pixels.data() + static_cast<size_t>(y) * row, row,
                out.pixels.data() + 3 * static_cast<size_t>(y) * static_cast<size_t>(out.width));
  if (range.empty()) return out;

  const int left = picture.width + kGap * scale;
  write(out, left, kGap * scale, scale, "depth");
  write(out, left, kGap * scale + line, scale, "units");
  const int top = 2 * line + 2 * kGap * scale, bottom = out.height - kGap * scale;
  const int height = bottom - top;
  if (height < 2) return out;
  const double lowest = 1 / range.far, span = 1 / std::max(range.near, 1e-12) - lowest;
  for (int y = 0; y < height; ++y) {
    const Vec3 color = depth_color(map, 1 - static_cast<Real>(y) / static_cast<Real>(height - 1));
    std::array<uint8_t, 3> bytes;
    for (int c = 0; c < 3; ++c)
      bytes[static_cast<size_t>(c)] = static_cast<uint8_t>(std::lround(color[c] * 255.0_r));
    fill(out, left, top + y, kBar * scale, 1, bytes);
  }
  // As many numbers as have room.
  const int ticks = std::clamp(height / line, 2, kTicks);
  for (int i = 0; i < ticks; ++i) {
    const double share = static_cast<double>(i) / (ticks - 1);  // from the near end
    const int y = top + static_cast<int>(std::lround(share * (height - 1)));
    fill(out, left + (kBar - 2) * scale, y, 4 * scale, 1, {255, 255, 255});
    const int text = std::clamp(y - kLetterHeight * scale / 2, top, bottom - kLetterHeight * scale);
    write(out, left + (kBar + kGap) * scale, text, scale,
          fmt::format("{:.3g}", 1 / (lowest + (1 - share) * span)));
  }
  return out;
}

}  // namespace nerf
