// Training of the grid method.
#pragma once

#include <memory>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/kernels/adam.h"
#include "nerf/model/grid_field.h"
#include "train/error_map.h"
#include "train/ray_batch.h"
#include "train/trainer_impl.h"

namespace nerf {

// Of the occupancy grid of an unbounded scene.
inline constexpr int kMostCascades = 8;

// Chunks go to a fixed number of gradient accumulators whose sum is taken in order, so that it does
// not depend on the number of threads.
inline constexpr int kAccumulators = 32;

// Gradients and moments of a field's parameters.
struct OptimiserState {
  explicit OptimiserState(const GridField& field);
  // Where the field's table holds half floats, of the weights that they are rounded from: begins
  // with what the table holds, or rounds them into it.
  void take_weights(const GridField& field);
  void give_weights(GridField& field) const;
  uint64_t rows;                      // of the table
  int features;                       // of a row
  AlignedArray<Real> table_gradient;  // [rows][features], zero between steps
  AlignedArray<uint8_t> marks;        // of rows, zero between steps
  AlignedArray<Real> row_states;      // [rows][kRowParts][features]
  AlignedArray<uint32_t> listed;      // rows of all levels that have a gradient
  std::vector<int64_t> listed_count;  // of each level
  AlignedArray<Real> network_gradient, network_m, network_v;
};

struct GridTrainer final : TrainerImpl {
  GridTrainer(const Scene& scene, const PhotoSet& photos, const TrainOptions& options,
              ThreadPool& pool);

  StepReport step() override;
  double late_saving_seconds() override;
  double late_saving_share(int64_t steps) const override;
  void begin_anew() override;
  RadianceField snapshot(ModelInfo info) const override;
  const GridField* grid() const override { return &field; }
  void save_state(internal::ContainerWriter& file, nlohmann::ordered_json& scalars) const override;
  void load_state(const internal::ContainerReader& file,
                  const internal::JsonFields& scalars) override;

  Real rate_at(int64_t step) const;
  // Moments are corrected as if its betas had always been what they are by then: rows that were
  // touched a few times take somewhat smaller steps.
  AdamStep adam_at(int64_t step) const;
  Real samples_per_cell_at(int64_t step) const;
  Real samples_per_cell_at(int64_t step, const TrainingPlan& plan) const;
  // Of a step's chunks, the time for colours that samples share; 0 where they do not.
  double colour_seconds() const;
  GridPoints points_of(int64_t chunk) const;
  void pack();  // after every change of the networks' weights
  void encode_batch();
  void run_chunks();
  void add_distortion(Chunk& chunk, int64_t first_sample);
  // Of the samples that the backward pass went on with: what their lookups need to learn.
  void keep_samples(int64_t c, Chunk& chunk);
  void observe_samples();
  void observe_errors();
  // Mean squared error over the photos' pixels, from the step's rays.
  double mean_squared_error() const;
  void update_networks();
  void check_gradient() const;  // of the networks, reduced
  // The table's gradient and its optimiser; what the step has seen of occupancy and errors besides.
  void update_table();
  void refresh_occupancy();
  void initialise();

  double distortion;  // weight of the loss
  GridField field;
  LayerPacks packs;  // of its networks
  OptimiserState optimiser;
  GridTape tape;
  std::vector<std::unique_ptr<Chunk>> workers;  // one per thread
  std::vector<Real> corrections;

  ErrorMap errors;
  RayBatchMaker maker;
  RayBatch batch;
  AlignedArray<Real> features, d_features;  // [chunk][4 L][kChunkSamples]
  AlignedArray<Real> densities;             // [chunk][kChunkSamples]
  std::vector<AlignedArray<Real>> accumulators;
  std::vector<int64_t> chunk_colours;  // evaluations of the colour network
  std::vector<int64_t> chunk_kept;     // samples that learn, see keep_samples()
  std::vector<Real> ray_errors;        // squared, summed over channels; [chunk][kChunkRays]
  std::vector<double> chunk_loss, chunk_opacity;

  double samples_per_ray = 16;  // of the last steps; sets the number of rays of the next
  // Of the last steps: what the networks took, what the table's gradient and its optimiser took,
  // and of how many samples a colour was asked for.
  double chunk_seconds = 0, table_seconds = 0, colours_per_sample = 0;
};

}  // namespace nerf
