#include "nerf/parts/occupancy.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "nerf/base/error.h"

namespace nerf {

namespace {
constexpr Real kUnknown = 0.02_r;       // before anything was seen: occupied, and everywhere alike
constexpr Real kMostOpaque = 0.9999_r;  // keeps the thickness of a cell finite

// Bits of a brick's cells: x in bits 0-1 of the index, y in 2-3, z in 4-5.
constexpr uint64_t kLow[3] = {0x1111111111111111ull, 0x000f000f000f000full, 0x000000000000ffffull};
constexpr int kShift[3] = {1, 4, 16};

// Cells of a brick that are solid or share a face with a solid one, those of the six neighbouring
// bricks included.
uint64_t grow(const uint64_t* solid, int n, int bx, int by, int bz) {
  const auto at = [&](int x, int y, int z) -> uint64_t {
    if (x < 0 || y < 0 || z < 0 || x >= n || y >= n || z >= n) return 0;
    return solid[(int64_t{z} * n + y) * n + x];
  };
  const uint64_t m = at(bx, by, bz);
  uint64_t out = m;
  const int b[3] = {bx, by, bz};
  for (int i = 0; i < 3; ++i) {
    int before[3] = {b[0], b[1], b[2]}, after[3] = {b[0], b[1], b[2]};
    --before[i];
    ++after[i];
    const uint64_t low = kLow[i], high = low << (3 * kShift[i]);
    out |= (m & ~high) << kShift[i] | (m & ~low) >> kShift[i];
    out |= (at(before[0], before[1], before[2]) & high) >> (3 * kShift[i]);
    out |= (at(after[0], after[1], after[2]) & low) << (3 * kShift[i]);
  }
  return out;
}

// Bit i: whether cell i of a brick has a level above 0.
uint64_t mask_of(const uint8_t* levels) {
  static_assert(std::endian::native == std::endian::little);
  constexpr uint64_t kLowest = 0x0101010101010101ull;
  uint64_t mask = 0;
  for (size_t first = 0; first < 64; first += 8) {
    uint64_t eight;
    std::memcpy(&eight, levels + first, sizeof eight);
    if (eight == 0) continue;
    // Any bit of a byte to its lowest, and the lowest of all bytes side by side.
    for (const int half : {4, 2, 1}) eight |= eight >> half;
    mask |= (eight & kLowest) * 0x0102040810204080ull >> 56 << first;
  }
  return mask;
}
}  // namespace

// A cell: opacity, level, and two masks of a bit.
uint64_t OccupancyGrid::memory_bytes(int cascades, int side) {
  const uint64_t n = static_cast<uint64_t>(side);
  const uint64_t cells = n * n * n * static_cast<uint64_t>(cascades);
  return cells * (sizeof(Real) + 1) + cells / 4;
}

OccupancyGrid::OccupancyGrid(int cascades, int side)
    : OccupancyGrid(cascades, side, WithoutTraining()) {
  opacity_ = AlignedArray<Real>(levels_.size());
  std::fill(opacity_.begin(), opacity_.end(), kUnknown);
  solid_.resize(masks_.size());
  rebuild(0.01_r);
}

OccupancyGrid::OccupancyGrid(int cascades, int side, WithoutTraining)
    : cascades_(cascades), side_(side) {
  NERF_CHECK(cascades >= 1 && cascades <= kMostCascades);
  NERF_CHECK(side >= 16 && side <= kMostSide && side % 16 == 0);
  for (int c = 0; c < kMostCascades; ++c)
    cell_widths_[static_cast<size_t>(c)] = std::ldexp(2.0_r / static_cast<Real>(side_), c);
  const size_t cells_in_all = static_cast<size_t>(cascades) * static_cast<size_t>(cells());
  levels_ = AlignedArray<uint8_t>(cells_in_all);
  masks_.resize(cells_in_all / 64);
  clearance_.resize(masks_.size());
  for (int i = 0; i < 256; ++i) {
    const Real root = static_cast<Real>(i) / 255.0_r;
    thickness_of_level_[static_cast<size_t>(i)] = -std::log1p(-std::min(root * root, kMostOpaque));
  }
}

void OccupancyGrid::remember_moments() {
  most_ = AlignedArray<Real>(opacity_.size());
  std::ranges::copy(opacity_, most_.begin());
}

bool OccupancyGrid::occupied(const Vec3& p) const {
  const int c = cascade_of(p);
  if (c >= cascades_) return false;
  const int64_t cell = cell_of(p, c);
  return (brick_mask(c, cell / 64) >> (cell % 64) & 1) != 0;
}

Vec3 OccupancyGrid::cell_corner(int64_t cell, int cascade) const {
  const int64_t n = bricks();
  const int64_t brick = cell / 64;
  const int in = static_cast<int>(cell % 64);
  const int x = static_cast<int>(brick % n) * 4 + (in & 3);
  const int y = static_cast<int>(brick / n % n) * 4 + ((in >> 2) & 3);
  const int z = static_cast<int>(brick / (n * n)) * 4 + (in >> 4);
  const Real w = cell_width(cascade);
  const Real h = static_cast<Real>(side_ / 2);
  return {(static_cast<Real>(x) - h) * w, (static_cast<Real>(y) - h) * w,
          (static_cast<Real>(z) - h) * w};
}

// What a brick of 64 floats below 0 looks like: nothing in it ever changes.
bool OccupancyGrid::brick_is_off(size_t brick) const {
  Real most = kOff;
  for (size_t i = 0; i < 64; ++i) most = std::max(most, opacity_[brick * 64 + i]);
  return most < 0;
}

void OccupancyGrid::rebuild(Real threshold, ThreadPool* pool) {
  NERF_CHECK(opacity_.size() > 0);
  constexpr size_t kPerItem = 1024;  // bricks
  const size_t items = (masks_.size() + kPerItem - 1) / kPerItem;
  const auto each_item = [&](const auto& body) {
    const auto one = [&](int64_t i) {
      const size_t first = static_cast<size_t>(i) * kPerItem;
      body(static_cast<size_t>(i), first, std::min(masks_.size(), first + kPerItem));
    };
    if (pool)
      pool->parallel_for(static_cast<int64_t>(items), one);
    else
      for (size_t i = 0; i < items; ++i) one(static_cast<int64_t>(i));
  };

  // Decides which cells are in use; a negative number of either is off.
  const Real* const present = most_.size() > 0 ? most_.data() : opacity_.data();
  std::vector<double> sums(items);
  std::vector<int64_t> counts(items);
  std::vector<uint8_t> off(masks_.size());
  each_item([&](size_t item, size_t first, size_t last) {
    for (size_t b = first; b < last; ++b) {
      solid_[b] = 0;
      off[b] = brick_is_off(b);
      if (off[b]) continue;
      Real sum = 0;
      int64_t on = 0;
      for (size_t i = 0; i < 64; ++i) {
        if (opacity_[b * 64 + i] < 0) continue;
        const Real a = present[b * 64 + i];
        sum += a;
        ++on;
        solid_[b] |= uint64_t{a >= kSolid} << i;
      }
      sums[item] += static_cast<double>(sum);
      counts[item] += on;
    }
  });
  double sum = 0;
  int64_t on = 0;
  for (size_t i = 0; i < items; ++i) {
    sum += sums[i];
    on += counts[i];
  }
  const Real mean = on ? static_cast<Real>(sum / static_cast<double>(on)) : 0;
  const Real limit = std::min(threshold, mean);

  each_item([&](size_t, size_t first, size_t last) {
    for (size_t b = first; b < last; ++b) {
      uint8_t* levels = levels_.data() + b * 64;
      if (off[b]) {
        masks_[b] = 0;
        std::fill_n(levels, 64, uint8_t{0});
        continue;
      }
      for (size_t i = 0; i < 64; ++i) {
        const Real a = opacity_[b * 64 + i];
        const Real root = std::sqrt(std::max(a, 0.0_r)) * 255.0_r + 0.5_r;
        const uint8_t level = static_cast<uint8_t>(std::min(std::max(root, 1.0_r), 255.0_r));
        const Real most = a < 0 ? a : present[b * 64 + i];
        levels[i] = most >= limit && most > 0 ? level : uint8_t{0};
      }
      keep_neighbours_of_solid(b);
      masks_[b] = mask_of(levels);
    }
  });
  measure_occupied();
}

// A surface that moves by less than a cell must not fall into a gap.
void OccupancyGrid::keep_neighbours_of_solid(size_t b) {
  const size_t n = static_cast<size_t>(bricks()), in = b % bricks_of_cascade();
  const uint64_t grown = grow(solid_.data() + (b - in), bricks(), static_cast<int>(in % n),
                              static_cast<int>(in / n % n), static_cast<int>(in / (n * n)));
  for (uint64_t m = grown; m; m &= m - 1) {
    const size_t i = b * 64 + static_cast<size_t>(__builtin_ctzll(m));
    if (opacity_[i] >= 0 && levels_[i] == 0) levels_[i] = 1;
  }
}

void OccupancyGrid::set_levels(std::span<const uint8_t> levels) {
  NERF_CHECK_EQ(levels.size(), levels_.size());
  std::copy(levels.begin(), levels.end(), levels_.begin());
  for (size_t b = 0; b < masks_.size(); ++b) masks_[b] = mask_of(levels_.data() + b * 64);
  measure_occupied();
}

OccupancyGrid OccupancyGrid::with_levels(std::span<const uint8_t> levels) const {
  OccupancyGrid out(cascades_, side_, WithoutTraining());
  out.set_levels(levels);
  return out;
}

void OccupancyGrid::forget_training() {
  opacity_ = {};
  most_ = {};
  solid_ = {};
}

void OccupancyGrid::measure_occupied() {
  int64_t occupied = 0;
  occupied_box_ = Box3();
  for (size_t b = 0; b < masks_.size(); ++b) {
    if (masks_[b] == 0) continue;
    occupied += __builtin_popcountll(masks_[b]);
    const int c = static_cast<int>(b / bricks_of_cascade());
    const Vec3 corner = cell_corner(static_cast<int64_t>(b % bricks_of_cascade()) * 64, c);
    const Real w = brick_width(c);
    occupied_box_.extend(corner.cast<double>());
    occupied_box_.extend((corner + Vec3{w, w, w}).cast<double>());
  }
  occupied_fraction_ = static_cast<double>(occupied) / static_cast<double>(levels_.size());
  for (int c = 0; c < cascades_; ++c) measure_clearance(c);
}

// kMostClearance less the distance spreads from the bricks to keep clear of, one brick further each
// time, along one axis after the other.
void OccupancyGrid::measure_clearance(int cascade) {
  const size_t n = static_cast<size_t>(bricks()), plane = n * n, all = plane * n;
  const uint64_t* masks = masks_.data() + static_cast<size_t>(cascade) * all;
  const auto inner = [&](size_t i) { return i >= n / 4 && i < n - n / 4; };
  std::vector<uint8_t> near(all), spread(all), before(all);
  for (size_t b = 0; b < all; ++b) {
    const bool finer = cascade > 0 && inner(b % n) && inner(b / n % n) && inner(b / plane);
    near[b] = masks[b] != 0 || finer ? kMostClearance : 0;
  }
  for (int i = 1; i < kMostClearance; ++i) {
    spread = near;
    for (const size_t stride : {size_t{1}, n, plane}) {
      before = spread;
      const size_t line = stride * n;  // what lies along the axis
      for (size_t first = 0; first < all; first += line) {
        uint8_t* to = spread.data() + first;
        const uint8_t* from = before.data() + first;
        for (size_t j = stride; j < line; ++j) to[j] = std::max(to[j], from[j - stride]);
        for (size_t j = 0; j + stride < line; ++j) to[j] = std::max(to[j], from[j + stride]);
      }
    }
    for (size_t b = 0; b < all; ++b)
      spread[b] = std::max(near[b], static_cast<uint8_t>(spread[b] - (spread[b] > 0)));
    if (spread == near) break;  // nothing is farther from matter than this
    near.swap(spread);
  }
  for (size_t b = 0; b < all; ++b)
    clearance_[static_cast<size_t>(cascade) * all + b] =
        static_cast<uint8_t>(kMostClearance - near[b]);
}

}  // namespace nerf
