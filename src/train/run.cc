#include "nerf/train/run.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "model/json_fields.h"
#include "nerf/base/error.h"
#include "nerf/math/random.h"
#include "nerf/train/methods.h"
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
// A plan is corrected by its steps' speed when this share of its time is over or of its steps
// taken, and so is what is left of it, until the end: others use the machine.
constexpr double kCorrectAfter = 1.0 / 3;
// A plan stays that ends so much before the budget, or after it: shares of the budget, and of what
// is left of it.
constexpr double kEarly = 0.025, kLate = 0.02, kLateOfRest = 0.2;
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
        photo_opacity_(trainer.photo_opacity()) {
    set_budget(options.minutes);
  }

  void begin() {
    if (budget_ > 0) begin_without_plan();
  }

  void resume() {
    restore(trainer_.load_checkpoint(checkpoint_));
    have_checkpoint_ = true;
    begin_measuring();
    if (!extend(options_.extend)) return;
    // From now on: a run that is killed goes on to its new length.
    save();
    if (callbacks_.extended) callbacks_.extended();
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

  void set_budget(double minutes) {
    minutes_ = minutes;
    budget_ = 60 * minutes;
  }

  // Of a budget whose number of steps is found within the hold.
  void begin_without_plan() {
    if (trainer_.options().hold < kLeastHold)
      throw Error(
          "a budget of minutes fixes the number of steps within the hold, which is too short",
          "--hold", "give at least 0.02, or --steps");
    if (depends_on_length(trainer_.options()))
      throw Error("a budget of minutes does not know at first how many steps there are",
                  "--recipe-anneal-steps 0", "give a number from 1 on, or --steps");
    trainer_.set_planned_steps(kNoPlan);
  }

  // Whether the length is another than it was.
  bool extend(const RunLength& to) {
    if (to.minutes <= 0 && to.steps <= 0) return false;
    const int64_t done = trainer_.steps_done(), planned = trainer_.options().steps;
    const bool by_steps = to.steps > 0, is_same_kind = by_steps == (budget_ <= 0);
    const bool is_same = is_same_kind && (by_steps ? to.steps == planned : to.minutes == minutes_);
    if (is_same && done < planned) return false;  // given once more
    const double speed = result_.train_seconds > 0
                             ? static_cast<double>(done) / result_.train_seconds
                             : 0;  // steps per second so far
    const int64_t steps =
        by_steps ? to.steps : static_cast<int64_t>(std::min(60 * to.minutes * speed, 1e12));
    const bool is_longer =
        is_same_kind && !by_steps ? to.minutes > minutes_ : steps > (plan_known() ? planned : done);
    const bool is_room = by_steps || 60 * to.minutes > result_.train_seconds;
    if (!is_longer || !is_room) throw not_longer(to);
    set_budget(to.minutes);
    if (!by_steps && (!plan_known() || steps == 0)) {
      begin_without_plan();
      return true;
    }
    trainer_.set_planned_steps(std::max(steps, done + 1));
    begin_measuring();
    return true;
  }

  Error not_longer(const RunLength& to) const {
    const auto in_words = [](double minutes, int64_t steps) {
      return minutes > 0 ? fmt::format("{:g} minutes", minutes) : fmt::format("{} steps", steps);
    };
    const int64_t done = trainer_.steps_done();
    const std::string so_far =
        fmt::format("{} steps in {:.3g} minutes", done, result_.train_seconds / 60);
    return Error(fmt::format("the run is {} long ({} so far), and {} is not longer",
                             in_words(minutes_, trainer_.options().steps), so_far,
                             in_words(to.minutes, to.steps)),
                 checkpoint_.string(),
                 "give the length of the whole run, with what it had until now");
  }

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
    begin_measuring();
    if (callbacks_.planned) callbacks_.planned(room.steps);
  }

  void begin_measuring() { measured_from_ = {trainer_.steps_done(), result_.train_seconds}; }

  void correct_when_due() {
    const int64_t done = trainer_.steps_done(), planned = trainer_.options().steps;
    const int64_t left = planned - done, measured = done - measured_from_.steps;
    const double seconds = result_.train_seconds - measured_from_.seconds;
    const bool due = seconds >= kCorrectAfter * (budget_ - measured_from_.seconds) ||
                     static_cast<double>(measured) >=
                         kCorrectAfter * static_cast<double>(planned - measured_from_.steps);
    // So many tell a speed.
    if (!due || left <= 0 || measured < std::clamp<int64_t>(planned / 128, 1, 8)) return;
    begin_measuring();
    if (seconds <= 0) return;
    const Room room = room_for(seconds / static_cast<double>(measured), 0);
    const double time_left = budget_ - result_.train_seconds;
    const double early = time_left - static_cast<double>(left) * room.step_seconds;
    if (early < kEarly * budget_ && early > -std::min(kLate * budget_, kLateOfRest * time_left))
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
    begin_measuring();
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
    return nlohmann::ordered_json{{"minutes", minutes_},
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
    set_budget(f.number("minutes"));
    result_.train_seconds = f.number("train_seconds");
    result_.evaluation_seconds = f.number("evaluation_seconds");
    result_.saving_seconds = f.number("saving_seconds");
    result_.samples = f.integer("samples", 0, INT64_MAX);
    result_.rays = f.integer("rays", 0, INT64_MAX);
    result_.failures = static_cast<int>(f.integer("failures", 0, kMostFailures));
    opacity_ = f.number("opacity");
  }

  Trainer& trainer_;
  const RunOptions& options_;
  const RunCallbacks& callbacks_;
  const std::filesystem::path& checkpoint_;
  const Cancel* cancel_;
  double minutes_ = 0, budget_ = 0;  // the latter in seconds; 0: the plan is given in steps
  double photo_opacity_;
  RunResult result_;
  SpeedMeter speed_;
  struct {
    int64_t steps = 0;
    double seconds = 0;
  } measured_from_;     // since when the speed is measured that the plan is corrected by
  double opacity_ = 0;  // of the last steps' rays
  double next_save_ = 0, next_evaluation_ = 0;
  bool have_checkpoint_ = false, stopped_ = false;
};

}  // namespace

RunResult run_training(Trainer& trainer, const RunOptions& options, const RunCallbacks& callbacks,
                       const std::filesystem::path& checkpoint, bool resume, const Cancel* cancel) {
  Run run(trainer, options, callbacks, checkpoint, cancel);
  resume ? run.resume() : run.begin();
  return run.run();
}

}  // namespace nerf
