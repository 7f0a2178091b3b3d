#include "nerf/train/run.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "model/json_fields.h"
#include "nerf/base/error.h"
#include "nerf/math/random.h"
#include "train/run_speed.h"

namespace nerf {
namespace {

using internal::JsonFields;
using internal::SpeedMeter;

// A plan that is not fixed yet: far enough for every step to lie before TrainOptions::hold of it.
constexpr int64_t kNoPlan = int64_t{1} << 40;
// Share of the budget after which the plan is fixed, relative to TrainOptions::hold: early steps
// may be faster than late ones, and must not leave the hold before.
constexpr double kPlanWithinHold = 0.8;
constexpr double kLeastHold = 0.02;
// For what late steps cost beside the drawing of their rays, whose change is measured.
constexpr double kLateStep = 1.02;
// Shares of the budget after which the plan is corrected by the speed since: others use the
// machine.
constexpr std::array kCorrections = {0.3, 0.55, 0.75, 0.9};
constexpr double kOff = 0.02;            // of the budget: a plan that ends as near to it stays
constexpr double kFirstSave = 0.25;      // of the interval between checkpoints
constexpr double kMostEvaluation = 0.1;  // of the time of training, where it is not short anyway
constexpr double kEmptyOpacity = 0.001;
constexpr double kEmptyShare = 0.02;  // of the photos' own opacity

class Run {
 public:
  Run(Trainer& trainer, const RunOptions& options, const RunCallbacks& callbacks,
      const std::filesystem::path& checkpoint, const Cancel* cancel)
      : trainer_(trainer),
        options_(options),
        callbacks_(callbacks),
        checkpoint_(checkpoint),
        cancel_(cancel),
        budget_(60 * options.minutes),
        photo_opacity_(trainer.photo_opacity()) {
    if (budget_ <= 0) return;
    if (trainer.options().hold < kLeastHold)
      throw Error(
          "a budget of minutes fixes the number of steps within the hold, which is too short",
          "--hold", "give at least 0.02, or --steps");
    const NetworkRecipe& recipe = trainer.options().recipe;
    if (trainer.options().method != kGridMethod && recipe.anneal && recipe.anneal_steps == 0)
      throw Error("a budget of minutes does not know at first how many steps there are",
                  "--recipe-anneal-steps 0", "give a number from 1 on, or --steps");
    trainer_.set_planned_steps(kNoPlan);
  }

  void resume() {
    restore(trainer_.load_checkpoint(checkpoint_));
    have_checkpoint_ = true;
  }

  RunResult run() {
    // The first one early: most runs are stopped in their first minute.
    next_save_ = result_.train_seconds + kFirstSave * 60 * options_.checkpoint_every;
    next_evaluation_ = result_.train_seconds + 60 * options_.eval_every;
    while (trainer_.steps_done() < trainer_.options().steps && !stopped()) step();
    result_.steps = trainer_.steps_done();
    save();
    if (!stopped()) evaluate(/*last=*/true);
    result_.cancelled = stopped();
    return result_;
  }

 private:
  double seconds_now() const {
    if (callbacks_.clock) return callbacks_.clock();
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    return std::chrono::duration<double>(now).count();
  }
  bool stopped() const { return stopped_ || (cancel_ && cancel_->requested()); }
  bool plan_known() const { return trainer_.options().steps < kNoPlan; }

  void step() {
    const double begin = seconds_now();
    StepReport report;
    std::string failure;
    try {
      report = trainer_.step();
    } catch (const NonFiniteError& error) {
      failure = error.what();
    }
    const double took = seconds_now() - begin;
    result_.train_seconds += took;
    if (!failure.empty()) {
      go_back(failure, /*to_checkpoint=*/true);
      return;
    }
    result_.samples += report.samples;
    result_.rays += report.rays;
    speed_.add(took, report);
    if (budget_ > 0) plan_known() ? correct_when_due() : plan_when_due();
    if (is_empty(report)) {
      go_back("the scene stays empty: after " + std::to_string(report.step) +
                  " steps no ray meets anything",
              /*to_checkpoint=*/false);
      return;
    }
    if (callbacks_.step) callbacks_.step(progress(report));
    if (trainer_.steps_done() >= trainer_.options().steps) return;
    if (options_.checkpoint_every > 0 && result_.train_seconds >= next_save_) {
      save();
      next_save_ = result_.train_seconds + 60 * options_.checkpoint_every;
    }
    if (options_.eval_every > 0 && result_.train_seconds >= next_evaluation_) {
      const double before = result_.evaluation_seconds;
      evaluate(/*last=*/false);
      const double took = result_.evaluation_seconds - before;
      const double least = took > 1 ? took / kMostEvaluation : 0;
      next_evaluation_ = result_.train_seconds + std::max(60 * options_.eval_every, least);
    }
  }

  void plan_when_due() {
    const double hold = trainer_.options().hold;
    if (result_.train_seconds < kPlanWithinHold * hold * budget_ || speed_.steps() < 3) return;
    // Steps taken after the hold would have had another rate, had the plan been known.
    plan(static_cast<int64_t>(std::ceil(static_cast<double>(trainer_.steps_done()) / hold)));
  }

  void plan(int64_t least) {
    const Room room = room_for(speed_.step_seconds_ahead(), least);
    trainer_.set_planned_steps(room.steps);
    measured_from_ = speed_.steps();
    if (callbacks_.planned) callbacks_.planned(room.steps);
  }

  void correct_when_due() {
    constexpr int64_t kEnough = 8;  // steps to tell a speed from
    const auto due = [&](double share) { return result_.train_seconds >= share * budget_; };
    const auto passed = std::ranges::count_if(kCorrections, due);
    if (passed <= corrections_ || speed_.steps() - measured_from_ < kEnough) return;
    corrections_ = passed;
    const double seconds = speed_.mean_seconds_since(measured_from_);
    measured_from_ = speed_.steps();
    const int64_t planned = trainer_.options().steps, left = planned - trainer_.steps_done();
    if (left <= 0 || seconds <= 0) return;
    const Room room = room_for(seconds, 0);
    if (std::fabs(static_cast<double>(room.steps - planned)) * room.step_seconds < kOff * budget_)
      return;
    // The field needs a while at falling rates, however little time is left.
    const int64_t steps = std::max(room.steps, trainer_.steps_done() + (left + 1) / 2);
    trainer_.set_planned_steps(steps);
    if (callbacks_.planned) callbacks_.planned(steps);
  }

  struct Room {
    int64_t steps;        // of the whole run
    double step_seconds;  // of those that are left
  };

  // As many steps as the rest of the budget has room for, but not below `least`, where a step takes
  // so long now.
  Room room_for(double now, int64_t least) {
    const double left = std::max(budget_ - result_.train_seconds, 0.0);
    const double saving = trainer_.late_saving_seconds();
    Room room{least, now};
    // How much of it is saved on the way depends on how many steps there are.
    for (int i = 0; i < 3; ++i) {
      const int64_t more = static_cast<int64_t>(left / (kLateStep * room.step_seconds));
      room.steps = std::max(least, trainer_.steps_done() + std::max<int64_t>(1, more));
      room.step_seconds =
          std::max(0.25 * now, now - saving * trainer_.late_saving_share(room.steps));
    }
    return room;
  }

  bool is_empty(const StepReport& report) {
    opacity_ += (report.step <= 1 ? 1.0 : 0.05) * (report.opacity - opacity_);
    const int64_t due = std::min<int64_t>(options_.empty_after, trainer_.options().steps);
    return report.step >= due && opacity_ < std::min(kEmptyOpacity, kEmptyShare * photo_opacity_);
  }

  void go_back(const std::string& reason, bool to_checkpoint) {
    if (++result_.failures > kMostFailures)
      throw Error("training was given up after going back " + std::to_string(kMostFailures) +
                      " times: " + reason,
                  "", "check the photos and poses in the scene report, or lower --rate");
    const uint64_t salt = mix64(trainer_.options().seed + static_cast<uint64_t>(result_.failures));
    const double rate_factor = std::ldexp(1.0, -result_.failures);
    const bool planned = budget_ > 0 && plan_known();
    const int64_t steps = trainer_.options().steps;
    if (to_checkpoint && have_checkpoint_) {
      trainer_.load_checkpoint(checkpoint_);
      trainer_.vary(salt, rate_factor);
    } else {
      trainer_.restart(salt, rate_factor);
      opacity_ = 0;
      have_checkpoint_ = false;  // it is of the attempt that was given up: replaced at once
      next_save_ = result_.train_seconds;
    }
    if (planned && speed_.steps() > 0)
      plan(0);
    else if (planned)
      trainer_.set_planned_steps(steps);
    else if (budget_ > 0)
      trainer_.set_planned_steps(kNoPlan);
    if (callbacks_.went_back) callbacks_.went_back(reason, trainer_.steps_done());
  }

  RunProgress progress(const StepReport& report) const {
    RunProgress p;
    p.report = report;
    p.train_seconds = result_.train_seconds;
    if (plan_known()) {
      p.planned_steps = trainer_.options().steps;
      const int64_t left = p.planned_steps - report.step;
      p.fraction = static_cast<double>(report.step) / static_cast<double>(p.planned_steps);
      p.seconds_left = static_cast<double>(left) * speed_.step_seconds();
    } else {
      p.fraction = std::min(1.0, result_.train_seconds / budget_);
      p.seconds_left = std::max(0.0, budget_ - result_.train_seconds);
    }
    p.samples_per_second = speed_.samples_per_second();
    p.rays_per_second = speed_.rays_per_second();
    p.psnr = speed_.psnr();
    return p;
  }

  void save() {
    if (checkpoint_.empty()) return;
    const double begin = seconds_now();
    trainer_.save_checkpoint(checkpoint_, state());
    have_checkpoint_ = true;
    if (callbacks_.saved) callbacks_.saved();
    result_.saving_seconds += seconds_now() - begin;
  }

  void evaluate(bool last) {
    if (!callbacks_.evaluate) return;
    const double begin = seconds_now();
    try {
      callbacks_.evaluate(last);
    } catch (const Cancelled&) {
      stopped_ = true;
    }
    result_.evaluation_seconds += seconds_now() - begin;
  }

  std::string state() const {
    return nlohmann::ordered_json{{"minutes", options_.minutes},
                                  {"train_seconds", result_.train_seconds},
                                  {"evaluation_seconds", result_.evaluation_seconds},
                                  {"saving_seconds", result_.saving_seconds},
                                  {"samples", result_.samples},
                                  {"rays", result_.rays},
                                  {"failures", result_.failures},
                                  {"opacity", opacity_}}
        .dump();
  }

  void restore(const std::string& text) {
    if (text.empty()) return;  // saved by a program that drives its trainer itself
    const JsonFields f = JsonFields::parse(text, checkpoint_.string() + ": run");
    budget_ = 60 * f.number("minutes");
    result_.train_seconds = f.number("train_seconds");
    result_.evaluation_seconds = f.number("evaluation_seconds");
    result_.saving_seconds = f.number("saving_seconds");
    result_.samples = f.integer("samples", 0, INT64_MAX);
    result_.rays = f.integer("rays", 0, INT64_MAX);
    result_.failures = static_cast<int>(f.integer("failures", 0, kMostFailures));
    opacity_ = f.number("opacity");
    corrections_ = std::ranges::count_if(
        kCorrections, [&](double share) { return result_.train_seconds >= share * budget_; });
  }

  Trainer& trainer_;
  const RunOptions& options_;
  const RunCallbacks& callbacks_;
  const std::filesystem::path& checkpoint_;
  const Cancel* cancel_;
  double budget_;  // seconds; 0: the plan is given in steps
  double photo_opacity_;
  RunResult result_;
  SpeedMeter speed_;
  std::ptrdiff_t corrections_ = 0;  // that were due
  int64_t measured_from_ = 0;       // first step that the next one's speed is told from
  double opacity_ = 0;              // of the last steps' rays
  double next_save_ = 0, next_evaluation_ = 0;
  bool have_checkpoint_ = false, stopped_ = false;
};

}  // namespace

RunResult run_training(Trainer& trainer, const RunOptions& options, const RunCallbacks& callbacks,
                       const std::filesystem::path& checkpoint, bool resume, const Cancel* cancel) {
  Run run(trainer, options, callbacks, checkpoint, cancel);
  if (resume) run.resume();
  return run.run();
}

}  // namespace nerf
