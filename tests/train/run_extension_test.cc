// Finished and stopped runs that are given another length.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <memory>

#include "nerf/train/run.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/run_cases.h"

namespace nerf {
namespace {

using test::bits_of;
using test::clock_of_steps;
using test::contains;
using test::error_of;
using test::quiet;
using test::sphere_capture;
using test::tiny_options;

class RunExtension : public ::testing::Test {
 protected:
  // A part of the run in the folder, which it begins where there is none: of `minutes`, or of the
  // options' steps; of `extend`. A step takes half a second. Stops before step `stop_at`.
  RunResult part(const TrainOptions& train, double minutes, RunLength extend = {},
                 int64_t stop_at = 0) {
    trainer_ = std::make_unique<Trainer>(capture_.scene, capture_.photos, train, pool_);
    RunOptions options = quiet();
    options.minutes = minutes;
    options.extend = extend;
    Cancel cancel;
    RunCallbacks callbacks;
    callbacks.clock = clock_of_steps(0.5, 0.5, 0);
    callbacks.extended = [&] { ++extensions_; };
    callbacks.step = [&](const RunProgress& p) {
      if (p.report.step == stop_at) cancel.request();
    };
    const auto file = folder_ / "c";
    return run_training(*trainer_, options, callbacks, file, std::filesystem::exists(file),
                        &cancel);
  }
  std::string error_of_part(const TrainOptions& train, double minutes, RunLength extend) {
    return error_of([&] { part(train, minutes, extend); });
  }

  // That a run of the plan from its beginning gives the same bits.
  void expect_repeatable(TrainOptions train) {
    train.steps = trainer_->options().steps;
    train.plan_changes = trainer_->options().plan_changes;
    Trainer again(capture_.scene, capture_.photos, train, pool_);
    run_training(again, quiet(), {});
    EXPECT_EQ(bits_of(again), bits_of(*trainer_));
  }

  test::SyntheticCapture capture_ = sphere_capture();
  ThreadPool pool_{1};
  test::TempFolder folder_;
  std::unique_ptr<Trainer> trainer_;
  int extensions_ = 0;
};

TEST_F(RunExtension, AFinishedRunGoesOnToMoreSteps) {
  const TrainOptions train = tiny_options(12);
  part(train, 0);
  const RunResult result = part(train, 0, {0, 30});
  EXPECT_EQ(result.steps, 30);
  EXPECT_EQ(extensions_, 1);
  EXPECT_EQ(trainer_->options().plan_changes, (PlanChanges{{{12, 12}}}));
  expect_repeatable(train);
  // Another time, with a stop on the way, and given once more.
  EXPECT_EQ(part(train, 0, {0, 50}, 37).steps, 37);
  EXPECT_EQ(part(train, 0, {0, 50}, 41).steps, 41);
  EXPECT_EQ(part(train, 0).steps, 50);
  EXPECT_EQ(extensions_, 2);
  expect_repeatable(train);
}

TEST_F(RunExtension, AStoppedRunGoesOnToMoreSteps) {
  const TrainOptions train = tiny_options(20);
  part(train, 0, {}, 14);
  EXPECT_EQ(part(train, 0, {0, 40}).steps, 40);
  EXPECT_EQ(trainer_->options().plan_changes, (PlanChanges{{{14, 20}}}));
  expect_repeatable(train);
}

TEST_F(RunExtension, EveryMethodIsExtended) {
  for (const char* method : {"nerf", "mipnerf", "mipnerf360"}) {
    SCOPED_TRACE(method);
    std::filesystem::remove(folder_ / "c");
    const TrainOptions train = test::tiny_method_options(method, 8);
    part(train, 0);
    EXPECT_EQ(part(train, 0, {0, 15}).steps, 15);
    expect_repeatable(train);
  }
}

// mip-NeRF 360 anneals over all steps, those of the hold too.
TEST_F(RunExtension, AnnealingThatWasStoppedEarlyIsRepeated) {
  TrainOptions train = test::tiny_method_options("mipnerf360", 40);
  train.hold = 0.5;
  part(train, 0, {}, 5);
  EXPECT_EQ(part(train, 0, {0, 60}, 12).steps, 12);
  EXPECT_EQ(trainer_->options().plan_changes, (PlanChanges{{{5, 40}}}));
  train.plan_changes = trainer_->options().plan_changes;
  train.steps = 60;
  Trainer again(capture_.scene, capture_.photos, train, pool_);
  for (int i = 0; i < 12; ++i) again.step();
  EXPECT_EQ(bits_of(again), bits_of(*trainer_));
}

TEST_F(RunExtension, ABudgetIsExtendedByMinutes) {
  const TrainOptions train = tiny_options(0);
  const RunResult first = part(train, 0.5);
  EXPECT_NEAR(first.train_seconds, 30, 1.5);
  EXPECT_EQ(part(train, 0.5, {1, 0}, first.steps + 5).steps, first.steps + 5);
  const RunResult result = part(train, 0.5);  // the checkpoint knows
  EXPECT_NEAR(result.train_seconds, 60, 1.5);
  EXPECT_EQ(extensions_, 1);
  const auto& changes = trainer_->options().plan_changes.list;
  EXPECT_NE(std::ranges::find(changes, PlanChange{first.steps, first.steps}), changes.end());
  expect_repeatable(train);
}

TEST_F(RunExtension, ABudgetThatHasNoPlanYetIsExtended) {
  const TrainOptions train = tiny_options(0);
  EXPECT_EQ(part(train, 1, {}, 4).steps, 4);
  const RunResult result = part(train, 1, {1.5, 0});
  EXPECT_NEAR(result.train_seconds, 90, 2.5);
  expect_repeatable(train);
}

TEST_F(RunExtension, OneKindOfLengthFollowsTheOther) {
  const TrainOptions train = tiny_options(20);
  part(train, 0);
  const RunResult timed = part(train, 0, {0.4, 0});
  EXPECT_NEAR(timed.train_seconds, 24, 1);
  expect_repeatable(train);
  const RunResult counted = part(train, 0.4, {0, 100});
  EXPECT_EQ(counted.steps, 100);
  expect_repeatable(train);
}

TEST_F(RunExtension, WhatIsNotLongerIsRefused) {
  const TrainOptions train = tiny_options(20);
  part(train, 0, {}, 10);
  EXPECT_TRUE(contains(error_of_part(train, 0, {0, 19}), "19 steps is not longer"));
  EXPECT_TRUE(contains(error_of_part(train, 0, {0.1, 0}), "0.1 minutes is not longer"));
  part(train, 0);
  EXPECT_TRUE(contains(error_of_part(train, 0, {0, 20}), "20 steps is not longer"));
  EXPECT_TRUE(contains(error_of_part(train, 0, {0.16, 0}), "0.16 minutes is not longer"));
  part(train, 0, {0.5, 0});
  const std::string error = error_of_part(train, 0, {0.5, 0});
  EXPECT_TRUE(contains(error, "the run is 0.5 minutes long")) << error;
  EXPECT_TRUE(contains(error, "give the length of the whole run")) << error;
  EXPECT_EQ(extensions_, 1);
}

}  // namespace
}  // namespace nerf
