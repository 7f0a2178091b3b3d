// Training of the grid method.
#pragma once

#include <memory>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/kernels/adam.h"
#include "nerf/model/grid_field.h"
#include "train/camera_refinement.h"
#include "train/ray_batch.h"
#include "train/trainer_impl.h"

namespace nerf {

// Of the occupancy grid of an unbounded scene.
inline constexpr int kMostCascades = 8;

// Chunks go to a fixed number of gradient accumulators whose sum is taken in order, so that it does
// not depend on the number of threads.
inline constexpr int kAccumulators = 32;

// Gradient and moments of a field's table.
struct TableState {
  explicit TableState(const GridField& field);
  static uint64_t memory_bytes(const HashGridShape& shape);
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
};

// Density, colours and loss of the samples in a chunk, one chunk per thread.
struct GridHead {
  GridHead(const GridField& field, const GridLosses& losses, const DenseParameters& dense,
           ThreadPool& pool);
  GridTape tape;
  std::vector<std::unique_ptr<Chunk>> workers;
};

// Of a scene that moves: where a step's samples stand in the canonical scene, and the way there.
struct MovingSamples {
  MovingSamples(const GridField& field, const LayerPacks& packs, int max_chunks, int threads);
  AlignedArray<Real> x, y, z;      // grid coordinates, [chunk][kChunkSamples]
  std::vector<int32_t> ray_begin;  // of the samples that learn, as RayBatch::ray_begin
  AlignedArray<Real> d_points;     // gradient by position of what the head adds, [chunk][3][.]
  AlignedArray<Real> pull;  // of the loss on how far samples that learn are moved, [chunk][.]
  std::vector<std::unique_ptr<MotionChunk>> workers;  // one per thread
};

struct GridTrainer final : TrainerImpl {
  GridTrainer(const Scene& scene, const PhotoSet& photos, const TrainOptions& options,
              ThreadPool& pool);

  // An estimate from above, with what saving, resuming and beginning anew take for a while.
  static uint64_t memory_bytes(const TrainOptions& options, bool unbounded, int threads);

  void draw() override;
  void look_up() override;
  HeadSums head(StepReport& report) override;
  void trace_positions() override;
  void render() override;
  int64_t most_rays() const override;
  AdamStep dense_step() const override;
  void scatter(StepReport& report) override;
  void observe(const StepReport& report, const PhaseSeconds& seconds) override;
  void refresh() override;
  double late_saving_seconds() override;
  double late_saving_share(int64_t steps) const override;
  void begin_anew() override;
  RadianceField snapshot(ModelInfo info) const override;
  const CameraRefinement* refined_cameras() const override { return cameras.get(); }
  const RollingShutter* rolling_shutter() const override { return shutter.get(); }
  const RobustMask* robust_mask() const override { return robust.get(); }
  void save_state(internal::ContainerWriter& file, nlohmann::ordered_json& scalars) const override;
  void load_state(const internal::ContainerReader& file,
                  const internal::JsonFields& scalars) override;

  // Moments are corrected as if its betas had always been what they are by then: rows that were
  // touched a few times take somewhat smaller steps.
  AdamStep adam_at(int64_t step) const;
  Real samples_per_cell_at(int64_t step) const;
  Real samples_per_cell_at(int64_t step, const TrainingPlan& plan) const;
  // Of a step's chunks, the time for colours that samples share; 0 where they do not.
  double colour_seconds() const;
  GridPoints points_of(int64_t chunk) const;
  GridLosses losses(const PixelLoss& pixel) const;
  // The inputs of chunk c but for those of the loss.
  void bind(int64_t c, const GridTape& tape, Chunk& chunk);
  void set_loss(int64_t c, const GridTape& tape, Chunk& chunk);
  // What a squared error, summed over channels, of a ray of chunk c counts in the loss.
  Real scale_of(int64_t c, int ray) const;
  bool has_medium() const { return field.medium_numbers.out > 0; }
  bool has_losses_on_weights() const {
    return distortion > 0 || depth_weight > 0 || offset_weight > 0;
  }
  void add_losses_on_weights(int64_t c, const GridTape& tape, Chunk& chunk);
  // Draws matter away from the sky: adds a loss, and its gradient to the densities.
  void clear_matter(int64_t c, const GridTape& tape, Chunk& chunk);
  // Of the step to come. What photos show well stands by itself in the end, so that it falls.
  double clearing_now() const {
    constexpr double kLast = 0.1;  // as a share of the first
    return clearing * std::lerp(1.0, kLast, progress_at(done));
  }
  // How far the chunk's matter is moved, weighted by its light, which the loss does not change
  // (Tretschk et al. 2021, equation 5, with a distance in place of its power).
  double offset_loss(int64_t c, const GridTape& tape, const Chunk& chunk) const;
  Real offset_scale(int64_t c, int ray) const;
  // Adds that loss's gradient, by where samples that learn stand in the canonical scene.
  void pull_back(int64_t c, const MotionChunk& motion);
  // Of the samples that the backward pass went on with: what their lookups need to learn.
  void keep_samples(int64_t c, const GridTape& tape, Chunk& chunk);
  // What the report says of chunk c's pixels.
  void note_pixels(int64_t c, const GridTape& tape, const Chunk& chunk);
  // Of positions (grid_positions.cc): the samples' places in the canonical scene; the gradient by
  // these, through the lookups of what learns; and from there to the warp's weights.
  void find_canonical();
  void find_position_gradient();
  void trace_motion();
  // Of refined cameras (grid_cameras.cc): levels of the table that are looked up, the size of a
  // camera's step, whether that step is due, and the gradient of the step's rays and of chunk c.
  int64_t open_levels() const;
  double camera_rate() const;
  bool cameras_learn() const;
  void find_camera_gradient();
  void find_ray_moves(int64_t c);
  // Leaves out what does not belong to the scene, between the passes over chunk c. Takes on from
  // the chunk's random numbers.
  void leave_out(int64_t c, const GridTape& tape, Random& random, Chunk& chunk);
  void observe_samples();
  // Of the points of a block of the occupancy's refresh.
  Real moment(int64_t block) const;
  // Over the step's rays, those that met no matter included, and channels.
  double mean_squared_error() const;
  void initialise();
  // Of each photo the change of colour that its EXIF lets expect: where it begins, and what it is
  // drawn to. As the field's book stands in its weights.
  std::vector<Real> expected_colours() const;

  double distortion;     // weight of the loss
  double clearing;       // weight of matter_loss() in the first step; 0 without a sky
  double offset_weight;  // likewise; 0 where the scene stands still
  GridField field;
  TableState optimiser;
  std::unique_ptr<GridHead> own_head, given_head;    // of the method's loss, and of the caller's
  std::vector<std::unique_ptr<FieldQuery>> queries;  // of the occupancy's refresh, one per thread
  std::vector<int32_t> listed_at;  // of an open step: which listed ray is at [chunk][kChunkRays]
  std::vector<Real> corrections;

  RayBatchMaker maker;
  RayBatch batch;
  AlignedArray<Real> features, d_features;  // [chunk][4 L][kChunkSamples]
  AlignedArray<Real> densities;             // [chunk][kChunkSamples]
  std::vector<int64_t> chunk_colours;       // evaluations of the colour network
  std::vector<int64_t> chunk_kept;          // samples that learn, see keep_samples()
  std::vector<double> chunk_loss, chunk_opacity, chunk_squared_error;  // sums over rays
  std::unique_ptr<RobustMask> robust;                                  // none: every pixel teaches
  std::unique_ptr<Skylines> skylines;                                  // none: no sky is cleared
  std::vector<Real> ray_errors;  // then: absolute, mean over channels; [chunk][kChunkRays]
  std::unique_ptr<RollingShutter> shutter;    // none: a photo's lines are read at once
  std::unique_ptr<CameraRefinement> cameras;  // none: they stay
  std::unique_ptr<MovingSamples> moving;      // none: the scene stands still
  AlignedArray<Real> d_position;              // grid coordinates, [chunk][3][kChunkSamples]
  std::vector<RayMove> ray_moves;             // [chunk][kChunkRays]

  double samples_per_ray = 16;  // of the last steps; sets the number of rays of the next
  // Of the last steps: what the networks took, what the table's gradient and its optimiser took,
  // and of how many samples a colour was asked for.
  double chunk_seconds = 0, table_seconds = 0, colours_per_sample = 0;
};

}  // namespace nerf
