// How far a training is, where the number of its steps may change on the way.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "nerf/base/options.h"

namespace nerf {

// Until `step` the training was to be `length` steps long; where the two are the same it was done
// and then extended.
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
  // then linear to 1 at the end. From each change on linear from where it was by then; after an
  // extension below 1 again, as if the new length had been known since the change before.
  double progress_at(int64_t step) const;
  // The length in force as the step after `step` others was taken.
  int64_t length_at(int64_t step) const;
  // The plan as of `done` steps, from when on it is to be so many: progress is the same until then
  // and goes on from there, and what was planned for steps that are not done is forgotten. A plan
  // whose steps are all done is extended. What no progress depended on is not kept, unless
  // `length_matters`: steps depend on the length itself.
  TrainingPlan changed(int64_t done, int64_t steps, bool length_matters = false) const;
};

}  // namespace nerf
