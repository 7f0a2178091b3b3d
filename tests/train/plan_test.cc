// Plans whose length changes on the way.
#include "nerf/train/plan.h"

#include <gtest/gtest.h>

#include "nerf/train/trainer.h"
#include "support/temp_folder.h"

namespace nerf {
namespace {

TEST(Plan, WithoutChangesProgressIsLinearAfterTheHold) {
  const TrainingPlan plan{200, 0.1, {}};
  for (const int64_t step : {0, 7, 20}) EXPECT_EQ(plan.progress_at(step), 0) << step;
  EXPECT_NEAR(plan.progress_at(110), 0.5, 1e-15);
  EXPECT_EQ(plan.progress_at(200), 1);
  EXPECT_EQ(plan.progress_at(300), 1);
  EXPECT_EQ((TrainingPlan{0, 0.1, {}}.progress_at(0)), 0);
}

TEST(Plan, AChangeGoesOnFromWhereProgressIs) {
  // Half of the way after 110 of 200 steps; the other half takes the 40 until 150, if nothing
  // changes once more after 20 of them: then the last quarter takes 60.
  const TrainingPlan first{200, 0.1, {}};
  const TrainingPlan second = first.changed(110, 150);
  const TrainingPlan third = second.changed(130, 190);
  EXPECT_EQ(second.changes, (PlanChanges{{{110, 200}}}));
  EXPECT_EQ(third.changes, (PlanChanges{{{110, 200}, {130, 150}}}));
  EXPECT_EQ(third.steps, 190);
  for (int64_t step = 0; step <= 110; ++step)
    EXPECT_EQ(third.progress_at(step), first.progress_at(step)) << step;
  for (int64_t step = 111; step <= 130; ++step)
    EXPECT_EQ(third.progress_at(step), second.progress_at(step)) << step;
  EXPECT_NEAR(second.progress_at(130), 0.75, 1e-15);
  EXPECT_NEAR(third.progress_at(160), 0.875, 1e-15);
  EXPECT_EQ(second.progress_at(150), 1);
  EXPECT_EQ(third.progress_at(190), 1);
  for (int64_t step = 1; step <= 200; ++step)
    EXPECT_GE(third.progress_at(step), third.progress_at(step - 1)) << step;
}

TEST(Plan, NothingIsKeptOfWhatNoStepDependsOn) {
  const TrainingPlan plan{200, 0.1, {}};
  EXPECT_TRUE(plan.changed(20, 300).changes.list.empty());  // within the hold of both
  EXPECT_TRUE(plan.changed(15, 150).changes.list.empty());
  EXPECT_EQ(plan.changed(15, 100).changes, (PlanChanges{{{15, 200}}}));  // of the first alone
  EXPECT_EQ(plan.changed(15, 100).progress_at(15), 0);
  EXPECT_TRUE(plan.changed(110, 200).changes.list.empty());  // the same length
  const TrainingPlan changed = plan.changed(50, 150).changed(100, 180);
  ASSERT_EQ(changed.changes.list.size(), 2u);
  // Back at a step before: what was planned for later is forgotten.
  EXPECT_EQ(changed.changed(70, 120).changes, (PlanChanges{{{50, 200}, {70, 150}}}));
  EXPECT_EQ(changed.changed(50, 120).changes, (PlanChanges{{{50, 200}}}));
  EXPECT_EQ(changed.changed(30, 120).changes, (PlanChanges{{{30, 200}}}));
  EXPECT_TRUE(changed.changed(0, 120).changes.list.empty());
}

TEST(Plan, APlanThatIsDoneIsExtended) {
  const TrainingPlan plan{200, 0.1, {}};
  const TrainingPlan longer = plan.changed(200, 300);
  EXPECT_EQ(longer.changes, (PlanChanges{{{200, 200}}}));
  for (int64_t step = 0; step < 200; ++step)
    EXPECT_EQ(longer.progress_at(step), plan.progress_at(step)) << step;
  // As if it had been so long from the beginning; once more likewise.
  const TrainingPlan whole{300, 0.1, {}}, longest{800, 0.1, {}};
  const TrainingPlan again = longer.changed(300, 800);
  EXPECT_EQ(again.changes, (PlanChanges{{{200, 200}, {300, 300}}}));
  for (int64_t step = 200; step <= 300; ++step)
    EXPECT_EQ(longer.progress_at(step), whole.progress_at(step)) << step;
  for (int64_t step = 0; step < 300; ++step)
    EXPECT_EQ(again.progress_at(step), longer.progress_at(step)) << step;
  for (int64_t step = 300; step <= 800; ++step)
    EXPECT_EQ(again.progress_at(step), longest.progress_at(step)) << step;
  // After a change: the stretch since it is planned anew.
  const TrainingPlan changed = plan.changed(110, 150).changed(150, 300);
  EXPECT_EQ(changed.changes, (PlanChanges{{{110, 200}, {150, 150}}}));
  EXPECT_NEAR(changed.progress_at(150), 0.5 + 0.5 * 40 / 190, 1e-15);
  // Corrected on the way, at once as well.
  EXPECT_EQ(longer.changed(200, 400).changes, longer.changes);
  EXPECT_EQ(longer.changed(250, 400).changes, (PlanChanges{{{200, 200}, {250, 300}}}));
  EXPECT_NEAR(longer.changed(250, 400).progress_at(250), whole.progress_at(250), 1e-15);
}

TEST(Plan, TheLengthInForceIsThatOfTheNextChange) {
  const TrainingPlan plan{800, 0.1, {{{110, 200}, {150, 150}}}};
  const struct {
    int64_t step, length;
  } expected[] = {{0, 200}, {109, 200}, {110, 150}, {149, 150}, {150, 800}, {900, 800}};
  for (const auto& e : expected) EXPECT_EQ(plan.length_at(e.step), e.length) << e.step;
  // What depends on the length itself does so within the hold too.
  const TrainingPlan first{200, 0.1, {}};
  EXPECT_EQ(first.changed(15, 150, /*length_matters=*/true).changes, (PlanChanges{{{15, 200}}}));
  EXPECT_TRUE(first.changed(0, 150, /*length_matters=*/true).changes.list.empty());
}

TEST(Plan, ChangesAreAnOption) {
  TrainOptions options;
  options.steps = 500;
  const auto field = [&] {
    for (OptionField& f : option_fields(options))
      if (f.name == "plan_changes") return f;
    throw std::logic_error("no such option");
  };
  EXPECT_EQ(option_text(field()), "");
  set_option_text(field(), "110:200,130:150", "here");
  EXPECT_EQ(options.plan_changes, (PlanChanges{{{110, 200}, {130, 150}}}));
  EXPECT_EQ(option_text(field()), "110:200,130:150");
  EXPECT_NO_THROW(validate_options(options, "here"));
  set_option_text(field(), "110:110", "here");  // extended
  EXPECT_EQ(options.plan_changes, (PlanChanges{{{110, 110}}}));
  set_option_text(field(), "110:200,130:150", "here");
  for (const char* bad :
       {"110", "110:", ":200", "110:200,", ",110:200", "110:200;130:150", "0:5", "5:4", "-3:7",
        "130:150,110:200", "110:200,110:300", "1e2:200", "110:99999999999999999999", "110:200:300"})
    EXPECT_NE(test::error_of([&] { set_option_text(field(), bad, "here"); }), "") << bad;
  options.steps = 130;
  EXPECT_TRUE(
      test::contains(test::error_of([&] { validate_options(options, "here"); }), "--plan-changes"));
}

}  // namespace
}  // namespace nerf
