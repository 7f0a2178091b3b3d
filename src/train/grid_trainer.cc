#include "train/grid_trainer.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "base/half.h"
#include "nerf/model/level_order.h"
#include "nerf/parts/losses.h"
#include "train/finest_resolution.h"
#include "train/free_space.h"
#include "train/lap.h"
#include "train/visibility.h"

namespace nerf {

namespace {

int cascades_of(const Scene& scene) {
  int c = 1;
  while (scene.unbounded && c < kMostCascades && std::ldexp(1.0, c - 1) < scene.far) ++c;
  return c;
}

}  // namespace

OptimiserState::OptimiserState(const GridField& field)
    : rows(field.shape.rows),
      features(field.shape.features_per_entry()),
      table_gradient(field.shape.size()),
      marks(rows),
      row_states(kRowParts * field.shape.size()),
      listed(rows),
      listed_count(field.shape.levels.size()),
      network_gradient(field.weights.size()),
      network_m(field.weights.size()),
      network_v(field.weights.size()) {}

void OptimiserState::take_weights(const GridField& field) {
  const size_t f = static_cast<size_t>(features);
  for (size_t i = 0; i < field.half_table.size(); ++i)
    row_states[(i / f * kRowParts + kRowWeights) * f + i % f] =
        internal::half_to_float(field.half_table[i]);
}

void OptimiserState::give_weights(GridField& field) const {
  const size_t f = static_cast<size_t>(features);
  for (size_t i = 0; i < field.half_table.size(); ++i)
    field.half_table[i] = internal::float_to_half(
        static_cast<float>(row_states[(i / f * kRowParts + kRowWeights) * f + i % f]));
}

GridTrainer::GridTrainer(const Scene& s, const PhotoSet& p, const TrainOptions& o, ThreadPool& t)
    : TrainerImpl(s, p, o, t),
      distortion(distortion_weight(o, s)),
      field(resolved(o.grid, s, p), s.unbounded, cascades_of(s)),
      optimiser(field),
      tape(field, /*training=*/true,
           {static_cast<Real>(o.grid_recipe.huber_delta), /*on_weights=*/distortion > 0,
            static_cast<Real>(o.grid_recipe.shared_colour),
            static_cast<Real>(o.grid_recipe.stop_transmittance),
            static_cast<Real>(o.grid_recipe.gradient_roulette)}),
      errors(p, s.train, static_cast<Real>(o.grid_recipe.error_guidance)),
      maker(source, errors, field, distortion > 0, t),
      batch(std::max(1, o.grid_recipe.batch_samples / kChunkSamples)) {
  const size_t columns = static_cast<size_t>(batch.max_chunks) * kChunkSamples;
  features = AlignedArray<Real>(columns * static_cast<size_t>(field.shape.features()));
  d_features = AlignedArray<Real>(features.size());
  densities = AlignedArray<Real>(columns);
  for (int i = 0; i < pool.size(); ++i) workers.push_back(std::make_unique<Chunk>(tape.tape));
  for (int i = 0; i < kAccumulators; ++i) accumulators.emplace_back(field.weights.size());
  chunk_loss.resize(static_cast<size_t>(batch.max_chunks));
  chunk_colours.resize(chunk_loss.size());
  chunk_kept.resize(chunk_loss.size());
  ray_errors.resize(batch.tile.size());
  chunk_opacity.resize(static_cast<size_t>(batch.max_chunks));
  corrections.resize(2 * kBiasCorrections);
  initialise();
  for (const auto& chunk : workers) chunk->packs = &packs;
}

void GridTrainer::pack() {
  pack_layers(field.layers(), field.weights.data(), options.precision, packs, pool);
}

void GridTrainer::initialise() {
  field.initialise(options.seed ^ salt);
  optimiser.take_weights(field);
  // A finer cascade answers for the middle of a coarser one.
  for (int c = 1; c < field.occupancy.cascades(); ++c)
    for (int64_t i = 0; i < field.occupancy.cells(); ++i) {
      const Real w = field.occupancy.cell_width(c);
      const Vec3 centre = field.occupancy.cell_corner(i, c) + Vec3{0.5_r * w, 0.5_r * w, 0.5_r * w};
      if (field.occupancy.cascade_of(centre) < c) field.occupancy.switch_off(c, i);
    }
  switch_off_impossible_cells(scene, photos, options, pool, field.occupancy);
  if (!options.grid_recipe.keep_free) switch_off_free_space(scene, photos, pool, field.occupancy);
  field.occupancy.rebuild(static_cast<Real>(options.grid_recipe.occupancy_threshold), &pool);
  pack();
}

GridPoints GridTrainer::points_of(int64_t chunk) const {
  const int64_t at = chunk * kChunkSamples;
  return {batch.x.data() + at, batch.y.data() + at, batch.z.data() + at};
}

StepReport GridTrainer::step() {
  Lap lap;
  const uint64_t seed = options.seed ^ salt;
  const double capacity = static_cast<double>(batch.max_chunks) * kChunkSamples;
  const int64_t rays = static_cast<int64_t>(
      std::clamp(capacity / std::max(samples_per_ray, 0.05) * 1.03, 64.0, capacity));
  maker.fill(seed, done, rays, samples_per_cell_at(done), batch);
  lap.into(profile.rays);

  encode_batch();
  lap.into(profile.encode);
  const double network_before = profile.network, table_before = profile.scatter;
  run_chunks();
  lap.into(profile.network);
  const double network = profile.network - network_before;

  StepReport report;
  for (int c = 0; c < batch.chunks; ++c) {
    report.loss += chunk_loss[static_cast<size_t>(c)];
    report.opacity += chunk_opacity[static_cast<size_t>(c)];
    report.colours += chunk_colours[static_cast<size_t>(c)];
    report.learning += chunk_kept[static_cast<size_t>(c)];
  }
  const double squared_error = mean_squared_error();
  check_loss(report.loss + squared_error);
  report.opacity /= static_cast<double>(std::max<int64_t>(batch.rays_considered, 1));
  report.psnr = -10 * std::log10(std::max(squared_error, 1e-10));
  report.rays = batch.rays_considered;
  report.samples = batch.total_samples;
  report.rate = rate_at(done);
  update_networks();
  lap.into(profile.update);
  update_table();
  report.rows =
      std::accumulate(optimiser.listed_count.begin(), optimiser.listed_count.end(), int64_t{0});
  lap.into(profile.scatter);

  const double seen = static_cast<double>(batch.total_samples) /
                      static_cast<double>(std::max<int64_t>(batch.rays_considered, 1));
  const auto follow = [&](double& mean, double now) {
    mean = done == 0 ? now : 0.8 * mean + 0.2 * now;
  };
  follow(samples_per_ray, seen);
  follow(chunk_seconds, network);
  follow(table_seconds, profile.scatter - table_before);
  follow(colours_per_sample, static_cast<double>(report.colours) /
                                 static_cast<double>(std::max<int64_t>(report.samples, 1)));
  ++done;
  refresh_occupancy();
  lap.into(profile.occupancy);
  report.step = done;
  return report;
}

void GridTrainer::encode_batch() {
  const int64_t ld = kChunkSamples;
  const int64_t level_count = static_cast<int64_t>(field.shape.levels.size());
  const int64_t rows = field.shape.features_per_entry();
  each_level_of_chunks(pool, level_count, batch.chunks,
                       [&](int64_t l, int64_t first, int64_t last) {
                         for (int64_t c = first; c < last; ++c)
                           encode_level(field, static_cast<size_t>(l), points_of(c),
                                        batch.samples[static_cast<size_t>(c)],
                                        features.data() + (c * level_count + l) * rows * ld, ld);
                       });
}

void GridTrainer::run_chunks() {
  const int64_t ld = kChunkSamples;
  const int64_t rows = field.shape.features();
  const Real scale =
      static_cast<Real>(1 / (3 * source.mean_weight() *
                             static_cast<double>(std::max<int64_t>(batch.rays_considered, 1))));
  const int64_t per = (batch.chunks + kAccumulators - 1) / kAccumulators;
  pool.parallel_for_thread(kAccumulators, [&](int64_t a, int thread) {
    Chunk& chunk = *workers[static_cast<size_t>(thread)];
    AlignedArray<Real>& sum = accumulators[static_cast<size_t>(a)];
    std::fill(sum.begin(), sum.end(), 0.0_r);
    chunk.weights = field.weights.data();
    chunk.weight_gradient = sum.data();
    const int64_t end = std::min<int64_t>(batch.chunks, (a + 1) * per);
    for (int64_t c = a * per; c < end; ++c) {
      const size_t i = static_cast<size_t>(c);
      chunk.samples = batch.samples[i];
      chunk.rays = batch.rays[i];
      chunk.ray_begin = batch.ray_begin.data() + i * (kChunkRays + 1);
      chunk.loss = 0;
      Random random(options.seed ^ salt, static_cast<uint64_t>(done),
                    (uint64_t{1} << 61) + static_cast<uint64_t>(c));  // no ray has this number
      chunk.roulette.offset = static_cast<double>(random.uniform());
      chunk.bind(tape.features, features.data() + c * rows * ld, d_features.data() + c * rows * ld);
      std::memcpy(chunk.data(tape.delta), batch.delta.data() + c * ld, ld * sizeof(Real));
      const size_t ray_bytes = 3 * kChunkRays * sizeof(Real);
      std::memcpy(chunk.data(tape.directions), batch.direction_of(static_cast<int>(c)), ray_bytes);
      std::memcpy(chunk.data(tape.background), batch.background_of(static_cast<int>(c)), ray_bytes);
      std::memcpy(chunk.data(tape.target), batch.target_of(static_cast<int>(c)), ray_bytes);
      for (int r = 0; r < chunk.rays; ++r)
        chunk.data(tape.scale)[r] = scale * batch.weight[i * kChunkRays + static_cast<size_t>(r)];
      tape.tape.forward(chunk);
      chunk_colours[i] = chunk.count(tape.colour);
      if (distortion > 0) add_distortion(chunk, c * ld);
      tape.tape.backward(chunk);
      keep_samples(c, chunk);
      std::memcpy(densities.data() + c * ld, chunk.data(tape.density), ld * sizeof(Real));
      chunk_loss[i] = chunk.loss;
      const int64_t lr = chunk.stride(tape.image.pixel);
      const Real* pixel = chunk.data(tape.image.pixel);
      const Real* target = chunk.data(tape.target);
      for (int r = 0; r < chunk.rays; ++r) {
        Real sum = 0;
        for (int k = 0; k < 3; ++k) {
          const Real e = pixel[k * lr + r] - target[k * lr + r];
          sum += e * e;
        }
        ray_errors[i * kChunkRays + static_cast<size_t>(r)] = sum;
      }
      const Real* opacity = pixel + 3 * lr;
      chunk_opacity[i] = std::accumulate(opacity, opacity + chunk.rays, 0.0);
    }
    chunk.bind(tape.features, nullptr, nullptr);
  });
}

void GridTrainer::keep_samples(int64_t c, Chunk& chunk) {
  chunk_kept[static_cast<size_t>(c)] = chunk.samples;
  batch.keep_points(static_cast<int>(c), chunk.roulette.kept.data(), chunk.samples);
}

// A mean over rays: their scale is that of a mean over three channels too.
void GridTrainer::add_distortion(Chunk& chunk, int64_t first_sample) {
  Real* gradient = chunk.data(tape.weight_gradient);
  std::fill_n(gradient, chunk.samples, 0.0_r);
  for (int r = 0; r < chunk.rays; ++r) {
    const int32_t begin = chunk.ray_begin[r];
    const size_t n = static_cast<size_t>(chunk.ray_begin[r + 1] - begin);
    const auto of_ray = [&](const Real* data) { return std::span(data + begin, n); };
    chunk.loss += distortion_loss(of_ray(batch.middle.data() + first_sample),
                                  of_ray(batch.width.data() + first_sample),
                                  of_ray(chunk.data(tape.image.weights)),
                                  static_cast<Real>(3 * distortion) * chunk.data(tape.scale)[r],
                                  std::span(gradient + begin, n));
  }
}

void GridTrainer::update_networks() {
  const size_t n = field.weights.size();
  Real* gradient = optimiser.network_gradient.data();
  std::fill_n(gradient, n, 0.0_r);
  for (const auto& a : accumulators)
    for (size_t i = 0; i < n; ++i) gradient[i] += a[i];
  check_gradient();

  AdamStep adam = adam_at(done);
  adam.rate *= static_cast<Real>(options.grid_recipe.network_rate);
  adam_dense(adam, done + 1, static_cast<int64_t>(n), gradient, optimiser.network_m.data(),
             optimiser.network_v.data(), field.weights.data());
  pack();
}

void GridTrainer::update_table() {
  const int64_t ld = kChunkSamples;
  const int64_t levels = static_cast<int64_t>(field.shape.levels.size());
  const AdamStep step = adam_at(done);
  bias_corrections(step, corrections.data());
  const auto list_of = [&](int64_t l) {
    return optimiser.listed.data() + field.shape.levels[static_cast<size_t>(l)].offset;
  };
  const auto adam = [&](int64_t l, int64_t first, int64_t count) {
    const HashGridLevel& level = field.shape.levels[static_cast<size_t>(l)];
    const auto update = [&](auto* table) {
      adam_rows(step, level.features, list_of(l) + first, count,
                optimiser.table_gradient.data() + level.begin(),
                optimiser.row_states.data() + kRowParts * level.begin(), table + level.begin(),
                corrections.data());
    };
    if (field.options.table_bits == 16)
      update(field.half_table.data());
    else
      update(field.table.data());
  };
  // A level's gradient is still in a cache right after it was summed; with many threads the levels
  // are too few to share the optimiser's work.
  const bool at_once = 2 * pool.size() <= levels;
  // A level's rows belong to one item, which takes the samples in order. Fine levels first: they
  // are the dearest. The occupancy's cells have one owner as well, and so has the error map.
  pool.parallel_for(levels + 2, [&](int64_t i) {
    if (i == levels) return observe_samples();
    if (i > levels) return observe_errors();
    const int64_t l = levels - 1 - i;
    const HashGridLevel& level = field.shape.levels[static_cast<size_t>(l)];
    Real* const gradient = optimiser.table_gradient.data() + level.begin();
    uint8_t* const marks = optimiser.marks.data() + level.offset;
    for (int64_t c = 0; c < batch.chunks; ++c) {
      const GridPoints p = points_of(c);
      hash_grid_backward(level, p.x, p.y, p.z, chunk_kept[static_cast<size_t>(c)],
                         d_features.data() + (c * levels + l) * level.features * ld, ld, gradient,
                         marks);
    }
    int64_t& count = optimiser.listed_count[static_cast<size_t>(l)];
    count = list_rows(level.entries, marks, list_of(l));
    if (at_once) adam(l, 0, count);
  });
  if (at_once) return;
  constexpr int64_t kRows = 8192;
  for (int64_t l = 0; l < levels; ++l) {
    const int64_t count = optimiser.listed_count[static_cast<size_t>(l)];
    pool.parallel_for((count + kRows - 1) / kRows,
                      [&](int64_t i) { adam(l, i * kRows, std::min(kRows, count - i * kRows)); });
  }
}

void GridTrainer::begin_anew() {
  samples_per_ray = 16;
  optimiser = OptimiserState(field);
  errors.reset();
  field.occupancy = OccupancyGrid(field.occupancy.cascades(), field.occupancy.side());
  initialise();
}

RadianceField GridTrainer::snapshot(ModelInfo info) const {
  auto grid = std::make_shared<GridField>(field);
  grid->occupancy.forget_training();
  return RadianceField(std::move(info), std::move(grid));
}

}  // namespace nerf
