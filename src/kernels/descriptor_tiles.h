// What nearest_descriptors is made of: tiles of dot products that stay in a cache, and the passes
// over a tile that keep the two largest of each row and of each column.
#pragma once

#include <cstdint>

#include "nerf/kernels/descriptors.h"

namespace nerf::internal {

inline constexpr int kTileRows = 16, kTileColumns = 128;

// kTileRows descriptors of `a` as a product reads them; those beyond what was given are 0.
struct alignas(64) DescriptorRows {
  int16_t values[kTileRows * kDescriptorBytes];
  int32_t largest;  // see descriptors_avx2.cc
};

// kTileColumns descriptors of `b` in the order that a product reads them.
struct alignas(64) DescriptorPanel {
  uint16_t values[kTileColumns * kDescriptorBytes];
  int32_t offsets[kTileColumns];  // added to each column's dot products
  int32_t largest;                // see descriptors_avx2.cc
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
  void (*pack_rows)(int64_t rows, const uint8_t* a, DescriptorRows& out);
  void (*pack_columns)(int64_t columns, const uint8_t* b, DescriptorPanel& out);
  void (*multiply)(const DescriptorRows& rows, const DescriptorPanel& panel, DescriptorTile& tile);
};

// Pairs of 16-bit products, on every target.
const DescriptorProducts& word_products();
// Fours of 8-bit products (AVX512-VNNI), where has_byte_products().
bool has_byte_products();
const DescriptorProducts& byte_products();
// Pairs of 8-bit products (AVX2), where has_byte_pair_products().
bool has_byte_pair_products();
const DescriptorProducts& byte_pair_products();
// The fastest that this processor and the target in use have.
const DescriptorProducts& descriptor_products();

// Columns for products of bytes: of each `lanes` columns four bytes of each, then their next four.
// Adds `shift` times the sum of each column to its dot products.
void pack_descriptor_bytes(int64_t columns, const uint8_t* b, int lanes, int32_t shift,
                           DescriptorPanel& out);

// Takes a tile whose first row and column are so many into what is known of its rows and columns.
void take_tile_rows(int64_t rows, const DescriptorTile& tile, int64_t first_column,
                    NearestTwo* of_rows);
void take_tile_columns(const DescriptorTile& tile, int64_t first_row, ColumnsNearest& columns);

void nearest_descriptors(const DescriptorProducts& products, int64_t rows, const uint8_t* a,
                         int64_t columns, const uint8_t* b, NearestTwo* of_rows,
                         NearestTwo* of_columns);

}  // namespace nerf::internal
