#include "nerf/kernels/descriptors.h"

#include <algorithm>
#include <memory>

#include "kernels/descriptor_tiles.h"
#include "nerf/kernels/simd.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

namespace nerf {

bool internal::has_byte_products() {
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

void internal::nearest_descriptors(const DescriptorProducts& products, int64_t rows,
                                   const uint8_t* a, int64_t columns, const uint8_t* b,
                                   NearestTwo* of_rows, NearestTwo* of_columns) {
  const auto panel = std::make_unique<DescriptorPanel>();
  DescriptorTile tile;
  std::fill_n(of_rows, rows, NearestTwo());
  for (int64_t c = 0; c < columns; c += kTileColumns) {
    const int64_t width = std::min<int64_t>(kTileColumns, columns - c);
    products.pack(width, b + c * kDescriptorBytes, *panel);
    ColumnsNearest nearest;
    std::fill_n(nearest.index, kTileColumns, -1);
    for (int64_t r = 0; r < rows; r += kTileRows) {
      const int64_t height = std::min<int64_t>(kTileRows, rows - r);
      products.multiply(height, a + r * kDescriptorBytes, *panel, tile);
      take_tile_rows(height, tile, c, of_rows + r);
      take_tile_columns(tile, r, nearest);
    }
    for (int64_t i = 0; i < width; ++i)
      of_columns[c + i] = {nearest.best[i], nearest.second[i], nearest.index[i]};
  }
}

void nearest_descriptors(int64_t rows, const uint8_t* a, int64_t columns, const uint8_t* b,
                         NearestTwo* of_rows, NearestTwo* of_columns) {
  internal::nearest_descriptors(
      internal::has_byte_products() ? internal::kByteProducts : internal::kWordProducts, rows, a,
      columns, b, of_rows, of_columns);
}

#if !defined(__x86_64__)
// Never called: has_byte_products() is false.
void internal::pack_descriptor_bytes(int64_t, const uint8_t*, DescriptorPanel&) {}
void internal::multiply_descriptor_bytes(int64_t, const uint8_t*, const DescriptorPanel&,
                                         DescriptorTile&) {}
#endif

}  // namespace nerf
