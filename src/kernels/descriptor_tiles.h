// What nearest_descriptors is made of: tiles of dot products that stay in a cache, and the passes
// over a tile that keep the two largest of each row and of each column.
#pragma once

#include <cstdint>

#include "nerf/kernels/descriptors.h"

namespace nerf::internal {

inline constexpr int kTileRows = 16, kTileColumns = 128;

// kTileColumns descriptors in the order that a product reads them.
struct alignas(64) DescriptorPanel {
  uint16_t values[kTileColumns * kDescriptorBytes];
  int32_t offsets[kTileColumns];  // added to each column's dot products
};

struct alignas(64) DescriptorTile {
  int32_t dots[kTileRows][kTileColumns];
};

// The two largest of each column of a panel so far.
struct alignas(64) ColumnsNearest {
  int32_t best[kTileColumns] = {}, second[kTileColumns] = {}, index[kTileColumns];
};

// A way to multiply. Rows and columns beyond those given have products of 0.
struct DescriptorProducts {
  void (*pack)(int64_t columns, const uint8_t* b, DescriptorPanel& panel);
  void (*multiply)(int64_t rows, const uint8_t* a, const DescriptorPanel& panel,
                   DescriptorTile& tile);
};

// Pairs of 16-bit products, on every target.
void pack_descriptor_words(int64_t columns, const uint8_t* b, DescriptorPanel& panel);
void multiply_descriptor_words(int64_t rows, const uint8_t* a, const DescriptorPanel& panel,
                               DescriptorTile& tile);
inline constexpr DescriptorProducts kWordProducts{pack_descriptor_words, multiply_descriptor_words};

// Fours of 8-bit products (AVX512-VNNI), where has_byte_products().
bool has_byte_products();
void pack_descriptor_bytes(int64_t columns, const uint8_t* b, DescriptorPanel& panel);
void multiply_descriptor_bytes(int64_t rows, const uint8_t* a, const DescriptorPanel& panel,
                               DescriptorTile& tile);
inline constexpr DescriptorProducts kByteProducts{pack_descriptor_bytes, multiply_descriptor_bytes};

// Takes a tile whose first row and column are so many into what is known of its rows and columns.
void take_tile_rows(int64_t rows, const DescriptorTile& tile, int64_t first_column,
                    NearestTwo* of_rows);
void take_tile_columns(const DescriptorTile& tile, int64_t first_row, ColumnsNearest& columns);

void nearest_descriptors(const DescriptorProducts& products, int64_t rows, const uint8_t* a,
                         int64_t columns, const uint8_t* b, NearestTwo* of_rows,
                         NearestTwo* of_columns);

}  // namespace nerf::internal
