#include "resample.h"

#include <algorithm>

#include "nerf/base/error.h"

namespace nerf::internal {
namespace {

// Result pixel i covers [i * size / new_size, (i + 1) * size / new_size) of the source. In units of
// 1 / new_size both ends, and the part of every source pixel within, are whole numbers.
struct Cover {
  int first = 0, last = 0;  // source pixels, both included
  int64_t first_part = 0, last_part = 0;
};

Cover cover_of(int i, int size, int new_size) {
  const int64_t begin = int64_t{i} * size, end = begin + size;
  Cover cover;
  cover.first = static_cast<int>(begin / new_size);
  cover.last = static_cast<int>((end - 1) / new_size);
  cover.first_part = std::min<int64_t>(end, int64_t{cover.first + 1} * new_size) - begin;
  cover.last_part = end - std::max<int64_t>(begin, int64_t{cover.last} * new_size);
  return cover;
}

float weight(const Cover& cover, int pixel, int size, int new_size) {
  const int64_t part = pixel == cover.first  ? cover.first_part
                       : pixel == cover.last ? cover.last_part
                                             : new_size;
  return static_cast<float>(static_cast<double>(part) / size);
}

}  // namespace

void area_average(int width, int height, int channels, const RowReader& read, int new_width,
                  int new_height, const RowWriter& write) {
  NERF_CHECK(new_width >= 1 && new_width <= width && new_height >= 1 && new_height <= height);
  const auto n = static_cast<size_t>(channels);
  std::vector<Cover> columns;
  std::vector<float> column_weights;  // of every source pixel of every cover, one after another
  for (int x = 0; x < new_width; ++x) {
    columns.push_back(cover_of(x, width, new_width));
    for (int column = columns.back().first; column <= columns.back().last; ++column) {
      column_weights.push_back(weight(columns.back(), column, width, new_width));
    }
  }
  std::vector<float> source(static_cast<size_t>(width) * n), sum(columns.size() * n);
  int held = -1;  // row in `source`
  for (int y = 0; y < new_height; ++y) {
    const Cover rows = cover_of(y, height, new_height);
    std::fill(sum.begin(), sum.end(), 0.0f);
    for (int row = rows.first; row <= rows.last; ++row) {
      if (row != held) read(row, source);
      held = row;
      const float row_weight = weight(rows, row, height, new_height);
      const float* column_weight = column_weights.data();
      for (size_t x = 0; x < columns.size(); ++x) {
        const float* from = &source[static_cast<size_t>(columns[x].first) * n];
        for (int column = columns[x].first; column <= columns[x].last; ++column) {
          const float w = row_weight * *column_weight++;
          for (size_t c = 0; c < n; ++c) sum[x * n + c] += w * *from++;
        }
      }
    }
    write(y, sum);
  }
}

std::vector<uint8_t> resize_nearest(std::span<const uint8_t> pixels, int width, int height,
                                    int new_width, int new_height) {
  NERF_CHECK_EQ(pixels.size(), static_cast<size_t>(width) * static_cast<size_t>(height));
  std::vector<uint8_t> result;
  result.reserve(static_cast<size_t>(new_width) * static_cast<size_t>(new_height));
  for (int y = 0; y < new_height; ++y) {
    const int64_t row = (2 * int64_t{y} + 1) * height / (2 * int64_t{new_height});
    for (int x = 0; x < new_width; ++x) {
      const int64_t column = (2 * int64_t{x} + 1) * width / (2 * int64_t{new_width});
      result.push_back(pixels[static_cast<size_t>(row * width + column)]);
    }
  }
  return result;
}

}  // namespace nerf::internal
