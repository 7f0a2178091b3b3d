#include "model/baked_occupancy.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "model/sample_gaussian.h"
#include "nerf/base/error.h"
#include "nerf/kernels/bf16.h"
#include "nerf/math/camera.h"
#include "nerf/math/random.h"
#include "nerf/model/moments.h"

namespace nerf::internal {

namespace {

constexpr Real kEmptyThickness = 1e-3_r;  // optical, of a cell's width
constexpr int kPoints = 2;                // asked for in each cell

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

// Asks a field's networks.
class OccupancyBaker {
 public:
  // time: of a scene that moves.
  OccupancyBaker(const NetworkField& field, const ModelInfo& info, int side,
                 std::optional<Real> time, ThreadPool& pool, const Cancel* cancel)
      : field_(field),
        viewpoints_(field, info),
        side_(side),
        time_(time),
        pool_(pool),
        cancel_(cancel) {
    pack_layers(field.layers(), field.weights.data(), Precision::kAuto, packs_, pool);
  }

  MatterCells bake() {
    std::vector<uint8_t> last = bake_level(field_.options.sampling.levels() - 1), before;
    if (field_.networks.size() > 1) before = bake_level(0);
    return {side_, std::move(last), std::move(before)};
  }

 private:
  static constexpr int kBlock = 256;  // points of a network call
  static constexpr int kCellsPerBlock = kBlock / kPoints;

  struct Worker {
    Worker(const NetworkField& field, int level, const LayerPacks& packs,
           const std::optional<Real>& time)
        : tape(field.options, field.network_of(level), kBlock, 1, NetworkTape::Purpose::kDensity,
               {}),
          chunk(tape.tape) {
      chunk.weights = field.weights.data();
      chunk.packs = &packs;
      chunk.rays = 1;
      for (int k = 0; k < 3; ++k)
        chunk.data(tape.directions)[k * chunk.stride(tape.directions)] = 0;
      if (!time) return;
      tape.open(field.windows);
      Moments(field).place(tape, chunk, 0, *time, -1);
    }
    NetworkTape tape;
    Chunk chunk;
  };

  bool is_cone() const { return field_.options.cast == Cast::kCone; }

  // Of one level's network.
  std::vector<uint8_t> bake_level(int level) {
    const int64_t all = MatterCells::cells_of(side_);
    std::vector<uint8_t> out(static_cast<size_t>(MatterCells::kCascades * all), 0);
    std::vector<std::unique_ptr<Worker>> workers(static_cast<size_t>(pool_.size()));
    for (int cascade = 0; cascade < MatterCells::kCascades; ++cascade) {
      pool_.parallel_for_thread(all / kCellsPerBlock, [&](int64_t block, int thread) {
        if (cancel_ && cancel_->requested()) throw Cancelled();
        auto& own = workers[static_cast<size_t>(thread)];
        if (!own) own = std::make_unique<Worker>(field_, level, packs_, time_);
        ask(cascade, block, *own, out.data() + cascade * all);
      });
      MatterCells::grow(out, side_, cascade * all, pool_);
    }
    return out;
  }

  // Marks the block's cells that hold matter. out: of the cascade.
  void ask(int cascade, int64_t block, Worker& own, uint8_t* out) const {
    const int64_t n = side_, border = n / 4;
    const Real w = MatterCells::width(side_, cascade);
    const Real way = is_cone() ? viewpoints_.longest() : w;
    Chunk& c = own.chunk;
    int64_t cells[kCellsPerBlock];
    int count = 0;
    for (int64_t cell = block * kCellsPerBlock; cell < (block + 1) * kCellsPerBlock; ++cell) {
      const int64_t at[3] = {cell % n, cell / n % n, cell / (n * n)};
      // A finer grid answers for the middle of the coarser one.
      const bool inner =
          std::ranges::all_of(at, [&](int64_t i) { return i >= border && i < n - border; });
      if (cascade > 0 && inner) continue;
      Random random(1, static_cast<uint64_t>(cascade), static_cast<uint64_t>(cell));
      for (int i = 0; i < kPoints; ++i) {
        Vec3 p;
        for (int k = 0; k < 3; ++k)
          p[k] = (static_cast<Real>(at[k] - n / 2) + random.uniform()) * w;
        place(p, i == 0, count * kPoints + i, random, own);
      }
      cells[count++] = cell;
    }
    if (count == 0) return;
    c.samples = count * kPoints;
    const int32_t ray_begin[2] = {0, c.samples};
    c.ray_begin = ray_begin;
    std::fill_n(c.data(own.tape.delta), c.samples, way);
    own.tape.forward_weights(c);
    const Real* density = c.data(own.tape.density);
    for (int i = 0; i < count; ++i)
      for (int k = 0; k < kPoints; ++k)
        if (!(density[i * kPoints + k] * way < kEmptyThickness)) out[cells[i]] = 1;
  }

  void place(const Vec3& p, bool whole_interval, int column, Random& random, Worker& own) const {
    Chunk& c = own.chunk;
    const int64_t ld = c.stride(own.tape.position);
    Real* const position = c.data(own.tape.position) + column;
    if (!is_cone()) {
      for (int k = 0; k < 3; ++k) position[k * ld] = p[k];
      return;
    }
    Real* const variance =
        field_.options.integrated() ? c.data(own.tape.variance) + column : nullptr;
    Real t0, t1;
    const NetworkRay ray = viewpoints_.through(p, whole_interval, random, t0, t1);
    place_gaussian(field_.options, encoding_axes(field_.options), ray, t0, t1, position, variance,
                   ld);
  }

  const NetworkField& field_;
  Viewpoints viewpoints_;
  int side_;
  std::optional<Real> time_;
  ThreadPool& pool_;
  const Cancel* cancel_;
  LayerPacks packs_;
};

bool asks_for_points(const NetworkField& field) {
  return field.options.cast == Cast::kPoint && !field.options.integrated();
}

}  // namespace

bool baking_pays(const NetworkField& field, uint64_t rays, int side) {
  const int64_t cells = MatterCells::cells_of(side);
  const uint64_t points = static_cast<uint64_t>(kPoints * (cells + cells * 7 / 8));
  return rays * static_cast<uint64_t>(field.options.sampling.all_samples()) >
         2 * field.networks.size() * points;
}

bool can_bake(const NetworkField& field, const ModelInfo& info) {
  if (field.options.deform.any()) return false;
  if (field.options.cast == Cast::kPoint) return asks_for_points(field);
  const bool even = field.options.sampling.spacing == Spacing::kUniform;
  return even && field.options.space == Space::kIdentity && !info.views.empty();
}

MatterCells bake_occupancy(const NetworkField& field, const ModelInfo& info, ThreadPool& pool,
                           const Cancel* cancel) {
  NERF_CHECK(can_bake(field, info));
  return OccupancyBaker(field, info, kBakedSide, {}, pool, cancel).bake();
}

std::optional<MatterCells> occupancy_at(const NetworkField& field, const ModelInfo& info, Real time,
                                        int64_t rays, ThreadPool& pool, const Cancel* cancel) {
  if (!field.options.deform.any() || !asks_for_points(field) ||
      !baking_pays(field, static_cast<uint64_t>(rays), kMomentSide))
    return std::nullopt;
  return OccupancyBaker(field, info, kMomentSide, time, pool, cancel).bake();
}

}  // namespace nerf::internal
