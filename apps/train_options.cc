#include "train_options.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "app.h"
#include "nerf/io/capture_tools.h"
#include "run_folder.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;

// May differ between the parts of a run.
constexpr std::array kFree = {"scene",       "out",        "threads",    "resume",
                              "overwrite",   "eval_every", "eval_views", "checkpoint_every",
                              "report_every"};

// What the grid's trainer alone reads, besides the options of its groups.
constexpr std::array kOfTheGrid = {"batch_samples",
                                   "network_rate",
                                   "beta1",
                                   "final_beta1",
                                   "beta2",
                                   "final_beta2",
                                   "huber_delta",
                                   "distortion",
                                   "depth_loss",
                                   "network_l2",
                                   "early_samples",
                                   "late_levels",
                                   "coarse_photos",
                                   "error_guidance",
                                   "shared_colour",
                                   "stop_transmittance",
                                   "gradient_roulette",
                                   "occupancy_threshold",
                                   "every_row",
                                   "keep_unseen",
                                   "keep_transparent",
                                   "keep_free"};

// Whether the method reads the training option of that name.
bool is_read(const std::string& name, bool grid) {
  if (name.starts_with("grid.")) return grid;
  if (name.starts_with("network.") || name.starts_with("recipe.")) return !grid;
  return grid || std::ranges::find(kOfTheGrid, name) == kOfTheGrid.end();
}

std::string flag_of(const std::string& name) {
  OptionField field;
  field.name = name;
  return option_flag(field);
}

bool is_free(const OptionField& field) {
  return std::find(kFree.begin(), kFree.end(), field.name) != kFree.end();
}

// Of those, what the run's later parts do not take over from its first.
bool is_of_this_part(const OptionField& field) {
  constexpr std::array kOwn = {"scene", "out", "threads", "resume", "overwrite"};
  return std::find(kOwn.begin(), kOwn.end(), field.name) != kOwn.end();
}

bool is_utf8(const std::string& text) {
  try {
    nlohmann::json(text).dump();
  } catch (const nlohmann::json::type_error&) {
    return false;
  }
  return true;
}

}  // namespace

double default_minutes(const std::string& method, Scale scale) {
  if (method == kGridMethod) return 5;
  return scale == Scale::kTiny ? 4 : 50;
}

TrainCommand with_preset(const TrainCommand& command, const std::set<std::string>& given) {
  TrainCommand out = command;
  out.train = method_options(command.train.method, command.scale);
  const int64_t steps = given.contains("steps") ? command.train.steps : out.train.steps;
  if (!command.minutes && !command.resume && steps == 0)
    out.minutes = default_minutes(command.train.method, command.scale);
  // A budget of minutes has a length of its own, and needs a while at the first rate to find it.
  if (out.minutes) {
    out.train.steps = 0;
    out.train.hold = std::max(out.train.hold, TrainOptions().hold);
  }
  TrainOptions wanted = command.train;
  const auto to = option_fields(out.train), from = option_fields(wanted);
  for (size_t i = 0; i < to.size(); ++i)
    if (given.contains(to[i].name)) to[i].set(from[i].get());
  // What is said of the capture goes before a method's usual distances.
  if (out.near && !given.contains("recipe.near")) out.train.recipe.near = 0;
  if (out.far && !given.contains("recipe.far")) out.train.recipe.far = 0;
  // Nor does it know that length while it begins.
  NetworkRecipe& recipe = out.train.recipe;
  if (out.minutes && recipe.anneal && recipe.anneal_steps == 0) {
    if (given.contains("recipe.anneal_steps"))
      throw Error("a training of minutes does not know its number of steps",
                  "--recipe-anneal-steps 0", "give a number from 1 on, or --steps");
    recipe.anneal_steps = kAnnealSteps;
  }
  return out;
}

void TrainCommand::check_options() const {
  if (list_methods) return;
  // Both are written to JSON, which knows no other encoding.
  for (const fs::path* path : {&scene, &out})
    if (!is_utf8(path->string()))
      throw Error("the name is not UTF-8", path->string(), "rename the folder, or link to it");
  if (scene.empty() && !resume)
    throw Error("SCENE is missing", "", "give the folder of a capture; --help says more");
  if (scene.empty() && out.empty())
    throw Error("--resume needs to know which run", "", "give SCENE or -o RUN");
  if (minutes && train.steps > 0)
    throw Error("--minutes and --steps exclude each other", "", "leave one of them out");
  if (holdout == Holdout::kNone && split == SplitChoice::kDev)
    throw Error("--split dev and --holdout none exclude each other", "", "leave one of them out");
  train.check_options();
  check_camera_model(camera_model);
  if (resume && overwrite)
    throw Error("--resume and --overwrite exclude each other", "", "leave one of them out");
}

void check_given(const TrainCommand& command, const std::set<std::string>& given) {
  if (given.contains("steps") && command.train.steps == 0)
    throw Error("a training has at least one step", "--steps",
                "leave it out, or give --minutes instead");
}

std::vector<std::string> unused_options(const TrainCommand& command,
                                        const std::set<std::string>& given, const Scene& scene) {
  std::vector<std::string> out;
  const SceneFormat format = scene.options.format;
  if (given.contains("camera_model") && format != SceneFormat::kPhotos &&
      format != SceneFormat::kVideo)
    out.push_back("--camera-model is not used: the capture comes with its cameras");
  if (given.contains("cut_out") && scene.alpha && !scene.cut_out)
    out.push_back("--cut-out is not used: the photos have alpha");
  if (given.contains("background") && scene.cut_out)
    out.push_back("--background is not used: it is the colour that photos were cut out to");
  if (given.contains("background") && !scene.alpha)
    out.push_back("--background is not used: the photos have no alpha");
  const bool grid = command.train.method == kGridMethod;
  if (grid && given.contains("keep_transparent") && !scene.alpha)
    out.push_back("--keep-transparent is not used: the photos have no alpha");
  const auto has_depth = [](const View& view) { return !view.depth_path.empty(); };
  if (grid && given.contains("depth_loss") && std::ranges::none_of(scene.views, has_depth))
    out.push_back("--depth-loss is not used: the capture has no depth maps");
  if (grid && given.contains("keep_free") && !scene.unbounded)
    out.push_back("--keep-free is not used: the scene ends with its box");
  if (!grid && command.train.network.sampling.resampling != Resampling::kProposal &&
      (given.contains("recipe.anneal") || given.contains("recipe.anneal_steps")))
    out.push_back(
        "--recipe-anneal and --recipe-anneal-steps are not used: only proposals are annealed");
  if (grid && given.contains("scale"))
    out.push_back("--scale is not used: the grid method has one preset");
  for (const std::string& name : given)
    if (!is_read(name, grid))
      out.push_back(flag_of(name) + " is not used by --method " + command.train.method);
  const bool per_ray = command.train.grid.colour_per_ray;
  if (grid && per_ray && given.contains("shared_colour"))
    out.push_back("--shared-colour is not used: with --grid-colour-per-ray a ray has one colour");
  if (grid && (per_ray || command.train.shared_colour == 0) && given.contains("stop_transmittance"))
    out.push_back("--stop-transmittance is not used: no samples share a colour");
  if (!grid && command.train.network.space == Space::kNdc &&
      (given.contains("recipe.near") || given.contains("recipe.far")))
    out.push_back(
        "--recipe-near and --recipe-far are not used: normalised device coordinates go from the "
        "near plane to infinity");
  if (given.contains("far") &&
      (grid ? !scene.unbounded : command.train.network.space == Space::kNdc))
    out.push_back(grid ? "--far is not used: the scene ends with its box (--bbox)"
                       : "--far is not used: normalised device coordinates go to infinity");
  if (command.holdout == Holdout::kNone &&
      (given.contains("eval_every") || given.contains("eval_views")))
    out.push_back("--eval-every and --eval-views are not used: nothing is held out");
  return out;
}

SceneOptions TrainCommand::scene_options() const {
  SceneOptions o;
  o.format = format;
  o.split = holdout == Holdout::kNone    ? Split::kNone
            : split == SplitChoice::kDev ? Split::kDev
                                         : Split::kTest;
  o.downscale = downscale;
  o.bbox = bbox;
  o.up = up;
  o.near = near;
  o.far = far;
  o.camera_model = camera_model;
  o.cut_out = cut_out;
  o.work_folder = out / kCaptureFolder;
  o.run_folder = out;
  return o;
}

ProgramText train_program_text() {
  return {
      "nerf_train", "Trains a radiance field from photographs.",
      "A capture is a folder with Blender's transforms_train.json, with LLFF's\n"
      "poses_bounds.npy, with COLMAP's images and sparse, with a transforms.json, a folder of\n"
      "photos (camera poses are found by colmap), or a video. Masks lie in masks/ under the\n"
      "photo's name, or the name + .png: values of 128 and more keep a pixel, the others count\n"
      "neither in training nor in metrics. Pixels are taken as stored; EXIF orientation is\n"
      "applied where the cameras have the size of the turned picture.\n\n"
      "RUN gets options.json, metrics.jsonl (a line per reported step and per evaluation),\n"
      "result.json, model.nerf (for nerf_render), checkpoint.nerf (for --resume) and eval/ with\n"
      "photo, rendering and depth side by side. The clock is that of training steps.\n"
      "Ctrl-C saves and leaves with 130; mistakes leave with 2.\n\n"
      "  nerf_train photos/garden -o runs/garden --minutes 15\n"
      "  nerf_train -o runs/garden --resume"};
}

void resume_options(TrainCommand& command, const std::set<std::string>& given, TrainCommand saved,
                    const std::string& where) {
  if (command.scene.empty()) command.scene = saved.scene;
  if (given.contains("minutes") || given.contains("steps")) {
    saved.minutes = command.minutes;
    saved.train.steps = command.train.steps;
  }
  const auto fields = option_fields(command), were = option_fields(saved);
  for (size_t i = 0; i < fields.size(); ++i) {
    if (is_free(fields[i])) {
      if (!is_of_this_part(fields[i]) && !given.contains(fields[i].name))
        fields[i].set(were[i].get());
      continue;
    }
    const std::string is = option_text(fields[i]), was = option_text(were[i]);
    if (given.contains(fields[i].name) && is != was)
      throw Error("the run was begun with " + option_flag(fields[i]) + " " + was + ", not " + is,
                  where, "leave it out with --resume, or begin another run with -o");
    fields[i].set(were[i].get());
  }
  // Of another length; how that of the checkpoint changed, it knows itself.
  if (given.contains("minutes") || given.contains("steps")) command.train.plan_changes = {};
}

std::string equivalent_command(const TrainCommand& command, const TrainingPlan& plan) {
  TrainCommand copy = command, usual;
  copy.train.plan_changes = plan.changes;
  usual.train = method_options(command.train.method, command.scale);
  usual.train.method = TrainOptions().method;
  std::string line = "nerf_train " + shell_quoted(copy.scene.string());
  const auto fields = option_fields(copy), defaults = option_fields(usual);
  for (size_t i = 0; i < fields.size(); ++i) {
    const OptionField& field = fields[i];
    const std::string value = option_text(field);
    if (is_free(field) || field.name == "minutes" || field.name == "steps" ||
        value == option_text(defaults[i]))
      continue;
    if (field.type == OptionType::kBool)
      line += (value == "true" ? " --" : " --no-") + option_flag(field).substr(2);
    else
      line += " " + option_flag(field) + " " + shell_quoted(value);
  }
  // The run's own folder holds a run by then.
  if (!copy.out.empty()) line += " -o " + shell_quoted(copy.out.string() + "_again");
  return line + " --steps " + std::to_string(plan.steps);
}

fs::path default_run_folder(const fs::path& scene) {
  std::error_code ignored;
  const fs::path whole = fs::weakly_canonical(scene, ignored);
  const fs::path path = whole.empty() ? scene.lexically_normal() : whole;
  const fs::path name = fs::is_directory(path, ignored) ? path.filename() : path.stem();
  return fs::path("runs") / (name.empty() || name == "/" ? fs::path("scene") : name);
}

}  // namespace nerf::apps
