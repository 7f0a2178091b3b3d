// Training of the paper methods.
#pragma once

#include <memory>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/model/network_field.h"
#include "nerf/model/network_levels.h"
#include "train/trainer_impl.h"

namespace nerf {

// Accumulators of a field's gradient: many for small networks, so that many threads find work, few
// for large ones, whose sums would fill the memory. Depends on the model alone.
int network_accumulators(size_t weights);

NetworkLosses losses_of(const NetworkRecipe& recipe);

struct NetworkTrainer final : TrainerImpl {
  NetworkTrainer(const Scene& scene, const PhotoSet& photos, const TrainOptions& options,
                 ThreadPool& pool);

  void draw() override;
  HeadSums head(StepReport& report) override;
  AdamStep dense_step() const override;
  void observe(const StepReport& report, const PhaseSeconds& seconds) override;
  void begin_anew() override;
  RadianceField snapshot(ModelInfo info) const override;
  void save_state(internal::ContainerWriter& file, nlohmann::ordered_json& scalars) const override;
  void load_state(const internal::ContainerReader& file,
                  const internal::JsonFields& scalars) override;

  bool skipping() const;  // in the step to come

  NetworkField field;
  int rays_per_chunk;
  std::vector<std::unique_ptr<NetworkLevels>> workers;  // one per thread
  std::vector<NetworkRay> rays;
  std::vector<uint8_t> drawn;  // whether a ray's draw gave a pixel
  struct Sums {
    double loss = 0, squared_error = 0, opacity = 0;
    int64_t dense = 0, all = 0;  // samples with density, and all
  };
  std::vector<Sums> sums;  // of each accumulator

  double dense_share = 1;  // of the last step's samples: decides what the next one skips
};

}  // namespace nerf
