// Training of the paper methods.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "model/matter_memory.h"
#include "nerf/base/aligned.h"
#include "nerf/model/network_field.h"
#include "nerf/model/network_levels.h"
#include "train/capture_moments.h"
#include "train/sample_range.h"
#include "train/still_points.h"
#include "train/trainer_impl.h"

namespace nerf {

// Accumulators of a field's gradient: many for small networks, so that many threads find work, few
// for large ones, whose sums would fill the memory. Depends on the model alone.
int network_accumulators(size_t weights);

// depth: some rays' depth is known.
NetworkLosses losses_of(const NetworkRecipe& recipe, bool depth);

struct NetworkTrainer final : TrainerImpl {
  NetworkTrainer(const Scene& scene, const PhotoSet& photos, const TrainOptions& options,
                 ThreadPool& pool);
  // An estimate from above, with what a checkpoint that is read and a model that is saved take.
  static uint64_t memory_bytes(const TrainOptions& options, bool unbounded, int threads);

  void check_open() const override;
  void draw() override;
  HeadSums head(StepReport& report) override;
  void render() override;
  AdamStep dense_step() const override;
  void observe(const StepReport& report, const PhaseSeconds& seconds) override;
  void refresh() override;
  void begin_anew() override;
  RadianceField snapshot(ModelInfo info) const override;
  void save_state(internal::ContainerWriter& file, nlohmann::ordered_json& scalars) const override;
  void load_state(const internal::ContainerReader& file,
                  const internal::JsonFields& scalars) override;

  using Workers = std::vector<std::unique_ptr<NetworkLevels>>;  // one per thread
  Workers make_workers(const NetworkLosses& losses) const;
  bool skipping() const;  // in the step to come
  Real exponent() const;  // of its proposals' weights
  // Ray i of the step, from a photo or given; no value where it has no pixel.
  std::optional<Ray> draw_ray(size_t i, Random& random, NetworkRay& out) const;
  void set_gradient(size_t first_ray, size_t count, NetworkLevels& levels) const;

  // Sets what changes from step to step beside the weights: windows, and the weights of losses.
  void open_windows();

  CaptureMoments moments;
  std::vector<SampleRange> ranges;  // of each view's rays; empty: the field's
  NetworkField field;
  StillPoints still;
  int rays_per_chunk;
  Workers workers, given_workers;  // of the method's loss, and of the caller's
  std::vector<NetworkRay> rays;
  std::vector<uint8_t> drawn;   // whether a ray's draw gave a pixel
  std::vector<Ray> lines;       // of an open step: the rays in engine coordinates
  std::vector<int32_t> listed;  // and which of its pixels is a ray's; below 0: none
  struct Sums {
    double loss = 0, squared_error = 0, opacity = 0;
    int64_t dense = 0, all = 0, unasked = 0;  // see NetworkLevels
  };
  std::vector<Sums> sums;  // of each accumulator

  std::unique_ptr<internal::MatterMemory> memory;  // where empty space is left out
  double dense_share = 1;  // of the last step's samples: decides what the next one skips
};

}  // namespace nerf
