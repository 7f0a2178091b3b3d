// Nearest neighbours among descriptors of features by their dot products, every pair of them: a
// product of two matrices of bytes that is never stored. Dispatched as the kernels are (simd.h).
// One thread each.
#pragma once

#include <cstdint>

namespace nerf {

inline constexpr int kDescriptorBytes = 128;  // SIFT's: 4 x 4 histograms of 8 directions

// The two largest dot products of a descriptor with others.
struct NearestTwo {
  int32_t best = 0;    // 0 where all are 0
  int32_t second = 0;  // equal to `best` where two share it
  int32_t index = -1;  // of the best, the first where several share it; -1 where all are 0

  friend bool operator==(const NearestTwo&, const NearestTwo&) = default;
};

// a [rows x kDescriptorBytes] and b [columns x kDescriptorBytes], row after row, unaligned.
// of_rows [rows]: each descriptor of `a` among those of `b`; of_columns [columns]: the other way
// round. Sums are integers and exact; all targets give the same bits.
void nearest_descriptors(int64_t rows, const uint8_t* a, int64_t columns, const uint8_t* b,
                         NearestTwo* of_rows, NearestTwo* of_columns);

}  // namespace nerf
