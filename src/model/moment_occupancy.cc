#include "model/moment_occupancy.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "nerf/math/random.h"

namespace nerf::internal {

namespace {

constexpr int kPoints = 2;              // asked for in each block
constexpr int64_t kRaySamples = 3;      // of a ray that the search may cost
constexpr double kLeastOpacity = 4e-3;  // of a cell's width of matter

// The 2^3 cells of a brick that are one block, as a mask: x in bits 0-1 of a cell's index, y in
// 2-3, z in 4-5.
constexpr uint64_t kBlock = 0x0000000000330033ull;
constexpr uint64_t mask_of(int x, int y, int z) { return kBlock << (2 * x + 8 * y + 32 * z); }

// Blocks of one cascade, x fastest.
class Blocks {
 public:
  Blocks(const OccupancyGrid& grid, int cascade)
      : grid_(grid), cascade_(cascade), side_(2 * grid.bricks()) {
    const size_t n = static_cast<size_t>(side_);
    found_.resize(n * n * n);
    for (int64_t brick = 0; brick < grid.cells() / 64; ++brick)
      if (grid.brick_mask(cascade, brick) != 0) bricks_.push_back(brick);
  }

  const std::vector<int64_t>& bricks() const { return bricks_; }  // that hold any cell in use
  int64_t count() const {
    int64_t count = 0;
    for (const int64_t brick : bricks_)
      for (int b = 0; b < 8; ++b) count += in_use(brick, b);
    return count;
  }

  bool in_use(int64_t brick, int b) const {
    return (grid_.brick_mask(cascade_, brick) & mask_of(b & 1, b >> 1 & 1, b >> 2)) != 0;
  }
  Vec3 corner(int64_t brick, int b) const {
    const Real w = 2 * grid_.cell_width(cascade_);
    return grid_.cell_corner(brick * 64, cascade_) + Vec3{static_cast<Real>(b & 1) * w,
                                                          static_cast<Real>(b >> 1 & 1) * w,
                                                          static_cast<Real>(b >> 2) * w};
  }
  void mark(int64_t brick, int b) { found_[index(place(brick, b))] = 1; }

  bool near_matter(int64_t brick, int b) const {
    const auto at = place(brick, b);
    for (int z = std::max(at[2] - 1, 0); z <= std::min(at[2] + 1, side_ - 1); ++z)
      for (int y = std::max(at[1] - 1, 0); y <= std::min(at[1] + 1, side_ - 1); ++y)
        for (int x = std::max(at[0] - 1, 0); x <= std::min(at[0] + 1, side_ - 1); ++x)
          if (found_[index({x, y, z})]) return true;
    return false;
  }

 private:
  std::array<int, 3> place(int64_t brick, int b) const {
    const int64_t n = grid_.bricks();
    return {static_cast<int>(2 * (brick % n)) + (b & 1),
            static_cast<int>(2 * (brick / n % n)) + (b >> 1 & 1),
            static_cast<int>(2 * (brick / (n * n))) + (b >> 2)};
  }
  size_t index(const std::array<int, 3>& at) const {
    const size_t n = static_cast<size_t>(side_);
    return (static_cast<size_t>(at[2]) * n + static_cast<size_t>(at[1])) * n +
           static_cast<size_t>(at[0]);
  }

  const OccupancyGrid& grid_;
  int cascade_, side_;
  std::vector<int64_t> bricks_;
  std::vector<uint8_t> found_;  // whether a point of the block has matter
};

// Asks the field at points of all blocks in use.
void search(const GridField& field, const LayerPacks& packs, Real time, int cascade,
            ThreadPool& pool, const Cancel* cancel, Blocks& blocks) {
  constexpr size_t kBricks = 16;  // of an item of work
  const std::vector<int64_t>& bricks = blocks.bricks();
  const double width = static_cast<double>(field.occupancy.cell_width(cascade));
  const Real least = static_cast<Real>(-std::log1p(-kLeastOpacity) / width);
  std::vector<std::unique_ptr<FieldQuery>> queries(static_cast<size_t>(pool.size()));
  const size_t items = (bricks.size() + kBricks - 1) / kBricks;
  pool.parallel_for_thread(static_cast<int64_t>(items), [&](int64_t item, int thread) {
    if (cancel && cancel->requested()) throw Cancelled();
    auto& query = queries[static_cast<size_t>(thread)];
    if (!query) query = field.query(&packs);
    std::vector<Vec3d> points;
    std::vector<std::pair<int64_t, int>> of;
    const size_t first = static_cast<size_t>(item) * kBricks;
    for (size_t i = first; i < std::min(first + kBricks, bricks.size()); ++i)
      for (int b = 0; b < 8; ++b) {
        if (!blocks.in_use(bricks[i], b)) continue;
        Random random(1, static_cast<uint64_t>(cascade), static_cast<uint64_t>(bricks[i] * 8 + b));
        const Vec3d corner = blocks.corner(bricks[i], b).cast<double>();
        for (int k = 0; k < kPoints; ++k) {
          Vec3d p = corner;
          for (int axis = 0; axis < 3; ++axis)
            p[axis] += 2 * width * static_cast<double>(random.uniform());
          points.push_back(p);
          of.emplace_back(bricks[i], b);
        }
      }
    std::vector<Real> density(points.size());
    query->ask(
        {.positions = points, .time = time, .motion_spacing = field.occupancy.brick_width(cascade)},
        {.density = density});
    for (size_t i = 0; i < points.size(); ++i)
      if (density[i] >= least) blocks.mark(of[i].first, of[i].second);
  });
}

}  // namespace

std::optional<OccupancyGrid> occupancy_at(const GridField& field, Precision precision, Real time,
                                          int64_t rays, ThreadPool& pool, const Cancel* cancel) {
  if (!field.moves()) return std::nullopt;
  const OccupancyGrid& all = field.occupancy;
  std::vector<Blocks> cascades;
  int64_t count = 0;
  for (int c = 0; c < all.cascades(); ++c) count += cascades.emplace_back(all, c).count();
  if (kPoints * count > kRaySamples * rays) return std::nullopt;
  LayerPacks packs;
  pack_layers(field.layers(), field.weights.data(), precision, packs, pool);
  std::vector<uint8_t> levels(all.levels().size());
  for (int c = 0; c < all.cascades(); ++c) {
    Blocks& blocks = cascades[static_cast<size_t>(c)];
    search(field, packs, time, c, pool, cancel, blocks);
    const uint8_t* const from = all.levels().data() + c * all.cells();
    uint8_t* const to = levels.data() + c * all.cells();
    for (const int64_t brick : blocks.bricks())
      for (int b = 0; b < 8; ++b) {
        if (!blocks.in_use(brick, b) || !blocks.near_matter(brick, b)) continue;
        for (uint64_t m = mask_of(b & 1, b >> 1 & 1, b >> 2); m; m &= m - 1) {
          const int64_t cell = brick * 64 + __builtin_ctzll(m);
          to[cell] = from[cell];
        }
      }
  }
  return all.with_levels(levels);
}

}  // namespace nerf::internal
