#include "nerf/train/run.h"

#include <chrono>
#include <thread>

#include "nerf/base/file.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/run_cases.h"
#include "train/run_speed.h"

namespace nerf {
namespace {

using test::bits_of;
using test::clock_of_steps;
using test::contains;
using test::error_of;
using test::quiet;
using test::sphere_capture;
using test::tiny_options;

// A capture whose photos can be spoilt and healed while a trainer uses them.
struct Spoilt {
  test::SyntheticCapture capture = sphere_capture();
  std::vector<Photo> good;

  Spoilt() {
    for (Photo& p : capture.photos.photos) {  // as half floats, which can hold what is no number
      p.pixels16.assign(p.pixels8.size(), 0x3800);  // 0.5
      p.pixels8.clear();
    }
    good = capture.photos.photos;
  }
  void spoil() {
    for (Photo& p : capture.photos.photos)
      for (size_t i = 0; i < p.pixels16.size(); i += 4) p.pixels16[i] = 0x7e00;  // NaN
  }
  void heal() { capture.photos.photos = good; }
};

TEST(Run, MasksThatLeaveNothingAreAnError) {
  auto c = sphere_capture();
  for (Photo& p : c.photos.photos)
    p.mask.assign(static_cast<size_t>(p.width) * static_cast<size_t>(p.height), 0);
  ThreadPool pool(1);
  EXPECT_TRUE(contains(error_of([&] { Trainer(c.scene, c.photos, tiny_options(20), pool); }),
                       "leave no pixel"));
  Photo& one = c.photos.photos[static_cast<size_t>(c.scene.train.back())];
  one.mask[5] = 255;
  EXPECT_NO_THROW(Trainer(c.scene, c.photos, tiny_options(20), pool));
}

TEST(Run, TrainsToTheEndEvaluatesAndSaves) {
  const auto c = sphere_capture();
  test::TempFolder folder;
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_options(20), pool);
  std::vector<bool> evaluations;
  int saved = 0;
  std::vector<RunProgress> seen;
  RunCallbacks callbacks;
  callbacks.evaluate = [&](bool last) { evaluations.push_back(last); };
  callbacks.saved = [&] { ++saved; };
  callbacks.step = [&](const RunProgress& p) { seen.push_back(p); };
  const RunResult result = run_training(trainer, quiet(), callbacks, folder / "c");
  EXPECT_FALSE(result.cancelled);
  EXPECT_EQ(result.steps, 20);
  EXPECT_EQ(evaluations, std::vector<bool>{true});
  EXPECT_EQ(saved, 1);
  ASSERT_EQ(seen.size(), 20u);
  EXPECT_EQ(seen.back().fraction, 1);
  EXPECT_EQ(seen.back().seconds_left, 0);
  EXPECT_GT(seen[3].seconds_left, 0);
  EXPECT_EQ(seen[3].planned_steps, 20);
  EXPECT_GT(seen[3].report.opacity, 0.01);
  EXPECT_GT(result.samples, 20 * 4000);
  EXPECT_NEAR(seen.back().train_seconds, result.train_seconds, 1e-9);
  EXPECT_GT(result.train_seconds, 0);
}

TEST(Run, IntervalsAreMinutesOfTraining) {
  const auto c = sphere_capture();
  test::TempFolder folder;
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_options(10), pool);
  RunOptions options;
  options.checkpoint_every = options.eval_every = 1e-9;  // after every step
  int saved = 0, evaluated = 0;
  RunCallbacks callbacks;
  callbacks.evaluate = [&](bool) { ++evaluated; };
  callbacks.saved = [&] { ++saved; };
  run_training(trainer, options, callbacks, folder / "c");
  EXPECT_EQ(saved, 10);
  EXPECT_EQ(evaluated, 10);
}

// Ten times as long a training lies behind an evaluation as it took.
TEST(Run, LongEvaluationsAreRare) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_options(10), pool);
  RunOptions options = quiet();
  options.eval_every = 1e-9;
  int evaluated = 0;
  RunCallbacks callbacks;
  callbacks.evaluate = [&](bool last) {
    evaluated += !last;
    std::this_thread::sleep_for(std::chrono::milliseconds(1001));
  };
  const RunResult result = run_training(trainer, options, callbacks);
  EXPECT_GE(evaluated, 1);
  EXPECT_LE(10 * (evaluated - 1), result.train_seconds);
}

TEST(Run, StoppedAndResumedIsTheSameBits) {
  const auto c = sphere_capture();
  test::TempFolder folder;
  ThreadPool pool(1);
  Cancel cancel;
  RunCallbacks stop_at_9;
  stop_at_9.step = [&](const RunProgress& p) {
    if (p.report.step == 9) cancel.request();
  };
  RunResult first;
  {
    Trainer trainer(c.scene, c.photos, tiny_options(20), pool);
    first = run_training(trainer, quiet(), stop_at_9, folder / "c", false, &cancel);
    EXPECT_TRUE(first.cancelled);
    EXPECT_EQ(first.steps, 9);
  }
  Trainer resumed(c.scene, c.photos, tiny_options(20), pool);
  const RunResult second = run_training(resumed, quiet(), {}, folder / "c", /*resume=*/true);
  EXPECT_EQ(second.steps, 20);
  EXPECT_GT(second.train_seconds, first.train_seconds);  // the clock goes on
  EXPECT_GT(second.samples, first.samples);
  Trainer whole(c.scene, c.photos, tiny_options(20), pool);
  run_training(whole, quiet(), {});
  EXPECT_EQ(bits_of(resumed), bits_of(whole));
}

TEST(Run, CancelledInAnEvaluationSavesAndEnds) {
  const auto c = sphere_capture();
  test::TempFolder folder;
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_options(10), pool);
  RunOptions options = quiet();
  options.eval_every = 1e-9;
  RunCallbacks callbacks;
  callbacks.evaluate = [](bool) { throw Cancelled(); };
  const RunResult result = run_training(trainer, options, callbacks, folder / "c");
  EXPECT_TRUE(result.cancelled);
  EXPECT_EQ(result.steps, 1);
  EXPECT_TRUE(std::filesystem::exists(folder / "c"));
}

// The clock is that of the steps, so what is waited for between them does not count.
// The plan of a budget stands although nothing is known of the speed of the part that resumed.
TEST(Run, ANonFiniteFirstStepOfAResumedRunKeepsItsPlan) {
  Spoilt spoilt;
  test::TempFolder folder;
  ThreadPool pool(1);
  RunOptions options = quiet();
  options.minutes = 1;
  int64_t plan = 0;
  Cancel cancel;
  RunCallbacks callbacks;
  callbacks.clock = clock_of_steps(0.5, 0.5, 0);
  callbacks.planned = [&](int64_t n) {
    plan = n;
    cancel.request();
  };
  Trainer first(spoilt.capture.scene, spoilt.capture.photos, tiny_options(0), pool);
  run_training(first, options, callbacks, folder / "c", /*resume=*/false, &cancel);
  ASSERT_GT(plan, 1);
  spoilt.spoil();
  RunCallbacks later;
  later.clock = clock_of_steps(0.5, 0.5, 0);
  int gone_back = 0;
  later.went_back = [&](const std::string&, int64_t) {
    ++gone_back;
    spoilt.heal();
  };
  Trainer second(spoilt.capture.scene, spoilt.capture.photos, tiny_options(0), pool);
  const RunResult result = run_training(second, options, later, folder / "c", /*resume=*/true);
  EXPECT_EQ(gone_back, 1);
  EXPECT_EQ(result.steps, plan);
}

TEST(Run, ANonFiniteLossGoesBackToTheStartWithoutACheckpoint) {
  Spoilt spoilt;
  ThreadPool pool(1);
  Trainer trainer(spoilt.capture.scene, spoilt.capture.photos, tiny_options(20), pool);
  std::vector<std::string> reasons;
  std::vector<double> rates;
  RunCallbacks callbacks;
  callbacks.step = [&](const RunProgress& p) {
    rates.push_back(p.report.rate);
    if (reasons.empty() && p.report.step == 5) spoilt.spoil();
  };
  callbacks.went_back = [&](const std::string& reason, int64_t step) {
    reasons.push_back(reason);
    EXPECT_EQ(step, 0);
    spoilt.heal();
  };
  const RunResult result = run_training(trainer, quiet(), callbacks);
  ASSERT_EQ(reasons.size(), 1u);
  EXPECT_TRUE(contains(reasons[0], "the loss of step 6 is not finite"));
  EXPECT_EQ(result.failures, 1);
  EXPECT_EQ(result.steps, 20);
  ASSERT_EQ(rates.size(), 25u);
  EXPECT_NEAR(rates[5], 0.5 * rates[0], 1e-9);
}

TEST(Run, ANonFiniteLossGoesBackToTheLastCheckpoint) {
  Spoilt spoilt;
  test::TempFolder folder;
  ThreadPool pool(1);
  Trainer trainer(spoilt.capture.scene, spoilt.capture.photos, tiny_options(20), pool);
  RunOptions options = quiet();
  options.checkpoint_every = 1e-9;
  RunCallbacks callbacks;
  bool spoilt_once = false;
  callbacks.step = [&](const RunProgress& p) {
    if (!spoilt_once && p.report.step == 7) spoilt.spoil();
    spoilt_once |= p.report.step == 7;
  };
  int64_t back_at = -1;
  callbacks.went_back = [&](const std::string&, int64_t step) {
    back_at = step;
    spoilt.heal();
  };
  const RunResult result = run_training(trainer, options, callbacks, folder / "c");
  EXPECT_EQ(back_at, 7);
  EXPECT_EQ(result.failures, 1);
  EXPECT_EQ(result.steps, 20);
}

TEST(Run, EndsWithTheReasonAfterThreeFailures) {
  Spoilt spoilt;
  spoilt.spoil();
  ThreadPool pool(1);
  Trainer trainer(spoilt.capture.scene, spoilt.capture.photos, tiny_options(20), pool);
  int failures = 0;
  RunCallbacks callbacks;
  callbacks.went_back = [&](const std::string&, int64_t) { ++failures; };
  const std::string error = error_of([&] { run_training(trainer, quiet(), callbacks); });
  EXPECT_TRUE(contains(error, "going back 3 times: the loss of step 1 is not finite"));
  EXPECT_EQ(failures, 3);
}

TEST(Run, AnEmptySceneIsAFailure) {
  auto c = sphere_capture();
  c.scene.near = 100;  // nothing is that far
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_options(100), pool);
  RunOptions options = quiet();
  options.empty_after = 8;
  std::vector<std::string> reasons;
  RunCallbacks callbacks;
  callbacks.went_back = [&](const std::string& reason, int64_t) { reasons.push_back(reason); };
  EXPECT_TRUE(contains(error_of([&] { run_training(trainer, options, callbacks); }),
                       "the scene stays empty"));
  ASSERT_EQ(reasons.size(), 3u);
  EXPECT_TRUE(contains(reasons[0], "after 8 steps no ray meets anything"));
}

TEST(Run, EmptyPhotosMayGiveAnEmptyScene) {
  auto c = sphere_capture();
  c.scene.near = 100;
  for (Photo& p : c.photos.photos)
    for (size_t i = 3; i < p.pixels8.size(); i += 4) p.pixels8[i] = 0;
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_options(12), pool);
  EXPECT_EQ(trainer.photo_opacity(), 0);
  RunOptions options = quiet();
  options.empty_after = 8;
  EXPECT_EQ(run_training(trainer, options, {}).failures, 0);
}

TEST(Run, PhotoOpacityIsThatOfTheTrainingPhotos) {
  const auto c = sphere_capture();
  double sum = 0, n = 0;
  for (const int v : c.scene.train)
    for (size_t i = 3; i < c.photos.photos[v].pixels8.size(); i += 4, ++n)
      sum += c.photos.photos[v].pixels8[i] / 255.0;
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_options(1), pool);
  // A mean of 2^14 draws: its standard deviation is at most 0.5 / 2^7, and this is five of them.
  EXPECT_NEAR(trainer.photo_opacity(), sum / n, 5 * 0.5 / 128);
}

TEST(Run, MemoryEstimateFollowsTheOptions) {
  TrainOptions small, large;
  small.grid.log2_entries = 14;
  large.grid.log2_entries = 22;
  EXPECT_LT(training_memory_bytes(small, false, 2),
            training_memory_bytes(TrainOptions(), false, 2));
  EXPECT_GT(training_memory_bytes(large, false, 2), uint64_t{1} << 30);
  // Eight cascades instead of one.
  small.grid.occupancy_side = 128;
  EXPECT_GT(training_memory_bytes(small, true, 2), training_memory_bytes(small, false, 2));
}

TEST(SpeedMeter, ExpectsTheLaterStepsSpeed) {
  internal::SpeedMeter speed;
  StepReport report;
  report.samples = 1000;
  report.rays = 100;
  report.psnr = 20;
  for (int i = 0; i < 100; ++i) speed.add(i < 50 ? 0.5 : 0.1, report);
  EXPECT_NEAR(speed.step_seconds_ahead(), 0.1, 1e-6);
  EXPECT_NEAR(speed.step_seconds(), 0.1, 1e-6);
  EXPECT_NEAR(speed.samples_per_second(), 10000, 1);
  EXPECT_NEAR(speed.rays_per_second(), 1000, 1);
  EXPECT_NEAR(speed.psnr(), 20, 1e-9);
}

}  // namespace
}  // namespace nerf
