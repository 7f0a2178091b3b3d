#include "nerf/train/run.h"

#include <chrono>
#include <thread>

#include "nerf/base/file.h"
#include "support/synthetic_scene.h"
#include "support/temp_folder.h"
#include "support/tiny_options.h"
#include "train/run_speed.h"

namespace nerf {
namespace {

using test::bits_of;
using test::contains;
using test::error_of;
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

RunOptions quiet() {
  RunOptions options;
  options.checkpoint_every = options.eval_every = 0;
  return options;
}

// A clock by which steps take `before` seconds until `turn` seconds have gone, then `after`. It is
// asked as a step begins and as it ends.
std::function<double()> clock_of_steps(double before, double after, double turn) {
  return [=, now = 0.0, in_step = false]() mutable {
    if (in_step) now += now < turn ? before : after;
    in_step = !in_step;
    return now;
  };
}

// Of a run of that plan from its beginning.
auto bits_of_plan(const test::SyntheticCapture& c, const TrainingPlan& plan) {
  ThreadPool pool(1);
  TrainOptions options = tiny_options(static_cast<int>(plan.steps));
  options.plan_changes = plan.changes;
  Trainer trainer(c.scene, c.photos, options, pool);
  run_training(trainer, quiet(), {});
  EXPECT_EQ(trainer.steps_done(), plan.steps);
  return bits_of(trainer);
}

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
TEST(Run, ABudgetOfTimeFixesItsPlanAndIsRepeatedBySteps) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  Trainer timed(c.scene, c.photos, tiny_options(0), pool);
  RunOptions options = quiet();
  options.minutes = 1.0 / 60;
  int64_t plan = 0, first_plan = 0, planned_at = 0, steps = 0;
  int plans = 0;
  RunCallbacks callbacks;
  callbacks.step = [&](const RunProgress& p) {
    steps = p.report.step;
    EXPECT_EQ(p.planned_steps == 0, plans == 0);
  };
  callbacks.planned = [&](int64_t n) {
    plan = n;
    if (plans++ == 0) {
      planned_at = steps + 1;
      first_plan = n;
    }
  };
  const RunResult result = run_training(timed, options, callbacks);
  EXPECT_GE(plans, 1);
  EXPECT_EQ(result.steps, plan);
  // How long it took depends on what else the machine did; what does not: nothing before the plan
  // was fixed depended on it.
  EXPECT_GT(result.train_seconds, 0);
  EXPECT_LE(static_cast<double>(planned_at), 0.1 * static_cast<double>(first_plan));
  EXPECT_EQ(bits_of(timed), bits_of_plan(c, timed.options().plan()));
}

RunResult run_of_a_minute(Trainer& trainer, double before, double after, double turn) {
  RunOptions options = quiet();
  options.minutes = 1;
  RunCallbacks callbacks;
  callbacks.clock = clock_of_steps(before, after, turn);
  return run_training(trainer, options, callbacks);
}

TEST(Run, ABudgetHoldsThoughTheMachineGetsSlowerOrFaster) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  const struct {
    double before, after, turn;
  } machines[] = {{0.2, 0.2, 0}, {0.2, 0.5, 20}, {0.5, 0.2, 20}, {0.2, 0.4, 35}};
  for (const auto& m : machines) {
    Trainer trainer(c.scene, c.photos, tiny_options(0), pool);
    const RunResult result = run_of_a_minute(trainer, m.before, m.after, m.turn);
    // From 3/4 on the speed is known: the margin of late steps (2 % of what is left) and what a
    // plan may be off without a correction (2 % of the budget).
    EXPECT_NEAR(result.train_seconds, 60, 60 * 0.025 + m.after) << m.before << " " << m.after;
    const TrainingPlan plan = trainer.options().plan();
    EXPECT_EQ(plan.changes.list.empty(), m.before == m.after);
    EXPECT_EQ(bits_of(trainer), bits_of_plan(c, plan)) << m.before << " " << m.after;
  }
}

TEST(Run, NoCorrectionTakesMoreThanHalfOfWhatIsLeft) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  Trainer trainer(c.scene, c.photos, tiny_options(0), pool);
  run_of_a_minute(trainer, 0.1, 10, 20);
  const PlanChanges changes = trainer.options().plan_changes;
  ASSERT_FALSE(changes.list.empty());
  for (size_t i = 0; i < changes.list.size(); ++i) {
    const PlanChange& c1 = changes.list[i];
    const bool last = i + 1 == changes.list.size();
    const int64_t then = last ? trainer.options().steps : changes.list[i + 1].length;
    EXPECT_GE(2 * (then - c1.step), c1.length - c1.step);
  }
}

TEST(Run, AResumedBudgetGoesOnWithItsCorrectedPlan) {
  const auto c = sphere_capture();
  test::TempFolder folder;
  ThreadPool pool(1);
  Trainer first(c.scene, c.photos, tiny_options(40), pool);
  for (int i = 0; i < 20; ++i) first.step();
  first.set_planned_steps(30);
  for (int i = 0; i < 3; ++i) first.step();
  first.save_checkpoint(folder / "c");
  Trainer second(c.scene, c.photos, tiny_options(7), pool);
  second.load_checkpoint(folder / "c");
  const TrainingPlan plan = second.options().plan();
  EXPECT_EQ(plan.steps, 30);
  EXPECT_EQ(plan.changes, (PlanChanges{{{20, 40}}}));
  run_training(second, quiet(), {});
  EXPECT_EQ(bits_of(second), bits_of_plan(c, plan));
}

TEST(Run, ABudgetNeedsAHoldToFixItsPlanIn) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  TrainOptions brief = tiny_options(0);
  brief.hold = 0.01;
  Trainer trainer(c.scene, c.photos, brief, pool);
  RunOptions options = quiet();
  options.minutes = 1;
  EXPECT_TRUE(contains(error_of([&] { run_training(trainer, options, {}); }), "--hold"));
}

TEST(Run, ABudgetDoesNotKnowOverHowManyStepsToAnneal) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  const auto error = [&](bool anneal, int steps) {
    TrainOptions train = test::tiny_method_options("mipnerf360", 0);
    train.recipe.anneal = anneal;
    train.recipe.anneal_steps = steps;
    Trainer trainer(c.scene, c.photos, train, pool);
    RunOptions options = quiet();
    options.minutes = 1e-3;
    RunCallbacks callbacks;
    callbacks.clock = clock_of_steps(1, 1, 0);
    return error_of([&] { run_training(trainer, options, callbacks); });
  };
  EXPECT_TRUE(contains(error(true, 0), "--recipe-anneal-steps"));
  EXPECT_EQ(error(true, 10), "");
  EXPECT_EQ(error(false, 0), "");
}

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
