// nerf_train: from photographs to a radiance field.
#include <fmt/format.h>

#include <csignal>

#include "app.h"
#include "light_notes.h"
#include "medium_notes.h"
#include "nerf/base/file.h"
#include "nerf/base/progress.h"
#include "nerf/base/threads.h"
#include "nerf/io/photo_scales.h"
#include "nerf/io/photos.h"
#include "nerf/io/plane_sweep.h"
#include "nerf/io/scene.h"
#include "nerf/model/options_json.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/run.h"
#include "options_cli.h"
#include "photo_needs.h"
#include "read_capture.h"
#include "render_plan.h"
#include "run_folder.h"
#include "run_notes.h"
#include "run_report.h"
#include "score_text.h"
#include "train_options.h"

namespace nerf::apps {
namespace {

// The command of the run to go on with, or of a new one with everything decided.
void complete(TrainCommand& command, const std::set<std::string>& given, const RunFolder& folder) {
  std::error_code ignored;
  if (command.resume && (given.contains("minutes") || given.contains("steps")))
    command.extend = {command.minutes.value_or(0), command.train.steps};
  if (command.resume && std::filesystem::exists(folder.options(), ignored)) {
    TrainCommand saved;
    options_from_json(saved, read_text_file(folder.options()), folder.options().string());
    resume_options(command, given, saved, folder.path().string());
  }
  // Of a run whose options.json is lost.
  if (!command.minutes && command.train.steps == 0)
    command.minutes = default_minutes(command.train.method, command.scale);
}

// "219 k samples/s", "1.22 M samples/s".
std::string rate_text(double x, const char* unit) {
  return x < 1e6 ? fmt::format("{:.0f} k {}/s", x / 1e3, unit)
                 : fmt::format("{:.2f} M {}/s", x / 1e6, unit);
}

// One training with its screen and its folder.
class Training {
 public:
  // `line` is the command as it was given, `record` what is printed.
  Training(const TrainCommand& command, const std::string& line, const LogRecord& record,
           const RunFolder& folder, const Scene& scene, const PhotoSet& photos, ThreadPool& pool,
           const SignalCancel& stop)
      : command_(command),
        record_(record),
        folder_(folder),
        scene_(scene),
        photos_(photos),
        pool_(pool),
        stop_(stop),
        trainer_(scene, photos, command.train, pool),
        notes_(notes_of(scene)) {
    notes_.command = line;
  }

  int run() {
    const bool resume = begin();
    RunOptions options;
    options.minutes = command_.minutes.value_or(0);
    if (resume) options.extend = command_.extend;
    options.checkpoint_every = command_.checkpoint_every;
    options.eval_every = command_.eval_every;
    RunCallbacks callbacks;
    callbacks.step = [&](const RunProgress& p) { on_step(p); };
    callbacks.planned = [&](int64_t steps) { on_plan(steps); };
    callbacks.extended = [&] { on_extension(); };
    callbacks.went_back = [&](const std::string& reason, int64_t step) {
      progress_.clear();
      metrics_.reset();  // opened anew without the steps that are taken again
      log_warning(fmt::format(
          "{}; going back to step {} with other random numbers and half the rate", reason, step));
    };
    callbacks.evaluate = [&](bool last) { on_evaluation(last); };
    callbacks.saved = [&] { trainer_.snapshot().save(folder_.model()); };
    summary_.run =
        run_training(trainer_, options, callbacks, folder_.checkpoint(), resume, &stop_.cancel());
    progress_.finish();
    if (!summary_.run.cancelled && !scene_.test.empty())
      add_to_metrics(summary_.run.train_seconds, summary_.evaluation);
    return summary_.run.cancelled ? leave_stopped() : finish();
  }

 private:
  bool begin() {
    const bool resume = command_.resume && folder_.has_checkpoint();
    if (command_.resume && !resume)
      log_warning("no checkpoint was written before the run was stopped: it begins anew");
    if (!resume) {
      folder_.clear();
      save_options(command_);
    }
    if (!scene_.test.empty()) make_writable_folder(folder_.pictures());
    log_lines(trainer_.rolling_shutter());
    save_notes();
    return resume;
  }

  void save_notes() const {
    RunNotes notes = notes_;
    notes.printed = record_.lines();
    for (const std::string& line : notes.printed)
      if (LogRecord::is_warning(line)) notes.warnings.push_back(line);
    write_notes(folder_.notes(), notes);
  }

  void save_options(TrainCommand command) const {
    command.resume = command.overwrite = false;
    command.scene = std::filesystem::absolute(command.scene);  // --resume may run from elsewhere
    write_file_atomically(folder_.options(), options_to_json(command));
  }

  void on_extension() {
    folder_.begin_again();
    TrainCommand saved = command_;
    saved.train.plan_changes = {};
    if (!saved.minutes) saved.train.plan_changes = trainer_.options().plan_changes;
    save_options(saved);
    log_info(saved.minutes ? fmt::format("extended to {:g} minutes", *saved.minutes)
                           : fmt::format("extended to {} steps", saved.train.steps));
  }

  void on_step(const RunProgress& p) {
    const int64_t step = p.report.step;
    if (!metrics_) metrics_.emplace(folder_.metrics(), step - 1);
    if (step % command_.report_every == 0 || step == p.planned_steps) metrics_->add_step(p);
    last_ = p;
    const std::string of = p.planned_steps ? fmt::format("/{}", p.planned_steps) : "";
    progress_.update(p.fraction,
                     fmt::format("step {}{}  {}  {}  {:.1f} dB", step, of,
                                 rate_text(p.samples_per_second, "samples"),
                                 rate_text(p.rays_per_second, "rays"), p.psnr),
                     p.seconds_left);
  }

  void on_plan(int64_t steps) {
    progress_.clear();
    const TrainingPlan plan = trainer_.options().plan();
    if (plan.changes.list.empty())
      log_info(fmt::format("the plan is {} steps; the same result again: {}", steps,
                           equivalent_command(command_, plan)));
    else  // the whole command once, at the end
      log_info(fmt::format("the speed has changed: the plan is {} steps now", steps));
  }

  void on_evaluation(bool last) {
    if (last) progress_.finish();
    if (scene_.test.empty()) return;
    progress_.clear();
    EvaluationOptions options;
    options.max_views = last ? 0 : command_.eval_views;
    options.pictures = folder_.pictures();
    options.precision = trainer_.options().precision;
    options.fit_light = command_.fit_light;
    options.align = last && (command_.align_cameras || refines());
    Progress progress("evaluating");
    const Evaluation e = evaluate(
        trainer_.snapshot(), scene_, photos_, options, pool_,
        [&](double f) {
          if (last) progress.update(f);
        },
        &stop_.cancel());
    progress.clear();
    if (last) {
      summary_.evaluation = e;  // its line is written when the run's clock is known
      return;
    }
    add_to_metrics(last_.train_seconds, e);
    log_info(fmt::format("step {}: PSNR {:.2f} dB, SSIM {:.4f} on {} held-out view{}",
                         trainer_.steps_done(), e.psnr, e.ssim, e.counted,
                         e.counted == 1 ? "" : "s"));
  }

  void add_to_metrics(double train_seconds, const Evaluation& e) {
    const int64_t step = trainer_.steps_done();
    if (!metrics_) metrics_.emplace(folder_.metrics(), step);  // resumed when all was done
    metrics_->add_evaluation(step, train_seconds, e);
  }

  bool refines() const {
    return trainer_.options().grid_recipe.cameras.refine == RefineCameras::kOn;
  }

  int leave_stopped() {
    const int64_t planned = trainer_.options().steps;
    const std::string of = last_.planned_steps ? fmt::format(" of {}", planned) : std::string();
    log_info(
        fmt::format("stopped by {} at step {}{}; checkpoint and model are saved; to go on: "
                    "nerf_train -o {} --resume",
                    stop_.signal() == SIGINT ? "SIGINT" : "SIGTERM", summary_.run.steps, of,
                    shell_quoted(folder_.path().string())));
    return stop_.exit_code();
  }

  int finish() {
    const RunResult& run = summary_.run;
    summary_.scene = command_.scene.string();
    summary_.seed = command_.train.seed;
    summary_.threads = pool_.size();
    summary_.precision = precision_name(trainer_.options().precision);
    summary_.decode_seconds = photos_.decode_seconds;
    summary_.profile = trainer_.profile();
    summary_.readouts = trainer_.readouts();
    const RadianceField model = trainer_.snapshot();
    summary_.light = light_report(model, scene_, photos_);
    summary_.medium = model.medium();
    write_result(folder_.result(), summary_);
    log_info(fmt::format("training    {}, {} steps, {}", format_duration(run.train_seconds),
                         run.steps, rate_text(run.samples_per_second(), "samples")));
    log_info(fmt::format("besides     decoding {:.1f} s, evaluation {:.1f} s, saving {:.1f} s",
                         photos_.decode_seconds, run.evaluation_seconds, run.saving_seconds));
    for (const std::string& line : score_lines(summary_.evaluation)) log_info(line);
    for (const std::string& line : light_lines(summary_.light)) log_info(line);
    for (const std::string& line : medium_lines(summary_.medium)) log_info(line);
    write_left_out();
    log_lines(trainer_.rolling_shutter());
    if (const TrainingPlan plan = trainer_.options().plan(); !plan.changes.list.empty())
      log_info("the same result again: " + equivalent_command(command_, plan));
    if (refines() || scene_.cameras_adjusted)
      write_cameras(folder_.refined(), trainer_.snapshot().info(), scene_);
    log_info(fmt::format("written to  {}", folder_.path().string()));
    report();
    return kExitOk;
  }

  // A page to look at. The run stands without it.
  void report() {
    try {
      notes_.repeat = equivalent_command(command_, trainer_.options().plan());
      save_notes();
      log_info(fmt::format("report      {}", write_report(folder_.path(), pool_).string()));
    } catch (const std::exception& error) {
      log_warning(fmt::format("the report is not written: {}", one_line(error.what())));
    }
  }

  // Pictures of what was taken for passing by, for a person to look at.
  void write_left_out() const {
    const auto left_out = trainer_.left_out();
    const auto folder = folder_.path() / "left_out";
    for (const Trainer::LeftOut& photo : left_out) {
      const auto file = folder / picture_file(photo.name);
      make_writable_folder(file.parent_path());
      write_image(file, photo.picture);
    }
    if (!left_out.empty()) log_info(fmt::format("left out    {} (black)", folder.string()));
  }

  const TrainCommand& command_;
  const LogRecord& record_;
  const RunFolder& folder_;
  const Scene& scene_;
  const PhotoSet& photos_;
  ThreadPool& pool_;
  const SignalCancel& stop_;
  Trainer trainer_;
  RunNotes notes_;
  Progress progress_{"training"};
  std::optional<MetricsFile> metrics_;
  RunProgress last_;
  RunSummary summary_;
};

int train_main(int argc, char** argv) {
  const LogRecord record;
  TrainCommand command;
  const CommandLine line = parse_command_line(argc, argv, train_program_text(), command);
  if (line.exit) return kExitOk;
  if (command.list_methods) {
    fmt::print("{}", methods_table());
    return kExitOk;
  }
  command = with_preset(command, line.given);
  check_given(command, line.given);
  const SignalCancel stop;
  if (command.out.empty()) command.out = default_run_folder(command.scene);
  RunFolder folder(command.out, command.resume, command.overwrite);
  complete(command, line.given, folder);
  ThreadPool pool(command.threads);
  log_machine("nerf_train", pool.size(), command.train.precision);
  Scene scene = read_scene(command, pool, stop);
  for (const std::string& warning : unused_options(command, line.given, scene))
    log_warning(warning);
  PhotoSet photos = decode(scene, pool, stop);
  say_depth(add_depth_points(scene, photos, pool, &stop.cancel()), scene);
  if (const int added = add_swept_points(scene, photos, pool, &stop.cancel()); added > 0)
    log_info(
        fmt::format("the capture does not say which photos see which points: {} were found in the "
                    "photos; near, "
                    "far {:.4g}, {:.4g}",
                    added, scene.near / scene.to_engine.scale, scene.far / scene.to_engine.scale));
  look_at_light(command, folder.has_checkpoint() && command.resume, scene, photos, pool,
                stop.cancel());
  look_at_motion(command, scene);
  add_photo_scales(scene, photos, command.scales, learns_from_reduced_photos(command.train), pool);
  folder.keep();
  return Training(command, command_text(argc, argv), record, folder, scene, photos, pool, stop)
      .run();
}

}  // namespace
}  // namespace nerf::apps

int main(int argc, char** argv) {
  return nerf::apps::run_main("nerf_train", [&] { return nerf::apps::train_main(argc, argv); });
}
