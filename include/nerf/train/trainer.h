// Training of a radiance field, step by step.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "nerf/base/cancel.h"
#include "nerf/base/error.h"
#include "nerf/base/threads.h"
#include "nerf/io/image.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/kernels/bf16.h"
#include "nerf/math/ray.h"
#include "nerf/model/grid_field.h"
#include "nerf/model/network_options.h"
#include "nerf/model/radiance_field.h"
#include "nerf/train/grid_recipe.h"
#include "nerf/train/network_recipe.h"
#include "nerf/train/pixel_recipe.h"
#include "nerf/train/plan.h"

namespace nerf {

inline constexpr const char* kGridMethod = "grid";

namespace internal {
std::vector<std::string> method_choices();  // of the table in methods.cc
}

// What photos with alpha are laid over. The grid method trains over random colours whatever is
// chosen: no matter can imitate them.
enum class Background { kWhite, kBlack };
inline auto option_names(Background) {
  return std::array{OptionName{Background::kWhite, "white"},
                    OptionName{Background::kBlack, "black"}};
}
inline Vec3 colour_of(Background b) {
  return b == Background::kWhite ? Vec3{1, 1, 1} : Vec3{0, 0, 0};
}

struct TrainOptions {
  std::string method = kGridMethod;  // see methods.h
  uint64_t seed = 1;
  int64_t steps = 0;  // planned length: the rate falls over it
  PlanChanges plan_changes;
  Background background = Background::kWhite;
  double rate = 2e-2;                      // of the tables, or of all networks
  Precision precision = Precision::kAuto;  // of the networks' products; a trainer resolves it
  double final_rate = 0.02;                // of the last step, as a share of `rate`
  int warmup_steps = 64;                   // over which the rate rises
  double hold = 0.1;  // share of the steps before the rate begins to fall: linearly with the grid
                      // method, exponentially with the others
  PixelRecipe pixel_recipe;
  // Field and recipe of the grid method, and of the papers'. A method reads one pair of them
  // (reads_option() of methods.h).
  GridRecipe grid_recipe;
  GridOptions grid;
  NetworkOptions network;
  NetworkRecipe recipe;

  template <class V>
  void visit_options(V& v) {
    v.heading("Method");
    v("method", method, "what is trained; see --list-methods", one_of(internal::method_choices()),
      brief("grid, nerf, mipnerf, nerfw, nerfies and more; see --list-methods"));
    v("seed", seed, "of every random number");
    v.heading("Run");
    v("steps", steps, "length of the training; the step size falls over it", at_least(0),
      brief("length of the training, in steps"));
    v("plan_changes", plan_changes,
      "until step STEP the length was LENGTH: what a run prints whose length was corrected on the "
      "way or extended, to repeat it");
    v.heading("Training");
    v("background", background,
      "colour that photos with alpha are laid over, where they are compared and where a paper's "
      "method trains on them; that of cut-out backgrounds is known, other photos need none");
    v("rate", rate, "Adam's step size", above(0), at_most(1));
    v("precision", precision,
      "operands of the networks' products; bf16 is rounded, sums and weights stay f32; auto: bf16 "
      "where the processor is faster with it");
    v("final_rate", final_rate, "step size of the last step, as a share of the first", above(0),
      at_most(1));
    v("warmup_steps", warmup_steps,
      "steps over which the step size rises, with a paper method from --recipe-warmup-rate of it",
      at_least(0));
    v("hold", hold,
      "share of the steps before the step size begins to fall; a budget of minutes fixes the "
      "number of steps within it",
      at_least(0), at_most(0.9));
    pixel_recipe.visit_options(v);
    v.heading("Training of the grid method");
    grid_recipe.visit_options(v);
    v("grid", grid, "Field of the grid method");
    v("network", network, "Field of the papers' methods");
    v("recipe", recipe, "Training of the papers' methods");
  }
  void check_options() const;
  TrainingPlan plan() const;
};
extern template CollectedOptions collect_options(TrainOptions&);

// What the scene's photos are laid over if they have alpha: the colour that their background was
// cut out to, else that of the options.
Vec3 background_of(const TrainOptions& options, const Scene& scene);

// Weight of the grid method's distortion loss (parts/losses.h), for a mean over rays: what the
// options say, or a default by the kind of scene.
double distortion_weight(const TrainOptions& options, const Scene& scene);

// Weight of the loss by depth maps and sparse points (parts/losses.h) at the first step, for a mean
// over rays; 0 where no training photo has either, or a ray's distance is not along itself
// (normalised device coordinates).
double depth_loss_weight(const TrainOptions& options, const Scene& scene, const PhotoSet& photos);

// Of the pixels, the share drawn where a sparse point is seen, whose distance the same loss takes;
// 0 where the capture has no points.
double point_depth_share(const TrainOptions& options, const Scene& scene);

// Whether the grid method learns a sky: photos without alpha show something behind all matter, and
// no medium without an end stands before it.
bool learns_sky(const TrainOptions& options, const Scene& scene);

// Whether the photos' masks leave so much out that what they keep is an object cut out, and not a
// scene in whose way something stands.
bool masks_cut_out(const PhotoSet& photos);

// Of the pixels that masks leave out, the share that is drawn as transparent ones, over colours
// that are never the same twice: in the first steps, and in the last.
struct MaskedShare {
  double first = 0, last = 0;
  double at(double progress) const;  // of TrainingPlan
};
MaskedShare masked_share(const TrainOptions& options, const PhotoSet& photos);

struct StepReport {
  int64_t step = 0;  // steps done
  double loss = 0;   // mean over rays and channels; 0 for rays that meet no matter
  double psnr = 0;   // of all photos' pixels, estimated from the step's rays; dB
  int64_t rays = 0;  // of this step
  // Network samples of this step, forward; with the paper methods backward too.
  int64_t samples = 0;
  int64_t colours = 0;   // evaluations of the colour network (grid)
  int64_t learning = 0;  // samples that went back to the tables (grid)
  int64_t rows = 0;      // of the tables, that Adam moved (grid)
  double opacity = 0;    // mean over the step's rays
  double rate = 0;
};

// A step met a loss or a gradient that is infinite or not a number, which what() names. The weights
// are those of the step before, but the trainer must go back (restart or load_checkpoint) before
// another step.
class NonFiniteError : public Error {
 public:
  using Error::Error;
};

// The pixels of an open step's rays, for a loss of the caller's.
struct RayPixels {
  std::vector<Ray> rays;  // engine coordinates (Scene::to_engine)
  // Pictures that the method learns from: one with the grid, with a paper method one of each level
  // that has colours, the last being the one that is shown.
  int renderings = 1;
  std::vector<Real> rgba;  // [renderings][rays][4]: colour over Ray::background, opacity
  // Of rays drawn from photos only: what those show over the same background, and what a squared
  // error, summed over channels, is multiplied by in the method's own loss.
  std::vector<Real> target;  // [rays][3]
  std::vector<Real> scale;   // [rays]
};

// Where the time of the steps so far went, seconds of wall clock; of the grid method `scatter` sums
// the table's gradient and updates its rows, `update` updates the networks.
struct TrainProfile {
  double rays = 0, encode = 0, network = 0, scatter = 0, update = 0, occupancy = 0;
};

struct TrainerImpl;
class Trainer;
namespace internal {
TrainerImpl& impl_of(Trainer& trainer);
}

class Trainer {
 public:
  // The scene, the photos and the pool must outlive the trainer. Throws Error for options outside
  // their limits and for photos that leave no pixel to train on.
  Trainer(const Scene& scene, const PhotoSet& photos, const TrainOptions& options,
          ThreadPool& pool);
  ~Trainer();

  // One optimisation step.
  StepReport step();

  // One step in two halves around a loss of the caller's (a style, a feature distance, score
  // distillation). The first renders rays with the field as it is, `rays` or, without any, as many
  // as step() would draw from the photos, and leaves the step open. The second takes the gradient
  // of the loss by RayPixels::rgba, as many numbers, and makes an optimisation step of it; the
  // method's losses on weights act as in step(). With the gradient of the method's own loss on
  // pixels the two are step(), bit for bit. Rays of the grid method: at most most_rays(). Nothing
  // else may be asked of the trainer in between but its options. begin_step throws Error for more
  // rays than that; finish_step what step() throws. A report's psnr is of rays from photos alone.
  const RayPixels& begin_step(std::span<const Ray> rays = {});
  StepReport finish_step(std::span<const Real> gradient, double loss = 0);
  int64_t most_rays() const;

  // Steps until options().steps or until asked to stop; the callback may return false to stop too.
  void run(const std::function<bool(const StepReport&)>& callback, const Cancel* cancel = nullptr);

  int64_t steps_done() const;
  const TrainOptions& options() const;
  const TrainProfile& profile() const;
  // Mean alpha of the training photos, from a sample of their pixels.
  double photo_opacity() const;
  // Of every training photo what was left out (LightRecipe::robust) of what moved, 0 in a picture
  // of its size, 255 elsewhere; empty without it.
  struct LeftOut {
    std::string name;  // as View::name
    Image8 picture;    // one channel
  };
  std::vector<LeftOut> left_out() const;
  // How the photos' lines are read (CameraRecipe::rolling_shutter), a line for people, and in which
  // share of a frame's time, for each camera; empty without it.
  std::string rolling_shutter() const;
  std::vector<double> readouts() const;
  // A copy to render from or save.
  RadianceField snapshot() const;

  // Changes the planned length (a time budget fixes it after a warm-up, and corrects it). The steps
  // before options().hold of it do not depend on it; later, progress goes on from where it is, and
  // options().plan_changes has what was planned until then. Where all planned steps are done the
  // training is extended: its rate rises to what it would have been by now, had its length been
  // this since the change before.
  void set_planned_steps(int64_t steps);

  // Everything needed to continue bit for bit, with a text of the caller's that load_checkpoint
  // returns. Loading throws Error for a damaged file, another version, another scene (names, sizes,
  // cameras, split) and options that differ in anything but `steps` and `plan_changes`, which
  // become the file's; after an Error the trainer must be restarted. `run_state` is UTF-8.
  void save_checkpoint(const std::filesystem::path& path, const std::string& run_state = "") const;
  std::string load_checkpoint(const std::filesystem::path& path);

  // Begins anew at step 0: first weights are drawn with this salt, as is every random number;
  // optimiser, occupancy and what was learnt of errors are as at the start. The planned length
  // stays.
  void restart(uint64_t salt, double rate_factor);
  // Another salt and rate from the next step on, everything else as it is.
  void vary(uint64_t salt, double rate_factor);

 private:
  friend TrainerImpl& internal::impl_of(Trainer&);
  std::unique_ptr<TrainerImpl> impl_;
};

}  // namespace nerf
