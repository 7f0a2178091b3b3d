#include "sharpness.h"

#include <algorithm>
#include <charconv>
#include <string_view>

#include "nerf/base/error.h"
#include "scene_limits.h"

namespace nerf::internal {

double sharpness(std::span<const uint8_t> grey, int width, int height) {
  if (width < 3 || height < 3) return 0;
  const auto stride = static_cast<size_t>(width);
  int64_t sum = 0, squares = 0;
  for (size_t y = 1; y + 1 < static_cast<size_t>(height); ++y) {
    const uint8_t* row = grey.data() + y * stride;
    int64_t row_sum = 0, row_squares = 0;
    for (size_t x = 1; x + 1 < stride; ++x) {
      const int v = 4 * row[x] - row[x - 1] - row[x + 1] - *(row + x - stride) - row[x + stride];
      row_sum += v;
      row_squares += v * v;
    }
    sum += row_sum;
    squares += row_squares;
  }
  const double count = static_cast<double>(width - 2) * (height - 2);
  const double mean = static_cast<double>(sum) / count;
  return static_cast<double>(squares) / count - mean * mean;
}

std::vector<int> sharpest_of_windows(std::span<const double> scores, int max_frames) {
  const auto count = static_cast<int64_t>(scores.size());
  const int64_t windows = std::min<int64_t>(count, max_frames);
  std::vector<int> result;
  for (int64_t w = 0; w < windows; ++w) {
    const auto begin = scores.begin() + w * count / windows;
    const auto end = scores.begin() + (w + 1) * count / windows;
    result.push_back(static_cast<int>(std::max_element(begin, end) - scores.begin()));
  }
  return result;
}

void GreyStream::add(std::span<const uint8_t> bytes) {
  pending_.insert(pending_.end(), bytes.begin(), bytes.end());
  if (width_ == 0 && !take_header()) return;
  while (take_frame()) {
  }
  pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(used_));
  used_ = 0;
}

// "YUV4MPEG2 W640 H480 F30:1 ... Cmono ...\n"
bool GreyStream::take_header() {
  constexpr size_t kLongestHeader = 4096;
  const auto end = std::find(pending_.begin(), pending_.end(), uint8_t{'\n'});
  if (end == pending_.end() && pending_.size() < kLongestHeader) return false;
  std::string_view header(reinterpret_cast<const char*>(pending_.data()),
                          static_cast<size_t>(end - pending_.begin()));
  const auto number_after = [&](const char* name) {
    const size_t at = header.find(name);
    int value = 0;
    if (at != std::string_view::npos) {
      std::from_chars(header.data() + at + 2, header.data() + header.size(), value);
    }
    return value;
  };
  const int width = number_after(" W"), height = number_after(" H");
  if (!header.starts_with("YUV4MPEG2") || header.find(" Cmono") == std::string_view::npos ||
      width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide) {
    throw Error("ffmpeg gave no grey frames but: " + std::string(header.substr(0, 80)));
  }
  if (end == pending_.end()) throw Error("ffmpeg's header has no end");
  width_ = width;
  height_ = height;
  used_ = header.size() + 1;
  return true;
}

// "FRAME...\n" and the pixels.
bool GreyStream::take_frame() {
  const auto begin = pending_.begin() + static_cast<std::ptrdiff_t>(used_);
  const auto line_end = std::find(begin, pending_.end(), uint8_t{'\n'});
  if (line_end == pending_.end()) return false;
  const size_t pixels = static_cast<size_t>(width_) * static_cast<size_t>(height_);
  const size_t first = static_cast<size_t>(line_end - pending_.begin()) + 1;
  if (pending_.size() - first < pixels) return false;
  scores_.push_back(
      sharpness(std::span<const uint8_t>(pending_).subspan(first, pixels), width_, height_));
  used_ = first + pixels;
  return true;
}

}  // namespace nerf::internal
