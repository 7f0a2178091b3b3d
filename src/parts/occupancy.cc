#include "nerf/parts/occupancy.h"

#include <algorithm>
#include <cmath>

#include "nerf/base/error.h"

namespace nerf {

namespace {
constexpr float kUnknown = 0.02f;  // before anything was seen: occupied, and everywhere alike
constexpr float kRise = 0.15f, kFall = 0.15f;
constexpr float kSolid = 0.1f;  // opacity from which a cell keeps its neighbours switched on
constexpr float kMostOpaque = 0.9999f;  // keeps the thickness of a cell finite

int64_t brick_major(int x, int y, int z) {
  constexpr int b = OccupancyGrid::kBricks;
  const int64_t brick = (int64_t{z >> 2} * b + (y >> 2)) * b + (x >> 2);
  return brick * 64 + ((z & 3) * 16 + (y & 3) * 4 + (x & 3));
}
// Bits of a brick's cells: x in bits 0-1 of the index, y in 2-3, z in 4-5.
constexpr uint64_t kLow[3] = {0x1111111111111111ull, 0x000f000f000f000full, 0x000000000000ffffull};
constexpr int kShift[3] = {1, 4, 16};

// Cells of a brick that are solid or share a face with a solid one, those of the six neighbouring
// bricks included.
uint64_t grow(const std::vector<uint64_t>& solid, size_t cascade, int bx, int by, int bz) {
  constexpr int n = OccupancyGrid::kBricks;
  const auto at = [&](int x, int y, int z) -> uint64_t {
    if (x < 0 || y < 0 || z < 0 || x >= n || y >= n || z >= n) return 0;
    return solid[cascade * n * n * n + static_cast<size_t>((int64_t{z} * n + y) * n + x)];
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
}  // namespace

OccupancyGrid::OccupancyGrid(int cascades)
    : cascades_(cascades),
      opacity_(static_cast<size_t>(cascades) * kCells),
      levels_(static_cast<size_t>(cascades) * kCells),
      masks_(static_cast<size_t>(cascades) * kBricks * kBricks * kBricks) {
  NERF_CHECK(cascades >= 1 && cascades <= 16);
  for (int i = 0; i < 256; ++i) {
    const float root = static_cast<float>(i) / 255.0f;
    thickness_of_level_[static_cast<size_t>(i)] = -std::log1p(-std::min(root * root, kMostOpaque));
  }
  std::fill(opacity_.begin(), opacity_.end(), kUnknown);
  rebuild(0.01f);
}

int OccupancyGrid::cascade_of(const Vec3& p) const {
  int c = 0;
  float half = 1;
  // Lower borders belong to a cascade, upper ones do not: the same rule by which a cell holds
  // points.
  const auto holds = [&](float v) { return v >= -half && v < half; };
  while (c < cascades_ && !(holds(p.x) && holds(p.y) && holds(p.z))) {
    half *= 2;
    ++c;
  }
  return c;
}

int64_t OccupancyGrid::cell_of(const Vec3& p, int cascade) {
  const float scale = 1.0f / cell_width(cascade);
  int at[3];
  for (int i = 0; i < 3; ++i)
    at[i] = std::clamp(static_cast<int>(std::floor(p[i] * scale)) + kSide / 2, 0, kSide - 1);
  return brick_major(at[0], at[1], at[2]);
}

Vec3 OccupancyGrid::cell_corner(int64_t cell, int cascade) {
  const int64_t brick = cell / 64;
  const int in = static_cast<int>(cell % 64);
  const int x = static_cast<int>(brick % kBricks) * 4 + (in & 3);
  const int y = static_cast<int>(brick / kBricks % kBricks) * 4 + ((in >> 2) & 3);
  const int z = static_cast<int>(brick / (kBricks * kBricks)) * 4 + (in >> 4);
  const float w = cell_width(cascade);
  const float h = kSide / 2;
  return {(static_cast<float>(x) - h) * w, (static_cast<float>(y) - h) * w,
          (static_cast<float>(z) - h) * w};
}

void OccupancyGrid::observe(int cascade, int64_t cell, float seen) {
  float& a = opacity_[index(cascade, cell)];
  if (a < 0 || !(seen >= 0)) return;
  a += (seen > a ? kRise : kFall) * (seen - a);
}

void OccupancyGrid::rebuild(float threshold) {
  double sum = 0;
  int64_t on = 0;
  for (float a : opacity_)
    if (a >= 0) {
      sum += a;
      ++on;
    }
  const float mean = on ? static_cast<float>(sum / static_cast<double>(on)) : 0;
  const float limit = std::min(threshold, mean);
  for (size_t i = 0; i < opacity_.size(); ++i) {
    const float a = opacity_[i];
    levels_[i] = a >= limit && a > 0
                     ? static_cast<uint8_t>(std::clamp(std::sqrt(a) * 255.0f + 0.5f, 1.0f, 255.0f))
                     : uint8_t{0};
  }
  keep_neighbours_of_solid();
  build_masks();
}

// A surface that moves by less than a cell must not fall into a gap.
void OccupancyGrid::keep_neighbours_of_solid() {
  std::vector<uint64_t> solid(masks_.size());
  for (size_t b = 0; b < masks_.size(); ++b)
    for (size_t i = 0; i < 64; ++i) solid[b] |= uint64_t{opacity_[b * 64 + i] >= kSolid} << i;
  for (size_t b = 0; b < masks_.size(); ++b) {
    constexpr size_t n = kBricks;
    const uint64_t grown = grow(solid, b / (n * n * n), static_cast<int>(b % n),
                                static_cast<int>(b / n % n), static_cast<int>(b / (n * n) % n));
    for (uint64_t m = grown; m; m &= m - 1) {
      const size_t i = b * 64 + static_cast<size_t>(__builtin_ctzll(m));
      if (opacity_[i] >= 0 && levels_[i] == 0) levels_[i] = 1;
    }
  }
}

void OccupancyGrid::set_levels(std::span<const uint8_t> levels) {
  NERF_CHECK_EQ(levels.size(), levels_.size());
  std::copy(levels.begin(), levels.end(), levels_.begin());
  build_masks();
}

void OccupancyGrid::build_masks() {
  int64_t occupied = 0;
  occupied_box_ = Box3();
  constexpr size_t kBricksOfCascade = size_t{kBricks} * kBricks * kBricks;
  for (size_t b = 0; b < masks_.size(); ++b) {
    uint64_t mask = 0;
    for (size_t i = 0; i < 64; ++i) mask |= uint64_t{levels_[b * 64 + i] != 0} << i;
    masks_[b] = mask;
    occupied += __builtin_popcountll(mask);
    if (mask == 0) continue;
    const int c = static_cast<int>(b / kBricksOfCascade);
    const Vec3 corner = cell_corner(static_cast<int64_t>(b % kBricksOfCascade) * 64, c);
    const float w = 4 * cell_width(c);
    occupied_box_.extend(corner.cast<double>());
    occupied_box_.extend((corner + Vec3{w, w, w}).cast<double>());
  }
  occupied_fraction_ = static_cast<double>(occupied) / static_cast<double>(levels_.size());
}

}  // namespace nerf
