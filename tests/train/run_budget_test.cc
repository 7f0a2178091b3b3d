// Trainings of minutes: how many steps they are, and that these steps by themselves are the same.
#include <gtest/gtest.h>

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

TEST(RunBudget, ABudgetOfTimeFixesItsPlanAndIsRepeatedBySteps) {
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

TEST(RunBudget, ABudgetHoldsThoughTheMachineGetsSlowerOrFaster) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  const struct {
    double before, after, turn;
  } machines[] = {{0.2, 0.2, 0}, {0.2, 0.5, 20}, {0.5, 0.2, 20}, {0.2, 0.4, 35}};
  for (const auto& m : machines) {
    Trainer trainer(c.scene, c.photos, tiny_options(0), pool);
    const RunResult result = run_of_a_minute(trainer, m.before, m.after, m.turn);
    // The margin of late steps (2 % of what is left), and what a plan may be off without a
    // correction (2.5 % of the budget).
    EXPECT_NEAR(result.train_seconds, 60, 60 * 0.025 + m.after) << m.before << " " << m.after;
    const TrainingPlan plan = trainer.options().plan();
    EXPECT_EQ(plan.changes.list.empty(), m.before == m.after);
    EXPECT_EQ(bits_of(trainer), bits_of_plan(c, plan)) << m.before << " " << m.after;
  }
}

// Speed changes that no plan foresees, at any time: the budget is used, and not overrun by much.
TEST(RunBudget, ABudgetIsUsedWheneverTheSpeedChanges) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  TrainOptions options = tiny_options(0);
  options.grid_recipe.batch_samples = 960;
  for (const double factor : {0.25, 0.5, 2.0, 4.0})
    for (const double turn : {3, 11, 22, 35, 47, 55, 58}) {
      const double before = 0.2, after = factor * before;
      Trainer trainer(c.scene, c.photos, options, pool);
      const double seconds = run_of_a_minute(trainer, before, after, turn).train_seconds;
      EXPECT_GT(seconds, 0.95 * 60) << "steps take " << factor << " times as long from " << turn;
      EXPECT_LT(seconds, 1.05 * 60) << "steps take " << factor << " times as long from " << turn;
    }
}

TEST(RunBudget, NoCorrectionTakesMoreThanHalfOfWhatIsLeft) {
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

TEST(RunBudget, AResumedBudgetGoesOnWithItsCorrectedPlan) {
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

TEST(RunBudget, ABudgetNeedsAHoldToFixItsPlanIn) {
  const auto c = sphere_capture();
  ThreadPool pool(1);
  TrainOptions brief = tiny_options(0);
  brief.hold = 0.01;
  Trainer trainer(c.scene, c.photos, brief, pool);
  RunOptions options = quiet();
  options.minutes = 1;
  EXPECT_TRUE(contains(error_of([&] { run_training(trainer, options, {}); }), "--hold"));
}

TEST(RunBudget, ABudgetDoesNotKnowOverHowManyStepsToAnneal) {
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

}  // namespace
}  // namespace nerf
