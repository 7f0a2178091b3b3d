// One step in phases, the same for every method. What every trainer has: a scene, options, the
// clock of its steps, dense parameters. One class per kind of field derives from it.
#pragma once

#include <cmath>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <span>

#include "base/container.h"
#include "model/json_fields.h"
#include "nerf/train/trainer.h"
#include "train/parameters.h"
#include "train/rate_schedule.h"
#include "train/ray_batch.h"

namespace nerf {

class CameraRefinement;
class RollingShutter;

struct TrainerImpl {
  TrainerImpl(const Scene& scene, const PhotoSet& photos, const TrainOptions& options,
              ThreadPool& pool, const RateSchedule& schedule)
      : scene(scene),
        photos(photos),
        options(options),
        pool(pool),
        schedule(schedule),
        source(scene, photos, point_depth_share(options, scene)),
        depth_weight(depth_loss_weight(options, scene, photos)),
        masked(masked_share(options, photos)) {}
  virtual ~TrainerImpl() = default;

  StepReport step();
  const RayPixels& begin_step(std::span<const Ray> rays);
  StepReport finish_step(std::span<const Real> gradient, double loss);

  // Throws Error where the method's steps cannot be opened.
  virtual void check_open() const {}

  // The phases of a step, in their order. A method leaves out what it does not need.
  //
  // Draws rays and, where samples do not depend on the networks, places them.
  virtual void draw() = 0;
  // Looks the samples up in a table.
  virtual void look_up() {}
  // Chunk by chunk: networks, loss, and back. Gradients of dense parameters go to accumulators,
  // those of features to the rows of the table. Fills in the report's sums: loss, samples, rays,
  // colours, learning; psnr and opacity are left to head_sums.
  struct HeadSums {
    double squared_error = 0;  // mean over pixels and channels, of all photos' pixels
    double opacity = 0;        // summed over the report's rays
  };
  virtual HeadSums head(StepReport& report) = 0;
  // From the gradient of features to that of the samples' positions, and of what these depend on:
  // warps, cameras. Behind the head, before anything is updated.
  virtual void trace_positions() {}
  // Of an open step: the networks of all rays without going back. Fills in `pixels`.
  virtual void render() = 0;
  virtual int64_t most_rays() const { return 1 << 20; }
  // Of the dense parameters, for the step to come.
  virtual AdamStep dense_step() const = 0;
  // Gradient of the table's rows, and their step of Adam. Fills in the report's rows.
  virtual void scatter(StepReport& /*report*/) {}
  // Takes in what the step has seen, `seconds` being what its head and its scatter took.
  struct PhaseSeconds {
    double head = 0, scatter = 0;
  };
  virtual void observe(const StepReport& /*report*/, const PhaseSeconds& /*seconds*/) {}
  // Behind the step, which is counted by now.
  virtual void refresh() {}

  // What the planner of a budget asks (run_speed.h).
  // Seconds that a step takes less (below 0: more) at the end of the plan, when a ray gets all its
  // samples, than now: drawing rays and lookups are measured for both; for colours and the table's
  // update what they take now is scaled by the rays and the lookups. 0 for the paper methods and
  // where steps are late ones already. Training does not change.
  virtual double late_saving_seconds() { return 0; }
  // Mean share of that saving over the steps from now to the end of a plan of `steps`: rays get
  // their samples little by little.
  virtual double late_saving_share(int64_t /*steps*/) const { return 0; }
  // The first weights (of the salt in force) and an optimiser without memory.
  virtual void begin_anew() = 0;
  virtual RadianceField snapshot(ModelInfo info) const = 0;
  virtual const CameraRefinement* refined_cameras() const { return nullptr; }
  virtual const RollingShutter* rolling_shutter() const { return nullptr; }
  virtual const RobustMask* robust_mask() const { return nullptr; }
  // Everything that a step reads and the step before wrote, besides the members of this class.
  virtual void save_state(internal::ContainerWriter& file,
                          nlohmann::ordered_json& scalars) const = 0;
  virtual void load_state(const internal::ContainerReader& file,
                          const internal::JsonFields& scalars) = 0;

  double progress_at(int64_t step) const { return options.plan().progress_at(step); }
  Real rate_at(int64_t step) const {
    return schedule.at(options, step, progress_at(step), rate_factor);
  }
  // Of the step to come. Sensors err more than a trained field does, so that the weight falls.
  double depth_weight_now() const {
    constexpr double kLast = 0.1;  // as a share of the first
    return depth_weight * std::lerp(1.0, kLast, progress_at(done));
  }
  uint64_t seed() const { return options.seed ^ salt; }

  const Scene& scene;
  const PhotoSet& photos;
  TrainOptions options;
  ThreadPool& pool;
  RateSchedule schedule;
  PixelSource source;
  double depth_weight;  // of the first step; 0 where no ray's depth is known
  MaskedShare masked;
  std::unique_ptr<DenseParameters> dense;  // made by the method, whose field has the weights

  // Of a step that begin_step() has opened: its rays, where they were given, and their pixels; then
  // the gradient by these.
  bool open = false;
  std::span<const Ray> given;
  RayPixels pixels;
  std::span<const Real> pixel_gradient;

  int64_t done = 0;
  uint64_t salt = 0;
  double rate_factor = 1;
  TrainProfile profile;

 private:
  StepReport complete();  // from the head on
};

}  // namespace nerf
