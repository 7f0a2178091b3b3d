// Area average and nearest neighbour, for photos and masks.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace nerf::internal {

// Fills `out` with row y of the source, from the top: width * channels numbers.
using RowReader = std::function<void(int y, std::span<float> out)>;
// Takes row y of the result, from the top: new_width * channels numbers.
using RowWriter = std::function<void(int y, std::span<const float> row)>;

// Every pixel of the result is the mean of the source over the rectangle that it covers, pixels cut
// by its border counted by their covered part. Rows are read once or twice, in order, and only one
// is held at a time. new_width <= width, new_height <= height.
void area_average(int width, int height, int channels, const RowReader& read, int new_width,
                  int new_height, const RowWriter& write);

// The source pixel that the centre of each result pixel falls into.
std::vector<uint8_t> resize_nearest(std::span<const uint8_t> pixels, int width, int height,
                                    int new_width, int new_height);

}  // namespace nerf::internal
