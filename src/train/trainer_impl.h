// What every trainer has: a scene, options, the clock of its steps. One class per kind of field
// derives from it.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "base/container.h"
#include "model/json_fields.h"
#include "nerf/train/trainer.h"
#include "train/ray_batch.h"

namespace nerf {

struct TrainerImpl {
  TrainerImpl(const Scene& scene, const PhotoSet& photos, const TrainOptions& options,
              ThreadPool& pool)
      : scene(scene), photos(photos), options(options), pool(pool), source(scene, photos) {}
  virtual ~TrainerImpl() = default;

  virtual StepReport step() = 0;
  // See Trainer::late_saving_seconds().
  virtual double late_saving_seconds() { return 0; }
  virtual double late_saving_share(int64_t /*steps*/) const { return 0; }
  // The first weights (of the salt in force) and an optimiser without memory.
  virtual void begin_anew() = 0;
  virtual RadianceField snapshot(ModelInfo info) const = 0;
  virtual const GridField* grid() const { return nullptr; }
  // Everything that a step reads and the step before wrote, besides the members of this class.
  virtual void save_state(internal::ContainerWriter& file,
                          nlohmann::ordered_json& scalars) const = 0;
  virtual void load_state(const internal::ContainerReader& file,
                          const internal::JsonFields& scalars) = 0;

  double progress_at(int64_t step) const { return options.plan().progress_at(step); }
  // Throws NonFiniteError that names the step (health.cc).
  void check_loss(double loss) const;

  const Scene& scene;
  const PhotoSet& photos;
  TrainOptions options;
  ThreadPool& pool;
  PixelSource source;

  int64_t done = 0;
  uint64_t salt = 0;
  double rate_factor = 1;
  TrainProfile profile;
};

}  // namespace nerf
