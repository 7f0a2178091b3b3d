#include "model/baked_occupancy.h"

#include <algorithm>
#include <memory>

#include "nerf/base/error.h"
#include "nerf/math/random.h"

namespace nerf::internal {

namespace {

constexpr Real kEmptyThickness = 1e-3_r;  // optical, of a cell's width

// Each cell becomes the largest of itself and its neighbours along one axis.
void grow(std::vector<uint8_t>& cells, int64_t first, int64_t stride, ThreadPool& pool) {
  constexpr int64_t n = BakedOccupancy::kSide;
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

double BakedOccupancy::occupied_fraction() const {
  return static_cast<double>(std::ranges::count(last_, uint8_t{1})) /
         static_cast<double>(last_.size());
}

namespace {

// Of one level's network.
std::vector<uint8_t> bake_level(const NetworkField& field, int level, ThreadPool& pool,
                                const Cancel* cancel) {
  constexpr int64_t kSide = BakedOccupancy::kSide, kCells = BakedOccupancy::kCells;
  constexpr int kCascades = BakedOccupancy::kCascades, kPoints = BakedOccupancy::kPoints;
  constexpr int kBlock = 256;  // points of a network call
  constexpr int kCellsPerBlock = kBlock / kPoints;
  struct Worker {
    Worker(const NetworkField& f, int level)
        : tape(f.options, f.network_of(level), kBlock, 1, NetworkTape::Purpose::kDensity, {}),
          chunk(tape.tape) {
      chunk.weights = f.weights.data();
      chunk.rays = 1;
      for (int k = 0; k < 3; ++k)
        chunk.data(tape.directions)[k * chunk.stride(tape.directions)] = 0;
    }
    NetworkTape tape;
    Chunk chunk;
  };
  std::vector<uint8_t> out(static_cast<size_t>(kCascades * kCells), 0);
  std::vector<std::unique_ptr<Worker>> workers(static_cast<size_t>(pool.size()));
  for (int cascade = 0; cascade < kCascades; ++cascade) {
    const Real w = baked_cell_width(BakedOccupancy::kSide, cascade);
    pool.parallel_for_thread(kCells / kCellsPerBlock, [&](int64_t block, int thread) {
      if (cancel && cancel->requested()) throw Cancelled();
      auto& own = workers[static_cast<size_t>(thread)];
      if (!own) own = std::make_unique<Worker>(field, level);
      Chunk& c = own->chunk;
      const int64_t ld = c.stride(own->tape.position);
      Real* position = c.data(own->tape.position);
      int64_t cells[kCellsPerBlock];
      int count = 0;
      for (int64_t cell = block * kCellsPerBlock; cell < (block + 1) * kCellsPerBlock; ++cell) {
        const int64_t at[3] = {cell % kSide, cell / kSide % kSide, cell / (kSide * kSide)};
        // A finer grid answers for the middle of the coarser one.
        const bool inner = std::ranges::all_of(at, [](int64_t i) {
          constexpr int64_t kBorder = BakedOccupancy::kSide / 4;
          return i >= kBorder && i < BakedOccupancy::kSide - kBorder;
        });
        if (cascade > 0 && inner) continue;
        Random random(1, static_cast<uint64_t>(cascade), static_cast<uint64_t>(cell));
        for (int i = 0; i < kPoints; ++i)
          for (int k = 0; k < 3; ++k)
            position[k * ld + count * kPoints + i] =
                (static_cast<Real>(at[k] - kSide / 2) + random.uniform()) * w;
        cells[count++] = cell;
      }
      if (count == 0) return;
      c.samples = count * kPoints;
      const int32_t ray_begin[2] = {0, c.samples};
      c.ray_begin = ray_begin;
      std::fill_n(c.data(own->tape.delta), c.samples, w);
      own->tape.forward_weights(c);
      const Real* density = c.data(own->tape.density);
      for (int i = 0; i < count; ++i)
        for (int k = 0; k < kPoints; ++k)
          if (!(density[i * kPoints + k] * w < kEmptyThickness))
            out[static_cast<size_t>(cascade * kCells + cells[i])] = 1;
    });
    for (int64_t stride : {int64_t{1}, kSide, kSide * kSide})
      grow(out, cascade * kCells, stride, pool);
  }
  return out;
}

}  // namespace

BakedOccupancy bake_occupancy(const NetworkField& field, ThreadPool& pool, const Cancel* cancel) {
  NERF_CHECK(field.options.cast == Cast::kPoint && !field.options.integrated());
  BakedOccupancy out;
  out.last_ = bake_level(field, field.options.sampling.levels() - 1, pool, cancel);
  if (field.networks.size() > 1) out.before_ = bake_level(field, 0, pool, cancel);
  return out;
}

}  // namespace nerf::internal
