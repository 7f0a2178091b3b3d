// Command line of nerf_train.
#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "nerf/base/options.h"
#include "nerf/io/scene.h"
#include "nerf/math/option_types.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/methods.h"
#include "nerf/train/run.h"
#include "nerf/train/trainer.h"
#include "options_cli.h"

namespace nerf {

inline auto option_names(SceneFormat) {
  return std::array{OptionName{SceneFormat::kAuto, "auto"},
                    OptionName{SceneFormat::kBlender, "blender"},
                    OptionName{SceneFormat::kNerfies, "nerfies"},
                    OptionName{SceneFormat::kColmap, "colmap"},
                    OptionName{SceneFormat::kTransforms, "transforms"},
                    OptionName{SceneFormat::kLlff, "llff"},
                    OptionName{SceneFormat::kNonrigid, "nonrigid"},
                    OptionName{SceneFormat::kPhotos, "photos"},
                    OptionName{SceneFormat::kVideo, "video"}};
}

namespace apps {

enum class Holdout { kSplit, kNone };
inline auto option_names(Holdout) {
  return std::array{OptionName{Holdout::kSplit, "split"}, OptionName{Holdout::kNone, "none"}};
}
enum class SplitChoice { kTest, kDev };
inline auto option_names(SplitChoice) {
  return std::array{OptionName{SplitChoice::kTest, "test"}, OptionName{SplitChoice::kDev, "dev"}};
}

struct TrainCommand {
  std::filesystem::path scene;
  std::filesystem::path out;
  bool list_methods = false;
  Scale scale = Scale::kSmall;
  std::optional<double> minutes;
  RunLength extend;  // no option: what a resumed run is given of --minutes and --steps
  SceneFormat format = SceneFormat::kAuto;
  SplitChoice split = SplitChoice::kTest;
  Holdout holdout = Holdout::kSplit;
  int downscale = 0;
  int scales = 1;
  std::optional<Box3> bbox;
  std::optional<Vec3d> up;
  std::optional<double> near, far;
  std::string times;
  std::string camera_model = "auto";
  AdjustCameras adjust_cameras = AdjustCameras::kAuto;
  CutOut cut_out;
  int threads = 0;
  bool resume = false;
  bool overwrite = false;
  double eval_every = 2;
  int eval_views = 4;
  FitLight fit_light = FitLight::kAuto;
  double checkpoint_every = 2;
  int report_every = 50;
  bool align_cameras = false;
  TrainOptions train;

  template <class V>
  void visit_options(V& v) {
    v.heading("Capture");
    v("scene", scene, "capture: its folder, a transforms .json, or a video", positional(),
      of_this_call(), metavar("SCENE"), brief("capture: a folder, a transforms .json, or a video"));
    v("format", format, "kind of the capture");
    v("split", split,
      "test: photos 0, 8, 16, ... (or the test file) are held out; dev: those are left out "
      "altogether and every 8th of the others is held out, for tuning");
    v("holdout", holdout, "none trains on every photo and measures nothing",
      brief("none trains on every photo and measures nothing"));
    v("downscale", downscale,
      "divides the photos' size; 0: by what leaves their longest side 2048 pixels or less (a "
      "panorama's 8192)",
      at_least(0), at_most(64), brief("divides the photos' size; 0: to 2048 pixels or less"));
    v("scales", scales,
      "sizes of every photo that are measured, each half of the one before, and trained on where "
      "the method sees how wide a pixel is; a pixel weighs its area",
      at_least(1), at_most(6));
    v("bbox", bbox, "box to reconstruct, input coordinates",
      brief("box to reconstruct, in the capture's coordinates"));
    v("up", up, "direction that points up, input coordinates", brief("direction that points up"));
    v("near", near, "distance from every camera at which content may begin, input unit", above(0),
      brief("distance from the cameras at which content begins"));
    v("far", far, "distance from the cameras at which content ends, input unit", above(0));
    v("times", times,
      "when the photos were taken, in place of what the capture's files say: frame, in the order "
      "of their names in each folder (a video's by its own clock); name, by the last number in "
      "their names; none, at one moment; or a file {\"photo\": time}, in any unit",
      metavar("frame|name|none|FILE.json"));
    v("camera_model", camera_model, "lens model for photos without poses, COLMAP's name or auto");
    v("adjust_cameras", adjust_cameras,
      "before the training: lenses, poses and points of a COLMAP model are adjusted to its "
      "keypoints; auto: where these are more than 2 pixels off in the median (a thousandth of "
      "large photos' longest side), or one lens explains photos that have one each; cameras of a "
      "model that takes two sides of a thing for one are found anew; on: also where they fit, and "
      "cameras of captures without keypoints are found anew, which takes colmap and "
      "minutes");
    v("cut_out", cut_out,
      "what to do about photos without alpha whose background was cut out to one colour: auto "
      "finds it at their border, off leaves it as matter, R,G,B says which; it counts as "
      "transparent");
    v.heading("Run");
    v("out", out,
      "folder for everything that the run writes; without it runs/ and the scene's name",
      short_name('o'), of_this_call(), metavar("RUN"), brief("folder for what the run writes"));
    v("minutes", minutes,
      "length of the training, minutes of its steps; without it and without --steps 5, of a "
      "paper's method 4 (tiny) or 50 (small)",
      above(0), at_most(100000), brief("length of the training; without it 5"));
    v("resume", resume,
      "goes on with the run in RUN, bit for bit; with --minutes or --steps, of the whole run, "
      "until it is so long",
      of_this_call(), brief("goes on with the run in RUN, or extends it"));
    v("overwrite", overwrite, "begins anew although RUN holds a run", of_this_call(),
      brief("begins anew although RUN holds a run"));
    v("threads", threads, "threads; 0 takes all processors; the result is the same for any number",
      at_least(0), at_most(1024), of_this_call(), brief("0 takes all processors"));
    v("eval_every", eval_every,
      "minutes of training between evaluations on held-out views, more where one takes longer than "
      "a tenth of them; 0: only at the end",
      at_least(0), not_of_result());
    v("eval_views", eval_views,
      "held-out views of an evaluation before the last one, which takes all; 0: all", at_least(0),
      not_of_result());
    v("fit_light", fit_light,
      "whether a held-out photo's light is found from its left half and the right half compared; "
      "auto: where the photos' light was learnt",
      not_of_result());
    v("checkpoint_every", checkpoint_every,
      "minutes of training between checkpoints; 0: only at the end", at_least(0), not_of_result());
    v("report_every", report_every, "steps between lines of metrics.jsonl", at_least(1),
      not_of_result());
    v("align_cameras", align_cameras,
      "held-out photos are also scored from where a fit by themselves puts their cameras; always "
      "so "
      "where cameras are refined",
      not_of_result());
    v.heading("Method");
    v("list_methods", list_methods, "prints the table of methods and leaves");
    v("scale", scale,
      "preset of a paper's method: paper, the publication's setting; small, under an hour on two "
      "processors; tiny, a few minutes",
      brief("of a paper's method: tiny, small or paper"));
    train.visit_options(v);
  }
  // Throws Error for combinations that cannot be.
  void check_options() const;

  SceneOptions scene_options() const;
};

ProgramText train_program_text();

// The command with the preset of its method and scale in place of what `given` does not name; where
// neither minutes nor steps are said, with default_minutes(), unless it resumes a run, whose saved
// options say.
TrainCommand with_preset(const TrainCommand& command, const std::set<std::string>& given);

// Throws Error for a value that only the default may have. `given` names what the command line set.
void check_given(const TrainCommand& command, const std::set<std::string>& given);

// Warnings of what was given and has no effect on that capture.
std::vector<std::string> unused_options(const TrainCommand& command,
                                        const std::set<std::string>& given, const Scene& scene);

// Takes from `saved`, the options that the run was begun with, what the command line does not give.
// Throws Error naming an option that was given otherwise than then; options that change nothing of
// the result (threads, intervals) may differ, and so may the length. `where` is the run's folder.
void resume_options(TrainCommand& command, const std::set<std::string>& given, TrainCommand saved,
                    const std::string& where);

// The command that repeats a run of that plan exactly: --steps for --minutes, and every option of
// the result that is not as usual.
std::string equivalent_command(const TrainCommand& command, const TrainingPlan& plan);

// runs/<name of the scene>.
std::filesystem::path default_run_folder(const std::filesystem::path& scene);

}  // namespace apps
extern template CollectedOptions collect_options(apps::TrainCommand&);

}  // namespace nerf
