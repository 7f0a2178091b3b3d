// What stands between linear_bf16.cc and the sources that see bf16 instructions. Those are compiled
// for processors that few have, so that this header has plain data only: no function of it may be
// emitted there and then be used everywhere.
#pragma once

#include <cstdint>

namespace nerf {
enum class Bf16Unit;
}

namespace nerf::internal {

// Blocks of the left factor: 16 rows x 32 elements of depth, row by row; of the right one: 16 pairs
// of depth x 16 columns, the two elements of a pair side by side. Both are a tile of AMX.
// The AVX-512 product stores its sums after kBf16MostBlocks of depth, so that a strip of three
// blocks of columns leaves room in a first-level cache of 32 KB.
enum : int64_t {
  kBf16Rows = 16,
  kBf16Columns = 16,
  kBf16Depth = 32,
  kBf16Block = 512,
  kBf16MostBlocks = 8
};

enum class Bf16Epilogue { kNone, kRelu, kMask, kAdd };

// out[r][c] = sum_k a[r][k] b[k][c], then + bias[r] (unless null) and the epilogue: ReLU, 0 where
// mask[r][c] is not above 0, or added to what stands in out. Output and mask are rows of floats, or
// pairs (nerf/kernels/linear_bf16.h); the output pairs with kNone and kRelu only, and for a depth
// of up to kBf16MostBlocks.
struct Bf16Product {
  const uint16_t* a = nullptr;  // [row block][depth block][16][32]
  const uint16_t* b = nullptr;  // [column block][depth block][16][16][2]
  int64_t rows = 0;             // that are stored; blocks are whole
  int64_t column_blocks = 0, depth_blocks = 0;
  int64_t depth_pairs = 0;  // that are not all zero: what is beyond may be left out
  float* out = nullptr;
  int64_t ld = 0;  // of out and mask
  const float* bias = nullptr;
  const float* mask = nullptr;
  uint16_t* out_pairs = nullptr;         // in place of out
  const uint16_t* mask_pairs = nullptr;  // in place of mask
  int64_t pairs_stride = 0;              // of both: elements between blocks of columns
  Bf16Epilogue epilogue = Bf16Epilogue::kNone;
};

void bf16_product_avx512(const Bf16Product& p);
void bf16_product_amx(const Bf16Product& p);

// Blocks of the left factor from rows of `depth` floats (readable and 0 up to a multiple of 16).
void bf16_pack_rows(int64_t rows, int64_t depth, const float* x, int64_t ld, uint16_t* out);
// Blocks of the right factor: depth rows x 16 column_blocks columns of x.
void bf16_pack_pairs(int64_t depth, int64_t column_blocks, const float* x, int64_t ld,
                     uint16_t* out);
// The same for the transpose: x has `columns` rows of `depth` floats, as bf16_pack_rows() takes
// them.
void bf16_pack_pairs_transposed(int64_t columns, int64_t depth, const float* x, int64_t ld,
                                uint16_t* out);

// Blocks of the right factor from the pairs of `rows` rows, whose blocks of columns are `stride`
// elements apart: the transpose, `columns` of them, a multiple of 16, along the depth.
void bf16_transpose_pairs(int64_t rows, int64_t columns, const uint16_t* pairs, int64_t stride,
                          uint16_t* out);

// FLOPs done by `rounds` of the instruction on registers (peak.h).
int64_t bf16_loop_avx512(int64_t rounds, float* sink);
int64_t bf16_loop_amx(int64_t rounds, float* sink);

// bf16_unit() for kernels, which run only where the target has it: the unit alone, found at once.
Bf16Unit chosen_bf16_unit();

// Asks the system for tiles, for all threads of the process; false where it refuses.
bool request_amx();

}  // namespace nerf::internal
