#include "nerf/kernels/descriptors.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <vector>

#include "kernels/descriptor_tiles.h"
#include "nerf/kernels/simd.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

namespace nerf {

namespace internal {

bool has_byte_products() {
#if defined(__x86_64__)
  static const bool vnni = [] {
    unsigned a, b, c, d;
    return __get_cpuid_count(7, 0, &a, &b, &c, &d) && (c >> 11 & 1);
  }();
  return vnni && simd_target() == "AVX3";  // the target that its registers belong to
#else
  return false;
#endif
}

bool has_byte_pair_products() { return simd_target() == "AVX2"; }

const DescriptorProducts& descriptor_products() {
  if (has_byte_products()) return byte_products();
  if (has_byte_pair_products()) return byte_pair_products();
  return word_products();
}

void pack_descriptor_bytes(int64_t columns, const uint8_t* b, int lanes, int32_t shift,
                           DescriptorPanel& out) {
  constexpr int kSteps = kDescriptorBytes / 4;
  uint8_t* values = reinterpret_cast<uint8_t*>(out.values);
  for (int c = 0; c < kTileColumns; ++c) {
    uint8_t* to = values + (c / lanes * kSteps * lanes + c % lanes) * 4;
    const uint8_t* from = b + c * kDescriptorBytes;
    int32_t sum = 0;
    for (int k = 0; k < kSteps; ++k) {
      int32_t four = 0;
      if (c < columns) std::memcpy(&four, from + 4 * k, sizeof four);
      std::memcpy(to + k * 4 * lanes, &four, sizeof four);
      for (int i = 0; i < 32; i += 8) sum += four >> i & 255;
    }
    out.offsets[c] = shift * sum;
  }
}

void nearest_descriptors(const DescriptorProducts& products, int64_t rows, const uint8_t* a,
                         int64_t columns, const uint8_t* b, NearestTwo* of_rows,
                         NearestTwo* of_columns) {
  std::vector<DescriptorRows> packed(static_cast<size_t>((rows + kTileRows - 1) / kTileRows));
  for (int64_t r = 0; r < rows; r += kTileRows)
    products.pack_rows(std::min<int64_t>(kTileRows, rows - r), a + r * kDescriptorBytes,
                       packed[static_cast<size_t>(r / kTileRows)]);
  const auto panel = std::make_unique<DescriptorPanel>();
  DescriptorTile tile;
  std::fill_n(of_rows, rows, NearestTwo());
  for (int64_t c = 0; c < columns; c += kTileColumns) {
    const int64_t width = std::min<int64_t>(kTileColumns, columns - c);
    products.pack_columns(width, b + c * kDescriptorBytes, *panel);
    ColumnsNearest nearest;
    std::fill_n(nearest.index, kTileColumns, -1);
    for (int64_t r = 0; r < rows; r += kTileRows) {
      products.multiply(packed[static_cast<size_t>(r / kTileRows)], *panel, tile);
      take_tile_rows(std::min<int64_t>(kTileRows, rows - r), tile, c, of_rows + r);
      take_tile_columns(tile, r, nearest);
    }
    for (int64_t i = 0; i < width; ++i)
      of_columns[c + i] = {nearest.best[i], nearest.second[i], nearest.index[i]};
  }
}

#if !defined(__x86_64__)
// Never called: has_byte_products() and has_byte_pair_products() are false.
const DescriptorProducts& byte_products() { return word_products(); }
const DescriptorProducts& byte_pair_products() { return word_products(); }
#endif

}  // namespace internal

void nearest_descriptors(int64_t rows, const uint8_t* a, int64_t columns, const uint8_t* b,
                         NearestTwo* of_rows, NearestTwo* of_columns) {
  internal::nearest_descriptors(internal::descriptor_products(), rows, a, columns, b, of_rows,
                                of_columns);
}

}  // namespace nerf
