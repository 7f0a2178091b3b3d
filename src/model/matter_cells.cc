#include "model/matter_cells.h"

namespace nerf::internal {

namespace {

// Along one axis.
void grow_along(std::vector<uint8_t>& cells, int64_t n, int64_t first, int64_t stride,
                ThreadPool& pool) {
  pool.parallel_for(n, [&](int64_t a) {
    std::vector<uint8_t> line(static_cast<size_t>(n));
    for (int64_t b = 0; b < n; ++b) {
      // The two other axes, whichever they are.
      const int64_t low = stride == 1 ? n : 1, high = stride == n * n ? n : n * n;
      const int64_t begin = first + a * low + b * high;
      for (int64_t i = 0; i < n; ++i)
        line[static_cast<size_t>(i)] = cells[static_cast<size_t>(begin + i * stride)];
      for (int64_t i = 0; i < n; ++i) {
        uint8_t most = line[static_cast<size_t>(i)];
        if (i > 0) most |= line[static_cast<size_t>(i - 1)];
        if (i + 1 < n) most |= line[static_cast<size_t>(i + 1)];
        cells[static_cast<size_t>(begin + i * stride)] = most;
      }
    }
  });
}

}  // namespace

void MatterCells::grow(std::vector<uint8_t>& cells, int side, int64_t first, ThreadPool& pool) {
  const int64_t n = side;
  for (const int64_t stride : {int64_t{1}, n, n * n}) grow_along(cells, n, first, stride, pool);
}

double MatterCells::occupied_fraction() const {
  return static_cast<double>(std::ranges::count(last_, uint8_t{1})) /
         static_cast<double>(last_.size());
}

}  // namespace nerf::internal
