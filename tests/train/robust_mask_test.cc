#include "train/robust_mask.h"

#include <gtest/gtest.h>

#include "train/ray_batch.h"

namespace nerf {
namespace {

constexpr int kWidth = 64, kHeight = 32, kTile = 8;

struct Photos {
  PhotoSet photos;
  std::vector<int> views{0, 1, 2};
  Photos() {
    for (int i = 0; i < 3; ++i) {
      Photo p;
      p.width = kWidth;
      p.height = kHeight;
      photos.photos.push_back(p);
    }
  }
};

// Steps in which every pixel of a lattice is met once, with the error that error_at says.
template <class Error>
void observe(RobustMask& mask, int steps, const Error& error_at, double progress = 0) {
  RayBatch batch(8);
  std::vector<Real> errors(batch.weight.size());
  for (int step = 0; step < steps; ++step) {
    batch.chunks = 1;
    std::fill(batch.rays.begin(), batch.rays.end(), 0);
    for (size_t photo = 0; photo < 3; ++photo)
      for (int y = 2; y < kHeight; y += 4)
        for (int x = 2; x < kWidth; x += 4) {
          size_t c = static_cast<size_t>(batch.chunks - 1);
          if (batch.rays[c] == kChunkRays) ++c, ++batch.chunks;
          const size_t at = c * kChunkRays + static_cast<size_t>(batch.rays[c]++);
          batch.tile[at] = mask.tile_of(photo, x, y);
          errors[at] = error_at(photo, x, y);
        }
    mask.observe(batch, errors, progress);
  }
}

bool passes_by(size_t photo, int x, int y) { return photo == 1 && x < 24 && y < 16; }

constexpr int64_t kLate = 1000;  // of all steps, so that chance plays no part

TEST(RobustMask, LeavesOutWhereErrorsStayLargeTogether) {
  const Photos p;
  RobustMask mask(p.photos, p.views, 0.1);
  const auto error = [](size_t photo, int x, int y) {
    if (passes_by(photo, x, y)) return 0.3_r;
    return x % 8 < 4 && y % 8 < 4 ? 0.25_r : 0.02_r;  // an edge: one pixel of four
  };
  observe(mask, 30, error);
  EXPECT_TRUE(mask.leaves_out(mask.tile_of(1, 10, 10), 0.3_r, kLate, 0.5_r));
  EXPECT_FALSE(mask.leaves_out(mask.tile_of(1, 10, 10), 0.01_r, kLate, 0.5_r));  // is right
  EXPECT_FALSE(mask.leaves_out(mask.tile_of(1, 40, 20), 0.25_r, kLate, 0.5_r));  // an edge
  EXPECT_FALSE(mask.leaves_out(mask.tile_of(0, 10, 10), 0.3_r, kLate, 0.5_r));   // another photo
  EXPECT_FALSE(mask.leaves_out(-1, 0.3_r, kLate, 0.5_r));
}

TEST(RobustMask, SaysWhichTiles) {
  const Photos p;
  RobustMask mask(p.photos, p.views, 0.1);
  observe(mask, 30, [](size_t photo, int x, int y) { return passes_by(photo, x, y) ? 0.3_r : 0; });
  for (int y = 0; y < kHeight; y += kTile)
    for (int x = 0; x < kWidth; x += kTile) {
      EXPECT_EQ(mask.is_left_out(1, x + 3, y + 5), passes_by(1, x, y)) << x << " " << y;
      EXPECT_FALSE(mask.is_left_out(0, x, y));
    }
}

// What passes by may look like what it hides in places, and a detail is not what passes by.
TEST(RobustMask, TilesFollowThoseAroundThem) {
  const Photos p;
  RobustMask mask(p.photos, p.views, 0.2);
  const auto in_tile = [](int x, int y, int u, int v) { return x / kTile == u && y / kTile == v; };
  observe(mask, 30, [&](size_t photo, int x, int y) {
    if (photo == 0) return in_tile(x, y, 5, 1) ? 0.3_r : 0.02_r;  // alone
    const bool is_hole = in_tile(x, y, 1, 1);
    return photo == 1 && x < 24 && y < 24 && !is_hole ? 0.3_r : 0.02_r;
  });
  EXPECT_FALSE(mask.is_left_out(0, 5 * kTile, kTile));
  EXPECT_TRUE(mask.is_left_out(1, kTile, kTile));
  // In the hole, what agrees with the field teaches.
  EXPECT_FALSE(mask.leaves_out(mask.tile_of(1, kTile, kTile), 0.02_r, kLate, 0.5_r));
  EXPECT_TRUE(mask.leaves_out(mask.tile_of(1, kTile, kTile), 0.3_r, kLate, 0.5_r));
}

// Its corner, with less than half of the errors of the tiles around, is out for the errors of its
// own; details elsewhere are not.
TEST(RobustMask, WhatPassesByEndsWithinTiles) {
  const Photos p;
  RobustMask mask(p.photos, p.views, 0.2);
  const auto is_in = [](size_t photo, int x, int y) {
    return photo == 1 ? x < 28 && y < 24 : photo == 0 && x >= 40 && x < 44 && y >= 8 && y < 16;
  };
  observe(mask, 30,
          [&](size_t photo, int x, int y) { return is_in(photo, x, y) ? 0.3_r : 0.02_r; });
  EXPECT_TRUE(mask.leaves_out(mask.tile_of(1, 25, 20), 0.3_r, kLate, 0.5_r));
  EXPECT_FALSE(mask.is_left_out(1, 25, 20));  // most of it is right
  EXPECT_FALSE(mask.leaves_out(mask.tile_of(1, 30, 20), 0.02_r, kLate, 0.5_r));
  EXPECT_FALSE(mask.is_left_out(1, 32, 20));
  EXPECT_FALSE(mask.is_left_out(1, 20, 24));
  EXPECT_FALSE(mask.is_left_out(0, 41, 10));
}

TEST(RobustMask, BeginsLittleByLittle) {
  const Photos p;
  RobustMask mask(p.photos, p.views, 0.1);
  observe(mask, 30, [](size_t photo, int x, int y) { return passes_by(photo, x, y) ? 0.3_r : 0; });
  const int32_t tile = mask.tile_of(1, 4, 4);
  EXPECT_FALSE(mask.leaves_out(tile, 0.3_r, 0, 0.99_r));
  EXPECT_FALSE(mask.leaves_out(tile, 0.3_r, 5, 0.3_r));  // exp(-0.5) of them teach
  EXPECT_TRUE(mask.leaves_out(tile, 0.3_r, 5, 0.7_r));
}

// At last an error must be large by itself: a scene without anything in the way keeps its details.
TEST(RobustMask, KeepsSmallErrorsOfAFieldThatHasLearnt) {
  const Photos p;
  const auto error = [](size_t photo, int x, int y) { return passes_by(photo, x, y) ? 0.06_r : 0; };
  RobustMask early(p.photos, p.views, 0.1), late(p.photos, p.views, 0.1);
  observe(early, 30, error, 0);
  observe(late, 30, error, 1);
  EXPECT_TRUE(early.leaves_out(early.tile_of(1, 4, 4), 0.06_r, kLate, 0.5_r));
  EXPECT_FALSE(late.leaves_out(late.tile_of(1, 4, 4), 0.06_r, kLate, 0.5_r));
}

TEST(RobustMask, AWholePhotoIsNotInTheWay) {
  const Photos p;
  RobustMask mask(p.photos, p.views, 0.4);
  observe(mask, 30, [](size_t photo, int, int) { return photo == 2 ? 0.3_r : 0; });
  EXPECT_FALSE(mask.leaves_out(mask.tile_of(2, 4, 4), 0.3_r, kLate, 0.5_r));
  for (size_t photo = 0; photo < 3; ++photo)
    for (int y = 0; y < kHeight; y += kTile)
      for (int x = 0; x < kWidth; x += kTile) EXPECT_FALSE(mask.is_left_out(photo, x, y));
}

TEST(RobustMask, ForgetsWhenItBeginsAnew) {
  const Photos p;
  RobustMask mask(p.photos, p.views, 0.1);
  observe(mask, 30, [](size_t photo, int x, int y) { return passes_by(photo, x, y) ? 0.3_r : 0; });
  mask.reset();
  EXPECT_FALSE(mask.leaves_out(mask.tile_of(1, 4, 4), 0.3_r, kLate, 0.5_r));
}

}  // namespace
}  // namespace nerf
