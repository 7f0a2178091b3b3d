#include "model/baked_occupancy.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "model/sample_gaussian.h"
#include "nerf/base/error.h"
#include "nerf/kernels/bf16.h"
#include "nerf/math/camera.h"
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

// Rays from the photos' cameras to points of the cells.
class Viewpoints {
 public:
  Viewpoints(const NetworkField& field, const ModelInfo& info)
      : longest_(static_cast<Real>((field.far - field.near) / field.options.sampling.coarse)) {
    for (const ModelView& view : info.views) {
      const Vec2d middle{0.5 * view.camera.width, 0.5 * view.camera.height};
      views_.push_back({info.to_engine.apply(view.pose).translation.cast<Real>(),
                        static_cast<Real>(pixel_cone_radius(view.camera, middle))});
    }
  }

  // What a sample covers that stands at p: [t0, t1] of the ray.
  NetworkRay through(const Vec3& p, bool whole_interval, Random& random, Real& t0, Real& t1) const {
    const View& view = views_[static_cast<size_t>(random.below(views_.size()))];
    NetworkRay ray;
    const Vec3 way = p - view.centre;
    const Real t = std::max(length(way), 1e-6_r);
    ray.origin = view.centre;
    ray.direction = way / t;
    ray.radius = view.radius;
    const Real interval =
        longest_ * (whole_interval ? 1 : std::exp2(-kShortest * random.uniform()));
    t0 = std::max(0.0_r, t - 0.5_r * interval);
    t1 = t + 0.5_r * interval;
    return ray;
  }
  Real longest() const { return longest_; }

 private:
  static constexpr Real kShortest = 5;  // binary logarithm of the longest over the shortest
  struct View {
    Vec3 centre;
    Real radius;
  };
  std::vector<View> views_;
  Real longest_;  // interval of the first level
};

// Of one level's network.
std::vector<uint8_t> bake_level(const NetworkField& field, const ModelInfo& info, int level,
                                const LayerPacks& packs, ThreadPool& pool, const Cancel* cancel) {
  const bool cones = field.options.cast == Cast::kCone;
  const Viewpoints viewpoints(field, info);
  const auto axes = encoding_axes(field.options);
  constexpr int64_t kSide = BakedOccupancy::kSide, kCells = BakedOccupancy::kCells;
  constexpr int kCascades = BakedOccupancy::kCascades, kPoints = BakedOccupancy::kPoints;
  constexpr int kBlock = 256;  // points of a network call
  constexpr int kCellsPerBlock = kBlock / kPoints;
  struct Worker {
    Worker(const NetworkField& f, int level, const LayerPacks& packs)
        : tape(f.options, f.network_of(level), kBlock, 1, NetworkTape::Purpose::kDensity, {}),
          chunk(tape.tape) {
      chunk.weights = f.weights.data();
      chunk.packs = &packs;
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
    const Real way = cones ? viewpoints.longest() : w;
    pool.parallel_for_thread(kCells / kCellsPerBlock, [&](int64_t block, int thread) {
      if (cancel && cancel->requested()) throw Cancelled();
      auto& own = workers[static_cast<size_t>(thread)];
      if (!own) own = std::make_unique<Worker>(field, level, packs);
      Chunk& c = own->chunk;
      const int64_t ld = c.stride(own->tape.position);
      Real* position = c.data(own->tape.position);
      Real* variance = field.options.integrated() ? c.data(own->tape.variance) : nullptr;
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
        for (int i = 0; i < kPoints; ++i) {
          Vec3 p;
          for (int k = 0; k < 3; ++k)
            p[k] = (static_cast<Real>(at[k] - kSide / 2) + random.uniform()) * w;
          const int column = count * kPoints + i;
          if (cones) {
            Real t0, t1;
            const NetworkRay ray = viewpoints.through(p, i == 0, random, t0, t1);
            place_gaussian(field.options, axes, ray, t0, t1, position + column,
                           variance ? variance + column : nullptr, ld);
          } else {
            for (int k = 0; k < 3; ++k) position[k * ld + column] = p[k];
          }
        }
        cells[count++] = cell;
      }
      if (count == 0) return;
      c.samples = count * kPoints;
      const int32_t ray_begin[2] = {0, c.samples};
      c.ray_begin = ray_begin;
      std::fill_n(c.data(own->tape.delta), c.samples, way);
      own->tape.forward_weights(c);
      const Real* density = c.data(own->tape.density);
      for (int i = 0; i < count; ++i)
        for (int k = 0; k < kPoints; ++k)
          if (!(density[i * kPoints + k] * way < kEmptyThickness))
            out[static_cast<size_t>(cascade * kCells + cells[i])] = 1;
    });
    for (int64_t stride : {int64_t{1}, kSide, kSide * kSide})
      grow(out, cascade * kCells, stride, pool);
  }
  return out;
}

}  // namespace

// Not of a scene that moves: a cell would have to be asked at every moment.
bool can_bake(const NetworkField& field, const ModelInfo& info) {
  if (field.options.deform.any()) return false;
  if (field.options.cast == Cast::kPoint) return !field.options.integrated();
  const bool even = field.options.sampling.spacing == Spacing::kUniform;
  return even && field.options.space == Space::kIdentity && !info.views.empty();
}

BakedOccupancy bake_occupancy(const NetworkField& field, const ModelInfo& info, ThreadPool& pool,
                              const Cancel* cancel) {
  NERF_CHECK(can_bake(field, info));
  LayerPacks packs;
  pack_layers(field.layers(), field.weights.data(), Precision::kAuto, packs, pool);
  BakedOccupancy out;
  const int last = field.options.sampling.levels() - 1;
  out.last_ = bake_level(field, info, last, packs, pool, cancel);
  if (field.networks.size() > 1) out.before_ = bake_level(field, info, 0, packs, pool, cancel);
  return out;
}

}  // namespace nerf::internal
