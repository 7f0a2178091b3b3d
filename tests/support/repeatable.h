// For tests: trainings whose every bit can be had again.
#pragma once

#include <gtest/gtest.h>

#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"

namespace nerf::test {

// The same bits by one thread and two, and where a training goes on from a checkpoint half way.
inline void expect_repeatable(const SyntheticCapture& c, const TrainOptions& options) {
  const int64_t half = options.steps / 2;
  const auto go_on = [](Trainer& trainer, int64_t steps) {
    for (int64_t i = 0; i < steps; ++i) trainer.step();
  };
  const auto bits_after = [&](int threads) {
    ThreadPool pool(threads);
    Trainer trainer(c.scene, c.photos, options, pool);
    go_on(trainer, 2 * half);
    return bits_of(trainer);
  };
  const auto whole = bits_after(2);
  EXPECT_EQ(whole, bits_after(1));
  const TempFolder folder;
  ThreadPool pool(2);
  Trainer first(c.scene, c.photos, options, pool), second(c.scene, c.photos, options, pool);
  go_on(first, half);
  first.save_checkpoint(folder / "c");
  go_on(second, 1);
  second.load_checkpoint(folder / "c");
  go_on(second, half);
  EXPECT_EQ(whole, bits_of(second));
}

}  // namespace nerf::test
