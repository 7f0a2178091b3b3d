// Where a step's samples stand in the canonical scene, and what the step says of their positions:
// the gradient of features goes through the lookups to positions, and on to what these depend on.
#include <algorithm>
#include <cmath>

#include "train/grid_trainer.h"

namespace nerf {

MovingSamples::MovingSamples(const GridField& field, const LayerPacks& packs, int max_chunks,
                             int threads)
    : ray_begin(static_cast<size_t>(max_chunks) * (kChunkRays + 1)) {
  for (auto* a : {&x, &y, &z})
    *a = AlignedArray<Real>(static_cast<size_t>(max_chunks) * kChunkSamples);
  for (int i = 0; i < threads; ++i)
    workers.push_back(std::make_unique<MotionChunk>(field, &packs, /*training=*/true));
}

void GridTrainer::find_canonical() {
  pool.parallel_for_thread(batch.chunks, [&](int64_t c, int thread) {
    MotionChunk& motion = *moving->workers[static_cast<size_t>(thread)];
    const size_t i = static_cast<size_t>(c);
    const int64_t at = c * kChunkSamples;
    motion.forward(batch.x.data() + at, batch.y.data() + at, batch.z.data() + at, batch.samples[i],
                   batch.rays[i], batch.ray_begin.data() + c * (kChunkRays + 1),
                   batch.time.data() + c * kChunkRays);
    int k = 0;
    for (auto* a : {&moving->x, &moving->y, &moving->z})
      std::copy_n(motion.canonical(k++), round_up(batch.samples[i], kLane), a->data() + at);
  });
}

void GridTrainer::trace_positions() {
  const bool to_cameras = cameras_learn();
  if (!moving && !to_cameras) return;
  find_position_gradient();
  if (moving) trace_motion();
  if (!to_cameras) return;
  find_camera_gradient();
  cameras->update(camera_rate());
}

void GridTrainer::find_position_gradient() {
  constexpr int64_t kStretch = 16;  // chunks
  const int64_t ld = kChunkSamples, levels = static_cast<int64_t>(field.shape.levels.size());
  std::ranges::fill(d_position, 0.0_r);
  // Level after level, so that a sample's sum has one order.
  for (int64_t l = 0; l < open_levels(); ++l) {
    const HashGridLevel& level = field.shape.levels[static_cast<size_t>(l)];
    pool.parallel_for((batch.chunks + kStretch - 1) / kStretch, [&](int64_t stretch) {
      const int64_t end = std::min<int64_t>(batch.chunks, (stretch + 1) * kStretch);
      for (int64_t c = stretch * kStretch; c < end; ++c) {
        const GridPoints p = points_of(c);
        Real* const d = d_position.data() + c * 3 * ld;
        const auto add = [&](const auto* table) {
          hash_grid_position_backward(level, table + level.begin(), p.x, p.y, p.z,
                                      chunk_kept[static_cast<size_t>(c)],
                                      d_features.data() + (c * levels + l) * level.features * ld,
                                      ld, d, d + ld, d + 2 * ld);
        };
        if (field.options.table_bits == 16)
          add(field.half_table.data());
        else
          add(field.table.data());
      }
    });
  }
}

namespace {
// A distance's slope ends there, so that what hardly moves is not pulled hard; contracted units.
constexpr Real kStill = 1e-3_r;

Real smooth_length(const Vec3& offset) { return std::sqrt(dot(offset, offset) + kStill * kStill); }
}  // namespace

Real GridTrainer::offset_scale(int64_t c, int ray) const {
  return static_cast<Real>(3 * offset_weight) * scale_of(c, ray);
}

double GridTrainer::offset_loss(int64_t c, const GridTape& tape, const Chunk& chunk) const {
  const Real* const weights = chunk.data(tape.image.weights);
  double loss = 0;
  for (int r = 0; r < chunk.rays; ++r) {
    Real sum = 0;
    for (int32_t i = chunk.ray_begin[r]; i < chunk.ray_begin[r + 1]; ++i) {
      const size_t at = static_cast<size_t>(c * kChunkSamples + i);
      const Vec3 offset{moving->x[at] - batch.x[at], moving->y[at] - batch.y[at],
                        moving->z[at] - batch.z[at]};
      sum += weights[i] * (smooth_length(offset * (2 * field.extent())) - kStill);
    }
    loss += static_cast<double>(offset_scale(c, r) * sum);
  }
  return loss;
}

void GridTrainer::pull_back(int64_t c, const MotionChunk& motion) {
  const int64_t at = c * kChunkSamples, ld = kChunkSamples;
  const Real* const from[] = {batch.x.data() + at, batch.y.data() + at, batch.z.data() + at};
  const Real unit = 2 * field.extent();
  for (int64_t s = 0; s < chunk_kept[static_cast<size_t>(c)]; ++s) {
    Vec3 offset;
    for (int k = 0; k < 3; ++k) offset[k] = unit * (motion.canonical(k)[s] - from[k][s]);
    const Vec3 slope =
        offset * (unit * moving->pull[static_cast<size_t>(at + s)] / smooth_length(offset));
    for (int k = 0; k < 3; ++k) {
      d_position[static_cast<size_t>(3 * at + k * ld + s)] += slope[k];
      if (cameras) moving->d_points[static_cast<size_t>(3 * at + k * ld + s)] -= slope[k];
    }
  }
}

// The warp is asked once more of the samples that learn: that is cheaper than to keep what it
// computed of all.
void GridTrainer::trace_motion() {
  const int64_t ld = kChunkSamples;
  const int64_t per = (batch.chunks + kAccumulators - 1) / kAccumulators;
  pool.parallel_for_thread(kAccumulators, [&](int64_t a, int thread) {
    MotionChunk& motion = *moving->workers[static_cast<size_t>(thread)];
    const int64_t end = std::min<int64_t>(batch.chunks, (a + 1) * per);
    for (int64_t c = a * per; c < end; ++c) {
      const int64_t at = c * ld;
      const int kept = static_cast<int>(chunk_kept[static_cast<size_t>(c)]);
      if (kept == 0) continue;
      motion.forward(batch.x.data() + at, batch.y.data() + at, batch.z.data() + at, kept,
                     batch.rays[static_cast<size_t>(c)],
                     moving->ray_begin.data() + c * (kChunkRays + 1),
                     batch.time.data() + c * kChunkRays);
      if (offset_weight > 0) pull_back(c, motion);
      motion.backward(d_position.data() + 3 * at, ld, dense->sum(a));
      if (!cameras) continue;
      for (int k = 0; k < 3; ++k) {
        Real* const d = d_position.data() + 3 * at + k * ld;
        const Real* const through = motion.position_gradient(k);
        const Real* const beside = moving->d_points.data() + 3 * at + k * ld;
        for (int s = 0; s < kept; ++s) d[s] = through[s] + beside[s];
      }
    }
  });
}

}  // namespace nerf
