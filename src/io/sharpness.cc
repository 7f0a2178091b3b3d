#include "sharpness.h"

#include <algorithm>
#include <charconv>
#include <numeric>
#include <string_view>

#include "nerf/base/error.h"
#include "scene_limits.h"

namespace nerf::internal {

namespace {

constexpr double kShareOfMotion = 0.75;  // in where a window ends; the rest is of time

}  // namespace

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

std::vector<int> sharpest_of_windows(std::span<const double> scores,
                                     std::span<const double> motions, int max_frames) {
  NERF_CHECK_EQ(scores.size(), motions.size());
  const auto count = static_cast<double>(scores.size());
  const int windows = static_cast<int>(std::min<int64_t>(std::ssize(scores), max_frames));
  const double moved = std::accumulate(motions.begin(), motions.end(), 0.0);
  const double share = moved > 0 && std::ssize(scores) > windows ? kShareOfMotion : 0;
  std::vector<int> result;
  double so_far = 0;
  int window = -1;
  for (size_t i = 0; i < scores.size(); ++i) {
    // Where the frame's middle lies between the beginning of the film, 0, and its end, 1.
    const double at = share * (moved > 0 ? (so_far + motions[i] / 2) / moved : 0) +
                      (1 - share) * ((static_cast<double>(i) + 0.5) / count);
    so_far += motions[i];
    const int now = std::min(static_cast<int>(at * windows), windows - 1);
    if (now > window)
      result.push_back(static_cast<int>(i));
    else if (scores[i] > scores[static_cast<size_t>(result.back())])
      result.back() = static_cast<int>(i);
    window = now;
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
  const auto grey = std::span<const uint8_t>(pending_).subspan(first, pixels);
  scores_.push_back(sharpness(grey, width_, height_));
  motions_.push_back(motion_.add(grey, width_, height_));
  used_ = first + pixels;
  return true;
}

}  // namespace nerf::internal
