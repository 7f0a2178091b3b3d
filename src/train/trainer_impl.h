// What a Trainer consists of.
#pragma once

#include <memory>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/kernels/adam.h"
#include "nerf/train/trainer.h"
#include "train/ray_batch.h"

namespace nerf {

// Of the occupancy grid of an unbounded scene.
inline constexpr int kMostCascades = 8;

// Chunks go to a fixed number of gradient accumulators whose sum is taken in order, so that it does
// not depend on the number of threads.
inline constexpr int kAccumulators = 32;

// Gradients and moments of a field's parameters.
struct OptimiserState {
  explicit OptimiserState(const GridField& field);
  AlignedArray<float> table_gradient, table_m, table_v;
  AlignedArray<uint8_t> touched;     // one per row
  AlignedArray<uint16_t> row_steps;  // one per row
  AlignedArray<float> network_gradient, network_m, network_v;
};

struct Trainer::Impl {
  Impl(const Scene& scene, const PhotoSet& photos, const TrainOptions& options, ThreadPool& pool);

  StepReport step();
  double late_saving_seconds();
  // 0 during the hold, then linearly to 1 at the end of the plan.
  double progress_at(int64_t step) const;
  float rate_at(int64_t step) const;
  float samples_per_cell_at(int64_t step) const;
  void run_chunks();
  void scatter();
  void observe_samples();
  void observe_errors();
  // Mean squared error over the photos' pixels, from the step's rays.
  double mean_squared_error() const;
  void update(float rate);
  // Throw NonFiniteError that names the step and what is not finite (health.cc).
  void check_loss(double loss) const;
  void check_gradient() const;  // of the networks, reduced
  void refresh_occupancy();
  void initialise();

  const Scene& scene;
  const PhotoSet& photos;
  TrainOptions options;
  ThreadPool& pool;

  GridField field;
  OptimiserState optimiser;
  GridTape tape;
  std::vector<std::unique_ptr<Chunk>> workers;  // one per thread
  std::vector<float> corrections;

  PixelSource source;
  ErrorMap errors;
  RayBatchMaker maker;
  RayBatch batch;
  AlignedArray<float> features, d_features;  // [chunk][4 L][kChunkSamples]
  AlignedArray<float> densities;             // [chunk][kChunkSamples]
  std::vector<AlignedArray<float>> accumulators;
  std::vector<float> ray_errors;  // squared, summed over channels; [chunk][kChunkRays]
  std::vector<double> chunk_loss, chunk_opacity;

  // State of the run besides the arrays above.
  int64_t done = 0;
  uint64_t salt = 0;
  double rate_factor = 1;
  double samples_per_ray = 16;  // of the last steps; sets the number of rays of the next
  TrainProfile profile;
};

}  // namespace nerf
