// What a training of the grid method begins with: blocks of pixels that stand for one
// (TrainOptions::coarse_photos), the coarser of its resolutions (late_levels), and fewer samples of
// a ray (early_samples).
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>
#include <utility>

#include "math/worst_error.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"
#include "train/grid_trainer.h"
#include "train/ray_batch.h"

namespace nerf {
namespace {

struct Mean {
  double rgb[3] = {0, 0, 0}, alpha = 0;
  int count = 0;
};

// Of what the mask keeps of a block, colours weighted by alpha.
Mean mean_of(const Photo& photo, int x0, int y0, int x1, int y1) {
  Mean m;
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x) {
      if (photo.masked_out(x, y)) continue;
      Real rgba[4];
      photo.pixel(x, y, rgba);
      for (int k = 0; k < 3; ++k)
        m.rgb[k] += static_cast<double>(rgba[k]) * static_cast<double>(rgba[3]);
      m.alpha += static_cast<double>(rgba[3]);
      ++m.count;
    }
  for (double& c : m.rgb) c = m.alpha > 0 ? c / m.alpha : 0;
  m.alpha /= std::max(m.count, 1);
  return m;
}

TEST(PixelBlocks, CarryTheMeanOfWhatTheMaskKeeps) {
  auto c = test::sphere_capture(3, 35);  // the last blocks are narrow
  const int width = c.photos.photos[0].width, height = c.photos.photos[0].height;
  for (Photo& photo : c.photos.photos) {
    photo.mask.assign(static_cast<size_t>(width * height), 255);
    for (size_t i = 0; i < photo.mask.size(); i += 3) photo.mask[i] = 0;
    for (int y = 8; y < 12; ++y)  // one block of which nothing is kept
      for (int x = 12; x < 16; ++x) photo.mask[static_cast<size_t>(y * width + x)] = 0;
  }
  const PixelSource source(c.scene, c.photos);
  for (const int block : {2, 4}) {
    std::set<std::pair<int, int>> corners;
    int narrow = 0, empty = 0;
    for (uint64_t i = 0; i < 6000; ++i) {
      Random random(1, 2, i);
      PixelSource::Pixel pixel;
      ASSERT_TRUE(source.locate(random, nullptr, pixel, block));
      ASSERT_TRUE(pixel.x % block == 0 && pixel.y % block == 0);
      corners.insert({pixel.x, pixel.y});
      const int x1 = std::min(pixel.x + block, width), y1 = std::min(pixel.y + block, height);
      narrow += x1 - pixel.x < block;
      const Mean want = mean_of(*pixel.photo, pixel.x, pixel.y, x1, y1);
      ASSERT_EQ(source.read(pixel), want.count > 0);
      // The ray goes through the middle of the block.
      const auto d = unproject(*pixel.camera, {(pixel.x + x1) / 2.0, (pixel.y + y1) / 2.0});
      const Vec3d away = pixel.ray.direction - normalized(pixel.pose->rotation * *d);
      ASSERT_LT(length(away), 1e-12);
      if (want.count == 0) {
        ++empty;
        continue;
      }
      for (size_t k = 0; k < 3; ++k) ASSERT_NEAR(pixel.rgb[k], want.rgb[k], 1e-6);
      ASSERT_NEAR(pixel.alpha, want.alpha, 1e-6);
    }
    EXPECT_EQ(corners.size(),
              static_cast<size_t>(((width + block - 1) / block) * ((height + block - 1) / block)));
    EXPECT_GT(narrow, 0);
    EXPECT_GT(empty, 0);
  }
}

TEST(PixelBlocks, EndWithinTheirShareOfTheFall) {
  const auto c = test::sphere_capture(4, 16);
  ThreadPool pool(1);
  TrainOptions options = test::tiny_options(1000);
  options.hold = 0.2;  // the rate falls from step 200 on
  EXPECT_EQ(GridTrainer(c.scene, c.photos, options, pool).pixel_block_at(0), 1);
  options.coarse_photos = 0.5;
  const GridTrainer trainer(c.scene, c.photos, options, pool);
  for (const auto& [step, block] :
       {std::pair{0, 4}, {200, 4}, {399, 4}, {401, 2}, {599, 2}, {601, 1}, {1000, 1}})
    EXPECT_EQ(trainer.pixel_block_at(step), block) << step;
}

// A level that is off is not learnt, and comes on in its turn.
TEST(LateLevels, AreLearntOnceTheyAreOn) {
  const auto c = test::sphere_capture(6, 24);
  ThreadPool pool(2);
  TrainOptions options = test::tiny_options(60);
  options.hold = 0.5;
  options.late_levels = 0.5;
  GridTrainer trainer(c.scene, c.photos, options, pool);
  EXPECT_EQ(trainer.levels_at(29), 2);
  EXPECT_EQ(trainer.levels_at(38), 3);
  EXPECT_EQ(trainer.levels_at(45), 4);
  const AlignedArray<uint16_t> before = trainer.field.half_table;
  const auto changed = [&](size_t l) {
    const HashGridLevel& level = trainer.field.shape.levels[l];
    const auto begin = static_cast<std::ptrdiff_t>(level.begin());
    const auto end = begin + static_cast<std::ptrdiff_t>(level.entries) * level.features;
    return !std::equal(before.begin() + begin, before.begin() + end,
                       trainer.field.half_table.begin() + begin);
  };
  for (int step = 0; step < 30; ++step) trainer.step();
  EXPECT_TRUE(changed(0) && changed(1));
  EXPECT_FALSE(changed(2) || changed(3));
  for (int step = 30; step < 60; ++step) trainer.step();
  for (size_t l = 0; l < 4; ++l) EXPECT_TRUE(changed(l)) << l;
}

// From the early share to all of them, with the square of the progress: to the end of a short run,
// or to 200 million samples of a long one, where the scene is bounded.
TEST(SamplesPerCell, AreExactOnceTheFieldIsSharp) {
  auto c = test::sphere_capture(4, 16);
  ThreadPool pool(1);
  TrainOptions options = test::tiny_options(1000);
  options.early_samples = 0.2;
  options.hold = 0;
  options.batch_samples = 1920;
  const double all = options.grid.sampler.samples_per_cell;
  const auto share = [&](int64_t step) {
    const GridTrainer trainer(c.scene, c.photos, options, pool);
    return static_cast<double>(trainer.samples_per_cell_at(step)) / all;
  };
  const double bound = 4 * kRoundoff;
  EXPECT_NEAR(share(0), 0.2, bound);
  EXPECT_NEAR(share(500), 0.2 + 0.8 * 0.25, bound);
  EXPECT_NEAR(share(1000), 1, bound);
  options.steps = 1000000;
  const int64_t sharp = static_cast<int64_t>(2e8 / 1920);
  EXPECT_NEAR(share(sharp / 2), 0.2 + 0.8 * 0.25, 1e-4);
  EXPECT_NEAR(share(sharp + 1), 1, bound);
  // A ray of all samples is drawn for a fifth of the cost: what is saved on the way.
  const auto saved = [&](int64_t steps) {
    return GridTrainer(c.scene, c.photos, options, pool).late_saving_share(steps);
  };
  // Of (1 - 1 / (1 + 4 p^2)) 5 / 4 over p in [0, 1].
  const double mean = 1.25 * (1 - std::atan(2.0) / 2);
  EXPECT_NEAR(saved(1000), mean, 1e-3);
  EXPECT_NEAR(saved(sharp), mean, 1e-3);
  EXPECT_NEAR(saved(4 * sharp), 0.75 + 0.25 * mean, 1e-2);
  c.scene.unbounded = true;
  EXPECT_LT(share(sharp + 1), 0.22);
  EXPECT_NEAR(share(1000000), 1, bound);
}

// Of the time of the chunks by the networks' multiply-adds, where fewer rays need fewer colours.
TEST(SamplesPerCell, SharedColoursTakeTheirShareOfTheChunks) {
  const auto c = test::sphere_capture(4, 16);
  ThreadPool pool(1);
  TrainOptions options = test::tiny_options(1000);
  options.grid.hidden = 32;
  options.grid.geometry_features = 16;
  options.grid.colour_layers = 2;
  const auto colours = [&] {
    GridTrainer trainer(c.scene, c.photos, options, pool);
    trainer.chunk_seconds = 0.03;
    trainer.colours_per_sample = 0.5;
    return trainer.colour_seconds();
  };
  options.shared_colour = 0;
  EXPECT_EQ(colours(), 0);
  options.shared_colour = 0.1;
  const double features = options.grid.levels * options.grid.features;
  const double density = features * 32 + 32 * 16, colour = 0.5 * (32 * 32 + 32 * 32 + 32 * 3);
  EXPECT_NEAR(colours(), 0.03 * colour / (density + colour), 1e-12);
  options.grid.colour_per_ray = true;
  EXPECT_EQ(colours(), 0);
}

}  // namespace
}  // namespace nerf
