// For tests of run_training().
#pragma once

#include <functional>

#include "nerf/train/run.h"

namespace nerf::test {

// Without checkpoints and evaluations on the way.
inline RunOptions quiet() {
  RunOptions options;
  options.checkpoint_every = options.eval_every = 0;
  return options;
}

// A clock by which steps take `before` seconds until `turn` seconds have gone, then `after`. It is
// asked as a step begins and as it ends.
inline std::function<double()> clock_of_steps(double before, double after, double turn) {
  return [=, now = 0.0, in_step = false]() mutable {
    if (in_step) now += now < turn ? before : after;
    in_step = !in_step;
    return now;
  };
}

}  // namespace nerf::test
