// How far a training is, where the number of its steps may change on the way.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "nerf/base/options.h"

namespace nerf {

// Until `step` the training was to be `length` steps long.
struct PlanChange {
  int64_t step = 0, length = 0;
  bool operator==(const PlanChange&) const = default;
};

// In the order of their steps; as text STEP:LENGTH,STEP:LENGTH,...
struct PlanChanges {
  std::vector<PlanChange> list;
  bool operator==(const PlanChanges&) const = default;
};

template <>
struct OptionTraits<PlanChanges> {
  static constexpr OptionType kType = OptionType::kText;
  static void describe(OptionField& field);
  static OptionValue to_value(const PlanChanges& changes);
  static PlanChanges from_value(const OptionValue& value);
};

// A training of `steps` steps, after the changes.
struct TrainingPlan {
  int64_t steps = 0;
  double hold = 0;  // share of the first length during which progress is 0; below 1
  PlanChanges changes;

  // In [0, 1], never falling with `step`, the number of steps that were done: 0 during the hold,
  // then linear to 1 at the end. From each change on linear from where it was by then.
  double progress_at(int64_t step) const;
  // The plan as of `done` steps, from when on it is to be so many: progress is the same until then
  // and goes on from there, and what was planned for steps that are not done is forgotten. Where
  // all steps are done, the last stretch is planned anew, and progress falls below 1 again.
  TrainingPlan changed(int64_t done, int64_t steps) const;
};

}  // namespace nerf
