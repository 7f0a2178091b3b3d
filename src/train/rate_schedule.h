// How the step size rises at first and falls to the end.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "nerf/train/trainer.h"

namespace nerf {

enum class Rise {
  kLinear,       // the first step takes a share of 1 / warmup_steps
  kQuarterSine,  // from a share of the rate (mip-NeRF's math.py)
};
enum class Fall {
  kLinear,
  kExponential,  // bmild/nerf: rate 0.1^(t / decay); mip-NeRF: log-linear
};

struct RateSchedule {
  Rise rise = Rise::kLinear;
  Fall fall = Fall::kLinear;
  double first_share = 1;  // of kQuarterSine

  // The step size of the step after `step` others, `progress` (TrainingPlan) being made and
  // `factor` being what failures left of it.
  Real at(const TrainOptions& o, int64_t step, double progress, double factor) const {
    double risen = 1;
    const double steps = static_cast<double>(step), warmup = static_cast<double>(o.warmup_steps);
    if (rise == Rise::kLinear)
      risen = std::min(1.0, (steps + 1) / std::max(warmup, 1.0));
    else if (o.warmup_steps > 0)
      risen = std::lerp(first_share, 1.0,
                        std::sin(0.5 * std::numbers::pi * std::min(1.0, steps / warmup)));
    const double fallen = fall == Fall::kLinear ? std::lerp(1.0, o.final_rate, progress)
                                                : std::pow(o.final_rate, progress);
    return static_cast<Real>(o.rate * factor * risen * fallen);
  }
};

}  // namespace nerf
