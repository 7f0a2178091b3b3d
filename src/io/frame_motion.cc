#include "frame_motion.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace nerf::internal {

namespace {

constexpr int kLength = 120, kBlock = 12, kReach = 6;  // pixels of the small copy
constexpr int kPixels = kBlock * kBlock;
constexpr int64_t kTexture = 16;  // variance of a block from which on it can be told from others

struct Shift {
  int x, y;
};

// Nearest first, so that of equal places the nearest counts.
const std::vector<Shift>& shifts() {
  static const std::vector<Shift> all = [] {
    std::vector<Shift> out;
    for (int y = -kReach; y <= kReach; ++y)
      for (int x = -kReach; x <= kReach; ++x) out.push_back({x, y});
    std::ranges::stable_sort(out, {}, [](const Shift& s) { return s.x * s.x + s.y * s.y; });
    return out;
  }();
  return all;
}

// Means of step x step pixels.
std::vector<uint8_t> reduced(std::span<const uint8_t> grey, int width, int step, int w, int h) {
  std::vector<uint8_t> out;
  out.reserve(static_cast<size_t>(w) * static_cast<size_t>(h));
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      int sum = 0;
      for (int j = 0; j < step; ++j) {
        const uint8_t* row = grey.data() + static_cast<size_t>(y * step + j) * width + x * step;
        for (int i = 0; i < step; ++i) sum += row[i];
      }
      out.push_back(static_cast<uint8_t>(sum / (step * step)));
    }
  return out;
}

// kPixels times the variance of a - b, or of a where b is none.
int64_t variance(const uint8_t* a, const uint8_t* b, int stride) {
  int sum = 0, squares = 0;
  for (int y = 0; y < kBlock; ++y)
    for (int x = 0; x < kBlock; ++x) {
      const int d = a[y * stride + x] - (b ? b[y * stride + x] : 0);
      sum += d;
      squares += d * d;
    }
  return squares - static_cast<int64_t>(sum) * sum / kPixels;
}

}  // namespace

double FrameMotion::add(std::span<const uint8_t> grey, int width, int height) {
  const int step = std::max(1, std::max(width, height) / kLength);
  const int w = width / step, h = height / step;
  std::vector<uint8_t> now = reduced(grey, width, step, w, h);
  double sum = 0;
  int textured = 0, blocks = 0;
  if (before_.size() == now.size() && before_width_ == w) {
    for (int y = kReach; y + kBlock + kReach <= h; y += kBlock)
      for (int x = kReach; x + kBlock + kReach <= w; x += kBlock) {
        const auto at = [&](const std::vector<uint8_t>& picture, const Shift& shift) {
          return picture.data() + (y + shift.y) * w + x + shift.x;
        };
        const uint8_t* block = at(now, {0, 0});
        const int64_t texture = variance(block, nullptr, w);
        if (texture < kTexture * kPixels) continue;
        ++textured;
        int64_t least = INT64_MAX;
        Shift found{};
        for (const Shift& shift : shifts()) {
          const int64_t difference = variance(block, at(before_, shift), w);
          if (difference >= least) continue;
          least = difference;
          found = shift;
        }
        if (2 * least > texture) continue;  // it is not there: covered, or blurred away
        sum += std::hypot(found.x, found.y);
        ++blocks;
      }
  }
  before_ = std::move(now);
  before_width_ = w;
  // Most of the picture is not where it could be: it moved further than that.
  if (4 * blocks < textured) return static_cast<double>(kReach) / std::max(w, h);
  return blocks == 0 ? 0 : sum / blocks / std::max(w, h);
}

}  // namespace nerf::internal
