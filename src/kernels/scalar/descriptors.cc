#include "nerf/kernels/descriptors.h"

#include "nerf/math/reference/descriptors.h"

namespace nerf {

void nearest_descriptors(int64_t rows, const uint8_t* a, int64_t columns, const uint8_t* b,
                         NearestTwo* of_rows, NearestTwo* of_columns) {
  reference::nearest_descriptors(rows, a, columns, b, kDescriptorBytes, of_rows, of_columns);
}

}  // namespace nerf
