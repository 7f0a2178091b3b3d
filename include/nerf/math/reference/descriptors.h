// Specification of nearest_descriptors (kernels/descriptors.h).
#pragma once

#include <cstdint>

namespace nerf::reference {

// Adds the dot product with the `index`-th descriptor to the two largest so far.
template <class Two>
void take_nearest(Two& two, int32_t dot, int32_t index) {
  if (dot > two.best) {
    two = {dot, two.best, index};
  } else if (dot > two.second) {
    two.second = dot;
  }
}

// a [rows x depth], b [columns x depth].
template <class Two>
void nearest_descriptors(int64_t rows, const uint8_t* a, int64_t columns, const uint8_t* b,
                         int64_t depth, Two* of_rows, Two* of_columns) {
  for (int64_t i = 0; i < rows; ++i) of_rows[i] = {};
  for (int64_t j = 0; j < columns; ++j) of_columns[j] = {};
  for (int64_t i = 0; i < rows; ++i)
    for (int64_t j = 0; j < columns; ++j) {
      int32_t dot = 0;
      for (int64_t k = 0; k < depth; ++k) dot += a[i * depth + k] * b[j * depth + k];
      take_nearest(of_rows[i], dot, static_cast<int32_t>(j));
      take_nearest(of_columns[j], dot, static_cast<int32_t>(i));
    }
}

}  // namespace nerf::reference
