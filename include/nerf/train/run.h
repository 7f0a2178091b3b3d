// A training from beginning to end: to a number of steps or a budget of time, with evaluations and
// checkpoints at intervals, and a second chance where it goes wrong.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "nerf/base/cancel.h"
#include "nerf/base/options.h"
#include "nerf/train/trainer.h"

namespace nerf {

// Of a whole run: minutes of training, or steps. Both 0: none.
struct RunLength {
  double minutes = 0;
  int64_t steps = 0;
};

struct RunOptions {
  // Budget of time for training steps; evaluation and saving do not count. 0: TrainOptions::steps
  // is the length. Within TrainOptions::hold of the budget the plan is not known and nothing may
  // depend on it (a recipe that anneals needs anneal_steps); then it is fixed from the measured
  // speed, so that a run of that many steps gives the same bits. Where the speed changes it is
  // corrected on the way (TrainOptions::plan_changes).
  double minutes = 0;
  // Of a run that is resumed, from now on, in place of the checkpoint's length, be it of the other
  // kind; must be longer.
  RunLength extend;
  double checkpoint_every = 2;  // minutes of training; 0: only at the end
  // Minutes of training, more where an evaluation takes longer than a tenth of them; 0: only at the
  // end.
  double eval_every = 2;
  int empty_after = 500;  // steps after which a scene without any opacity counts as failed
};

struct RunProgress {
  StepReport report;          // of the last step
  int64_t planned_steps = 0;  // 0 while a budget's plan is not fixed
  double fraction = 0;        // of the run, in [0, 1]
  double train_seconds = 0;   // of steps, those before a resume included
  double seconds_left = 0;
  // Over the last second or so.
  double samples_per_second = 0, rays_per_second = 0;
  double psnr = 0;  // of the mean squared error, dB
};

// All optional; called on the thread that called run_training.
struct RunCallbacks {
  std::function<void(const RunProgress&)> step;  // after every step
  // A budget's plan was fixed, corrected or, after a failure, fixed again.
  std::function<void(int64_t steps)> planned;
  // The run has the length of RunOptions::extend, and its checkpoint too.
  std::function<void()> extended;
  // Training went back after a failure, which `reason` names: to the step given, with half the
  // rate.
  std::function<void(const std::string& reason, int64_t step)> went_back;
  // At intervals, and with `last` when training is done. May throw Cancelled.
  std::function<void(bool last)> evaluate;
  std::function<void()> saved;  // a checkpoint was written
  // Seconds since some moment, by which steps, evaluations and savings are timed; without it
  // std::chrono::steady_clock.
  std::function<double()> clock;
};

struct RunResult {
  bool cancelled = false;
  int64_t steps = 0;
  int64_t samples = 0, rays = 0;  // of all steps, those before a resume included
  double train_seconds = 0, evaluation_seconds = 0, saving_seconds = 0;
  int failures = 0;  // how often training went back
  double samples_per_second() const {
    return train_seconds > 0 ? static_cast<double>(samples) / train_seconds : 0;
  }
};

// Bytes that a trainer takes with its model, saving and resuming included, without the photos: an
// estimate from above. Allocates nothing.
uint64_t training_memory_bytes(const TrainOptions& options, bool unbounded, int threads);

// How often a run may go back before it is given up.
inline constexpr int kMostFailures = 3;

// Trains until the plan is fulfilled or `cancel` is requested. With a `checkpoint` path it saves
// there at intervals, at the end and on cancel; with `resume` it begins with what was saved there,
// plan and clock included, and throws Error where RunOptions::extend is not longer. A step with a
// loss or gradient that is not finite goes back to the last checkpoint of this run (else to the
// start); a scene that stays empty though the photos are not, to the start; each time with another
// salt for every random number and half the rate. Throws Error with the reason after kMostFailures
// of those, and what saving throws.
RunResult run_training(Trainer& trainer, const RunOptions& options, const RunCallbacks& callbacks,
                       const std::filesystem::path& checkpoint = {}, bool resume = false,
                       const Cancel* cancel = nullptr);

}  // namespace nerf
