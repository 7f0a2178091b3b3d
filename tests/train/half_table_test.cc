// Tables of half floats: what lookups read, beside the weights that Adam keeps.
#include <gtest/gtest.h>

#include <set>

#include "base/half.h"
#include "support/synthetic_scene.h"
#include "support/tiny_options.h"
#include "train/grid_trainer.h"

namespace nerf {
namespace {

// In every row, whenever one can look: at first, after steps, and begun anew.
TEST(HalfTable, IsRoundedFromTheWeights) {
  const auto c = test::sphere_capture();
  ThreadPool pool(2);
  TrainOptions options = test::tiny_options(80);
  options.grid.table_bits = 16;
  GridTrainer trainer(c.scene, c.photos, options, pool);
  const size_t features = static_cast<size_t>(trainer.field.shape.features_per_entry());
  const auto weight = [&](size_t i) {
    const size_t row = i / features * kRowParts + kRowWeights;
    return trainer.optimiser.row_states[row * features + i % features];
  };
  const auto expect_rounded = [&](const char* when) {
    ASSERT_EQ(trainer.field.half_table.size(), trainer.field.shape.size());
    std::set<uint16_t> values;
    for (size_t i = 0; i < trainer.field.half_table.size(); ++i) {
      ASSERT_EQ(trainer.field.half_table[i], internal::float_to_half(static_cast<float>(weight(i))))
          << when << ", number " << i;
      values.insert(trainer.field.half_table[i]);
    }
    EXPECT_GT(values.size(), 100u) << when;
  };
  expect_rounded("at first");
  for (int i = 0; i < 20; ++i) trainer.step();
  expect_rounded("after 20 steps");
  size_t finer = 0;  // weights that half floats do not hold
  for (size_t i = 0; i < trainer.field.half_table.size(); ++i)
    finer += weight(i) != static_cast<Real>(internal::half_to_float(trainer.field.half_table[i]));
  EXPECT_GT(finer, trainer.field.half_table.size() / 20);
  trainer.begin_anew();
  expect_rounded("begun anew");
}

// The rounding is not learnt around: as good as with tables of 32 bits.
TEST(HalfTable, LearnsAsWell) {
  const auto c = test::sphere_capture(24, 32);
  ThreadPool pool(2);
  const auto psnr = [&](int table_bits) {
    TrainOptions options = test::tiny_options(300);
    options.grid.table_bits = table_bits;
    GridTrainer trainer(c.scene, c.photos, options, pool);
    double sum = 0;
    for (int i = 0; i < 300; ++i) {
      const double now = trainer.step().psnr;
      if (i >= 250) sum += now / 50;
    }
    return sum;
  };
  const double half = psnr(16), full = psnr(32);
  RecordProperty("half", std::to_string(half));
  RecordProperty("full", std::to_string(full));
  // Two seeds of trainings like these are 1.2 dB apart (precision_test.cc).
  EXPECT_NEAR(half, full, 0.6);
  EXPECT_GT(half, 18);
}

}  // namespace
}  // namespace nerf
