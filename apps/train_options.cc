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

bool is_utf8(const std::string& text) {
  try {
    nlohmann::json(text).dump();
  } catch (const nlohmann::json::type_error&) {
    return false;
  }
  return true;
}

}  // namespace

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
  check_times_option(times);
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
      format != SceneFormat::kVideo && command.adjust_cameras != AdjustCameras::kOn)
    out.push_back("--camera-model is not used: the capture comes with its cameras");
  if (given.contains("adjust_cameras") &&
      (format == SceneFormat::kPhotos || format == SceneFormat::kVideo))
    out.push_back("--adjust-cameras is not used: the cameras are found from the photos");
  if (given.contains("cut_out") && scene.alpha && !scene.cut_out)
    out.push_back("--cut-out is not used: the photos have alpha");
  if (given.contains("background") && scene.cut_out)
    out.push_back("--background is not used: it is the colour that photos were cut out to");
  if (given.contains("background") && !scene.alpha)
    out.push_back("--background is not used: the photos have no alpha");
  const std::string& method = command.train.method;
  if (given.contains("scale") && !has_scales(method))
    out.push_back("--scale is not used: the method has one preset");
  for (std::string& line : nerf::unused_options(command.train, given, scene))
    out.push_back(std::move(line));
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
  o.times = times;
  o.camera_model = camera_model;
  o.adjust_cameras = adjust_cameras;
  o.cut_out = cut_out;
  o.work_folder = out / kCaptureFolder;
  o.run_folder = out;
  return o;
}

ProgramText train_program_text() {
  return {
      "nerf_train", "Trains a radiance field from photographs.",
      "A capture is a folder with Blender's transforms_train.json, LLFF's poses_bounds.npy,\n"
      "COLMAP's images and sparse, a transforms.json, Nerfies' camera and rgb, Non-Rigid NeRF's\n"
      "precomputed.json, a folder of photos (colmap finds their poses), or a video. Masks lie in\n"
      "masks/ under the photo's name, or the name + .png: values of 128 and more keep a pixel,\n"
      "what the others show is not learnt and does not count in metrics. Pixels are taken as\n"
      "stored; EXIF orientation is applied where cameras have the size of the turned picture.\n\n"
      "RUN gets options.json, metrics.jsonl (a line per reported step and per evaluation),\n"
      "result.json, model.nerf (for nerf_render), checkpoint.nerf (for --resume), eval/ with\n"
      "photo, rendering and depth side by side, and report.html, a page that shows all of it.\n"
      "The clock is that of training steps.\n"
      "Ctrl-C saves and leaves with 130; mistakes leave with 2.",
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
    if (!fields[i].of_result) {
      if (fields[i].inherited && !given.contains(fields[i].name)) fields[i].set(were[i].get());
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
    if (!field.of_result || field.name == "minutes" || field.name == "steps" ||
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

template nerf::CollectedOptions nerf::collect_options(nerf::apps::TrainCommand&);
